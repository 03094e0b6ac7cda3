"""The catalogue for launchers with SPARKs: its own, and one that another controller drives (driver "advisory")."""

import math

from benchmarks.matrix.breaking import Device, Inside, Process, Wire
from benchmarks.matrix.row import BEAT_S, DEVICES, HUGE, ITSELF, KEEPS, NAN, REARM, STALE_S, TURNS_AT, Row, tell_wanted

FAULTS_S = 1.15                       # what a SPARK says of its faults may be 1 s old
TOLD_S = 0.4                          # STATUS_1 comes every 0.25 s
STATUSES = {"STATUS_0": ("sends no heartbeat", BEAT_S, 0.6),
            "STATUS_1": ("says nothing of its|has said nothing of its", FAULTS_S, 1.6),
            "STATUS_2": ("silent for", STALE_S, 0.6)}
TROUBLES = (("flywheel_b", "too hot", "too hot", "too hot"),
            ("hood", "gate driver fault", "gate driver", "gate driver"),
            ("feeder", "sensor fault", "sensor", "sensor"),
            ("flywheel_a", "a fault that came and went (sticky)", "came and went", "gate driver"))


def _frames(launcher: str, names: tuple[str, ...]) -> list[Row]:
    """Of devices that speak SPARK, whoever drives them."""
    rows = [_row(launcher, name, f"no {message}, the others go on", "lost", Device(name, "silent", message), reason,
                 within_s, lasts_s=lasts_s)
            for name in names for message, (reason, within_s, lasts_s) in STATUSES.items()]
    rows += [_row(launcher, name, "no frames", "lost", Device(name, "silent"), "silent for", STALE_S) for name in names]
    for name in names[:1]:
        rows += [_row(launcher, name, "status frames cut short", "short", Device(name, "truncated", length=5),
                      "bad frame: spark.*5 bytes", STALE_S),
                 _row(launcher, name, "speed is not a number", "not finite",
                      Device(name, "overwritten", "STATUS_2", at=0, data=NAN), "bad frame: spark.*velocity", STALE_S),
                 _row(launcher, name, "speed of 1e20", "implausible",
                      Device(name, "overwritten", "STATUS_2", at=0, data=HUGE), "bad frame: spark.*velocity", STALE_S),
                 _row(launcher, name, "status frames held back, then all at once", "late", Device(name, "held"),
                      "silent for", STALE_S),
                 _row(launcher, name, "encoder stuck", "stuck", Device(name, "stuck", "STATUS_2"),
                      "position stands still", STALE_S)]
    whose = "SPARKs" if launcher == "spark" else "advice only"
    rows.append(Row(f"{whose}, both flywheel motors: say the speed that is wanted, and turn at another",
                    "contradiction", tell_wanted("STATUS_2", 0, math.tau / 60.0), TURNS_AT, 1.0, lasts_s=2.0,
                    first=True, launcher=launcher))
    return rows


def _inside() -> list[Row]:
    rows = [_row("spark", name, words, "fault", Inside(name, what), reason, TOLD_S, REARM)
            for name, words, what, reason in TROUBLES]
    rows += [_row("spark", name, "reset, its settings forgotten", "settings lost", Inside(name, "settings lost"),
                  "silent for|has reset", TOLD_S, REARM) for name in ("flywheel_a", "hood")]
    rows += [_row("spark", name, "loses its power", "power", Device(name, "unpowered"), "silent for", STALE_S, REARM)
             for name in ("flywheel_a", "hood")]
    return [
        *rows,
        _row("spark", "flywheel_a", "cable out, and in again", "unplugged", Device("flywheel_a", "unplugged"),
             "silent for", STALE_S),
        _row("spark", "flywheel_a", "hears nothing, no heartbeat enables it", "heartbeat", Device("flywheel_a", "deaf"),
             "applies nothing of the duty", 0.4),
        _row("spark, long feed", "feeder", "hears nothing when it is to feed", "heartbeat", Device("feeder", "deaf"),
             "applies nothing of the duty", 1.0, REARM, 3.0),
        _row("spark", "flywheel_b", "locked to a competition controller, until its power is cycled", "heartbeat",
             Inside("flywheel_b", "locked"), "locked to a competition controller", STALE_S, REARM),
        _row("spark", "hood", "limit switch sticks closed, hood is up", "limit switch",
             Inside("hood", "switch closed"), "", 0.0, KEEPS),
        _row("spark", "hood", "limit switch never closes, from the start", "limit switch",
             Inside("hood", "switch open"), "hood not homed", 1.0, lasts_s=4.0, first=True),
        _row("spark", "flywheel_a", "firmware 24 from the start, then updated", "firmware",
             Inside("flywheel_a", "old firmware"), r"runs firmware 24\.0\.1", 0.5, REARM, 3.0, first=True),
        _row("spark", "hood", "firmware 27 from the start, then exchanged", "firmware", Inside("hood", "new firmware"),
             r"runs firmware 27\.0\.0", 0.5, REARM, 3.0, first=True)]


def _wires() -> list[Row]:
    return [
        Row("SPARKs: a second device with the id of flywheel motor 1", "wrong id", Wire("two sparks with one id"),
            "two devices with one id", 1.2, lasts_s=2.0, launcher="spark"),
        Row("SPARKs: another host's heartbeat disables them", "strangers", Wire("another host's heartbeat"),
            "another host sends", STALE_S, launcher="spark"),
        Row("SPARKs: a competition controller on the bus locks them all", "heartbeat", Wire("competition controller"),
            "locked to a competition controller", STALE_S, REARM, launcher="spark"),
        Row("SPARKs: nothing on the bus for 2.5 s", "bus-off", Wire("silent"), "silent for", STALE_S, lasts_s=2.5,
            real=True, launcher="spark"),
        Row("SPARKs: control process stopped for 0.6 s (SIGSTOP)", "process", Process("control", "stop"),
            "ticks stood still", 0.8, launcher="spark"),
        Row("SPARKs: control process killed, started again", "process", Process("control", "kill"), "motors idle", 0.25,
            REARM, lasts_s=2.0, buses=("slcan", "socketcan"), launcher="spark")]


def _advice() -> list[Row]:
    return [
        *_frames("advisory", ("flywheel_a",)),
        _row("advisory", "hood", "no frames", "lost", Device("hood", "silent"), "silent for", STALE_S),
        _row("advisory", "feeder", "gate driver fault", "fault", Inside("feeder", "gate driver"), "gate driver",
             TOLD_S),
        _row("advisory", "hood_encoder", "no frames", "lost", Device("hood_encoder", "silent"), "silent for", STALE_S),
        Row("advice only: its own controller commands and keeps its heartbeat", "strangers",
            Wire("competition controller"), "", 0.0, KEEPS, launcher="advisory")]


def _row(launcher: str, name: str, words: str, family: str, breaking: Device | Inside, reason: str, within_s: float,
         after: str = ITSELF, lasts_s: float = 0.6, first: bool = False) -> Row:
    whose = "advice only" if launcher == "advisory" else "SPARK"
    pattern = reason if not reason or reason.startswith(("bad frame", "hood")) else f"{DEVICES[name]}.*({reason})"
    return Row(f"{whose}, {DEVICES[name]}: {words}", family, breaking, pattern, within_s, after, lasts_s, first=first,
               launcher=launcher)


SPARK_ROWS = (*_frames("spark", ("flywheel_a", "hood", "feeder")), *_inside(), *_wires(), *_advice())
