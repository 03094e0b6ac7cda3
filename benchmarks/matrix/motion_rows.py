"""The catalogue of motion: what turns or moves on readings that are wrong, how soon it has to stop, and what is said.

Times are those of "what stops what" in docs/explanation/safety.md.
"""

from collections.abc import Iterator

from benchmarks.matrix.breaking import Motion
from benchmarks.matrix.row import ITSELF, KEEPS, REARM, Row

EITHER = "by itself, or arm again"    # how it is told from what latches depends on what garbage happens to say
STALE_S, WRONG_S, REST_S = 0.12, 0.08, 0.25   # readings stop; freeze under torque or jump; are wrong since rest
NEVER_S = 0.01                        # not driven at all
TRAVEL_DEG = 5.0
HOMING_S = 0.4                        # until encoder and screw are 1.5 degrees apart, from rest
BOTH = ("flywheel_a", "flywheel_b")

# What the page may say of each kind of fault, as codes of truearc.robot.reasons: one of these; none, any fault; None,
# it is none. A reading keeps its own code; "axis_released" and "axis_latched" name it as their cause.
RELEASED = ("axis_released", "axis_latched")
INTERLOCKS = (*RELEASED, "speed_jumped", "frames_unusable", "hood_push_dropped")       # none may come without a fault
CODES: dict[str, tuple[str, ...] | None] = {
    "any": (),
    "none": None,
    "stale": ("device_stale", "device_never_received", *RELEASED),
    "faulty": ("motor_error", "motor_not_driven", "bad_frame", "device_stale", "motor_not_finite", "magnet_lost",
               *RELEASED),
    "frozen": ("encoder_stuck", "encoder_mismatch", "hood_encoders_disagree", *RELEASED),
    "no response": ("encoder_stuck", "encoder_mismatch", *RELEASED),
    "disagree": ("encoder_mismatch", "speed_jumped", *RELEASED),
    "direction": ("speed_jumped", "encoder_mismatch", *RELEASED),
    "jump": ("speed_jumped", "encoder_mismatch", "encoder_stuck", *RELEASED),
    "overspeed": RELEASED,
    "repeated": RELEASED,
    "jam": RELEASED,
    "homing": RELEASED,
    "encoders": ("hood_encoders_disagree", *RELEASED),
    "switch": (),
}


def _wheels() -> Iterator[Row]:
    for name, what, names, code in (
            ("both encoders read 0", "zero", BOTH, "no response"),
            ("both speeds read 0, positions go on", "speed zero", BOTH, "disagree"),
            ("both speeds read 40 % too low", "speed x 0.6", BOTH, "disagree"),
            ("both positions read 40 % too low", "position x 0.6", BOTH, "disagree"),
            ("both encoders are reversed", "reversed", BOTH, "direction"),
            ("both encoders are big-endian", "big-endian", BOTH, "any"),
            ("both motors turn the other way", "wheels backwards", (), "direction"),
            ("motors turn against each other", "motor 2 backwards", (), "no response"),
            ("the belt is jammed", "wheels jam", (), "no response"),
            ("the motors have no power", "wheels have no power", (), "no response")):
        yield _wheel(f"{name}, since rest", Motion(what, names, "start", "wheels", "push", code), REST_S,
                     EITHER if what == "big-endian" else REARM, 3.0)
    yield _wheel("no estimates of motor 1 since the start",
                 Motion("silent", BOTH[:1], "start", "wheels", "push", "stale"), NEVER_S, ITSELF, 2.0)
    for words, names in (("both encoders", BOTH), ("motor 1's encoder", BOTH[:1])):
        for name, what, since, code, within_s, after in (
                ("stop, heartbeats go on", "silent", "reading", "stale", STALE_S, ITSELF),
                ("freeze", "frozen", "fault", "frozen", WRONG_S, EITHER),
                ("jump to 0", "zero", "fault", "jump", WRONG_S, REARM),
                ("jump to half the speed", "half", "fault", "jump", WRONG_S, REARM),
                ("turn round", "reversed", "fault", "direction", WRONG_S, REARM),
                ("turn big-endian", "big-endian", "fault", "any", WRONG_S, EITHER),
                ("are not numbers", "not a number", "fault", "faulty", STALE_S, ITSELF)):
            yield _wheel(f"{words}: readings {name} while spinning up",
                         Motion(what, names, "spinning", "wheels", since, code), within_s, after, 3.0)
    yield _wheel("motor 2 keeps its torque, whatever it is asked for",
                 Motion("keeps its torque", BOTH[1:], "spinning", "wheels", "fault", "overspeed"), 1.0, REARM, 3.0)
    # three gaps in 10 s; the third begins 2.4 s after the first, and latches
    yield _wheel("motor 1's readings stop for 0.25 s, again and again",
                 Motion("stutters", BOTH[:1], "settled", "wheels", "fault", "repeated"), 2.4 + STALE_S, REARM, 7.0)
    yield _wheel("no target and no request for more than 10 s",
                 Motion("no target", (), "settled", "wheels", "fault", "none"), 10.2, ITSELF, 13.0)


def _hood() -> Iterator[Row]:
    encoder = ("hood_encoder",)
    for name, what, names, when, since, code, within_s, after in (
            ("no angles", "silent", encoder, "hood rises", "reading", "stale", STALE_S, ITSELF),
            ("its encoder is frozen", "frozen", encoder, "hood rises", "fault", "frozen", REST_S, EITHER),
            ("its encoder jumps by 10 degrees", "10 degrees off", encoder, "hood rises", "fault", "encoders", REST_S,
             EITHER),
            ("its magnet is lost", "magnet lost", encoder, "hood rises", "fault", "faulty", STALE_S, ITSELF),
            ("no estimates of its motor", "silent", ("hood",), "hood rises", "reading", "stale", STALE_S, ITSELF),
            ("its motor's encoder is frozen", "frozen", ("hood",), "hood rises", "fault", "frozen", WRONG_S, EITHER),
            ("its motor's encoder jumps to 0", "zero", ("hood",), "hood rises", "fault", "any", WRONG_S, EITHER),
            ("its motor's encoder turns round", "reversed", ("hood",), "hood rises", "fault", "any", WRONG_S, EITHER)):
        yield _hooded(f"{name} while it rises", Motion(what, names, when, "hood", since, code, travel_deg=TRAVEL_DEG),
                      within_s, after)
    yield _hooded("its encoder jumps by 10 degrees at the set point",
                  Motion("10 degrees off", encoder, "settled", "hood", "fault", "encoders", travel_deg=TRAVEL_DEG),
                  REST_S, EITHER)
    yield _hooded("is jammed", Motion("hood jams", (), "hood rises", "hood", "push", "jam", 2, travel_deg=TRAVEL_DEG),
                  0.5, REARM)
    yield _hooded("is jammed for 0.45 s", Motion("hood jams", (), "hood rises", "hood", "push", "none", 2), 0.5, ITSELF,
                  0.45)
    # down from where it is found, and the stop's push, and once more
    yield _hooded("its limit switch never closes", Motion("switch dead", (), "start", "hood", "push", "homing", 2),
                  1.35, REARM)
    yield _hooded("its screw has come loose of the motor",
                  Motion("hood comes loose", (), "start", "hood", "push", "encoders"), 1.0, REARM, 4.0)
    for name, what, names, code in (("its encoder is frozen", "frozen", encoder, "encoders"),
                                    ("its encoder is reversed", "angle reversed", encoder, "encoders"),
                                    ("its motor's encoder reads 0", "zero", ("hood",), "encoders")):
        yield _hooded(f"{name} while it homes from 60 degrees",
                      Motion(what, names, "start", "hood", "push", code, travel_deg=TRAVEL_DEG, start_deg=60.0),
                      HOMING_S, REARM)
    yield _hooded("its encoder jumps by 10 degrees while it homes from 60 degrees",
                  Motion("10 degrees off", encoder, "hood homes", "hood", "fault", "encoders", travel_deg=TRAVEL_DEG,
                         start_deg=60.0), REST_S, REARM)
    yield _hooded("has no encoder, and its motor's reads 0",
                  Motion("zero", ("hood",), "start", "hood", "push", "homing", travel_deg=TRAVEL_DEG, start_deg=60.0,
                         has_encoder=False), 0.35, REARM)
    yield _hooded("has no encoder, homes from 60 degrees and rises",
                  Motion("nothing", (), "start", "", "fault", "none", start_deg=60.0, has_encoder=False), 0.0, KEEPS,
                  9.0)
    yield _hooded("its screw is stiff", Motion("hood is stiff", (), "start", "", "fault", "none"), 0.0, KEEPS, 6.0)
    yield _hooded("its encoder reads 0.8 degrees low, set point at the soft limit",
                  Motion("encoder 0.8 degrees low", (), "start", "", "fault", "none", hood_deg=60.0, high_deg=60.0),
                  0.0, KEEPS, 6.0)
    yield _hooded("rises from its switch to 70 degrees",
                  Motion("nothing", (), "start", "", "fault", "none", hood_deg=70.0), 0.0, KEEPS, 6.0)


def _wheel(words: str, motion: Motion, within_s: float, after: str, lasts_s: float) -> Row:
    return Row(f"motion, wheels: {words}", "motion", motion, (), within_s, after, lasts_s, first=motion.when == "start")


def _hooded(words: str, motion: Motion, within_s: float, after: str, lasts_s: float = 3.0) -> Row:
    return Row(f"motion, hood: {words}", "motion", motion, (), within_s, after, lasts_s, first=motion.when == "start")


def _with_sparks(row: Row) -> Row:
    """The same of a launcher with SPARKs; one that is first heard while armed reports its reset until armed again."""
    name = row.name.replace("motion, ", "motion, SPARK ")
    return Row(name, row.family, row.breaking, row.reason, row.within_s,
               REARM if "since the start" in row.name else row.after, row.lasts_s, first=row.first,
               launcher="spark")


ODRIVE_ROWS = (*_wheels(), *_hood())
# Of an ODrive's heartbeat, every 0.1 s, comes that it has given up. A SPARK's switch is in the frame that says it lives
ONLY_ODRIVE = (_wheel("motor 2 gives up with an error while spinning up",
                      Motion("gives up", BOTH[1:], "spinning", "wheels", "fault", "faulty"), 0.1 + STALE_S, EITHER,
                      3.0),
               # an emulated SPARK brakes by a torque, which such a world would turn round, too
               _hooded("its motor turns the other way, since rest",
                       Motion("hood backwards", (), "start", "hood", "push", "any", travel_deg=TRAVEL_DEG), REST_S,
                       REARM),
               _hooded("its limit switch never answers",
                       Motion("switch never answers", ("hood",), "start", "hood", "push", "switch"), NEVER_S, ITSELF))
MOTION_ROWS = (*ODRIVE_ROWS, *ONLY_ODRIVE, *map(_with_sparks, ODRIVE_ROWS))
