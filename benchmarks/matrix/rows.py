"""The fault catalogue: each fault, the expected reaction, the time allowed for it, and how the robot recovers.

It covers ODrives, wires, camera, button box, disk, model and processes; launchers with SPARKs or with motors driven by
another controller; NetworkTables keys; and motion, with the time limits of the interlock table in
docs/explanation/safety.md.

No row shows wheels above 1.05 times their free speed: at the rows' set point, 0.6 of it, 1.1 times the set point acts
first, and above 0.955 of it, where it would not, nothing in the plant turns them faster than their free speed.
"""

import math
import struct
from collections.abc import Iterator
from functools import partial

from msgspec.structs import replace

from benchmarks.matrix import fault
from benchmarks.matrix import keys as nt
from benchmarks.matrix.fault import DISARMS, EITHER, ITSELF, KEEPS, REARM, Device, Inside, Motion, Row, Signs, of, says
from truearc.hw import fault_codes as hw
from truearc.hw.reason import Code
from truearc.robot import reasons as bot

STALE_S = 0.15                        # a reading may be 0.1 s old; ticks come every 5 ms
BEAT_S = 0.35                         # heartbeats come every 0.1 s, two may be lost
SEEN_S = 0.5                          # a sighting may be 0.3 s old, images come every 0.1 s
DEVICES = {"flywheel_a": "flywheel motor 1", "flywheel_b": "flywheel motor 2", "hood": "hood motor",
           "feeder": "feeder motor", "hood_encoder": "hood encoder"}
AXES = tuple(DEVICES)[:4]
NAN, HUGE = struct.pack("<f", math.nan), struct.pack("<f", 1e20)
WANTED_RAD_S = 0.3 * 594.0            # what the robot is asked to fire with
TURNS_AT = says(hw.ENCODER_MISMATCH, motor="flywheel motor 1")
SILENT = says(bot.DEVICE_STALE)
BAD_SPEED = says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, signal="velocity_rev_s"))
WATCHDOG, SPINOUT = (says(bot.MOTOR_ERROR, errors=(error(),))
                     for error in (hw.ERROR_WATCHDOG_EXPIRED, hw.ERROR_SPINOUT))
FROZEN = says(bot.CAMERA_LOST, cause=says(hw.CAMERA_FROZEN))
NO_VISION = says(bot.CAMERA_LOST, cause=says(hw.PROCESS_KILLED, hw.PROCESS_STARTING, process="vision"))
PRESSES_LOST = says(bot.DISARMED_BY_BOX, cause=says(hw.BOX_PRESSES_LOST))


def tell_wanted(message: str, at: int, unit_rad_s: float) -> fault.Both:
    """Both flywheel motors say from the start that they turn as is wanted, so that nothing spins them up; the second
    one is mounted the other way round."""
    speeds = {name: struct.pack("<f", sign * WANTED_RAD_S / unit_rad_s)
              for name, sign in (("flywheel_a", 1.0), ("flywheel_b", -1.0))}
    return fault.Both(*(Device(name, "overwritten", message, at=at, data=data) for name, data in speeds.items()))


def _seen(cause: Code) -> Signs:
    return says(bot.TARGET_STALE, cause=says(cause))


def _not_recording(*causes: Code) -> Signs:
    return says(bot.NOT_RECORDING, cause=says(*causes))


def _frames() -> list[Row]:
    estimates = {name: "Get_Encoder_Estimates" for name in AXES} | {"hood_encoder": "POSITION_OUTPUT"}
    rows = [Row(f"{words}: no frames", "lost", Device(name, "silent"), of(words, SILENT), STALE_S)
            for name, words in DEVICES.items()]
    rows += [Row(f"{words}: no readings, heartbeat goes on", "lost", Device(name, "silent", estimates[name]),
                 of(words, SILENT), STALE_S) for name, words in DEVICES.items() if name != "hood_encoder"]
    rows.append(Row("hood encoder: no STATUS, angles go on", "lost", Device("hood_encoder", "silent", "STATUS"),
                    of("hood encoder", says(bot.DEVICE_FAULTS_STALE, bot.DEVICE_FAULTS_NEVER_RECEIVED)), BEAT_S))
    rows += [Row(f"{DEVICES[name]}: no heartbeat, readings go on", "lost", Device(name, "silent", "Heartbeat"),
                 says(bot.DEVICE_HEARTBEAT_STALE, device=DEVICES[name]), BEAT_S) for name in AXES]
    rows += [Row(f"{words}: frames cut short", "short", Device(name, "truncated", length=3),
                 (*says(bot.BAD_FRAME), *of(words, SILENT)), STALE_S) for name, words in DEVICES.items()]
    rows.append(Row("hood encoder: frames too long", "too long", Device("hood_encoder", "lengthened",
                                                                        "POSITION_OUTPUT", length=8),
                    says(bot.BAD_FRAME, cause=says(hw.FRAME_LENGTH, message="canandmag POSITION_OUTPUT")), STALE_S))
    rows += [Row(f"{DEVICES[name]}: speed is not a number", "not finite",
                 Device(name, "overwritten", estimates[name], at=4, data=NAN), BAD_SPEED, STALE_S)
             for name in AXES]
    rows += [Row(f"{DEVICES[name]}: speed of 1e20", "implausible",
                 Device(name, "overwritten", estimates[name], at=4, data=HUGE), BAD_SPEED, STALE_S)
             for name in AXES]
    rows += [Row("flywheel motor 1: reads 60 rad/s too much", "implausible",
                 Device("flywheel_a", "overwritten", estimates["flywheel_a"], at=4, data=struct.pack("<f", 40.0)),
                 says(bot.FLYWHEELS_DIFFER), STALE_S, REARM),
             Row("hood encoder: reads another angle", "implausible",
                 Device("hood_encoder", "overwritten", "POSITION_OUTPUT", at=4, data=b"\0\x40"),
                 says(bot.HOOD_ENCODERS_DISAGREE), STALE_S, REARM)]
    rows += [Row(f"{words}: frames held back, then all at once", "late", Device(name, "held"),
                 of(words, SILENT), STALE_S) for name, words in DEVICES.items()]
    rows += [Row(f"{DEVICES[name]}: every frame twice", "duplicated", Device(name, "doubled"),
                 says(hw.DUPLICATE_ID), 1.2, lasts_s=2.0) for name in ("flywheel_a", "hood_encoder")]
    rows += [Row("flywheel motor 1: encoder stuck", "stuck",
                 Device("flywheel_a", "stuck", estimates["flywheel_a"]), says(hw.ENCODER_STUCK), STALE_S, REARM),
             Row("flywheel motor 2: encoder stuck", "stuck",
                 Device("flywheel_b", "stuck", estimates["flywheel_b"]), says(hw.ENCODER_STUCK), STALE_S, REARM),
             Row("both flywheel motors: say the speed that is wanted, and turn at another", "contradiction",
                 tell_wanted("Get_Encoder_Estimates", 4, math.tau), says(bot.AXIS_LATCHED), 1.0, REARM, 2.0,
                 first=True),
             Row("hood encoder stuck, hood does not move", "stuck", Device("hood_encoder", "stuck"), (), 0.0, KEEPS),
             Row("flywheel motor 1: frames under another id", "wrong id", Device("flywheel_a", "moved", by=0x120),
                 of("flywheel motor 1", SILENT), STALE_S),
             Row("hood encoder: frames under another id", "wrong id", Device("hood_encoder", "moved", by=7),
                 of("hood encoder", SILENT), STALE_S)]
    return rows


def _devices() -> list[Row]:
    rows = [Row(f"{words}: cable out, and in again", "unplugged", Device(name, "unplugged"),
                of(words, SILENT), STALE_S, ITSELF if name == "hood_encoder" else REARM)
            for name, words in DEVICES.items()]
    rows += [Row(f"{DEVICES[name]}: loses its power", "power", Device(name, "unpowered"),
                 of(DEVICES[name], SILENT), STALE_S, REARM if name == "hood" else ITSELF)
             for name in (*AXES, "hood_encoder")]
    rows += [Row(f"{DEVICES[name]}: reset, its reporting rates forgotten", "settings lost",
                 Inside(name, "settings lost"), of(DEVICES[name], SILENT), STALE_S,
                 REARM if name == "hood" else ITSELF) for name in ("flywheel_a", "hood")]
    rows += [Row(f"{DEVICES[name]}: receives no frames, its watchdog bites", "watchdog", Device(name, "deaf"),
                 of(DEVICES[name], WATCHDOG), BEAT_S, REARM) for name in ("flywheel_a", "hood", "feeder")]
    rows += [Row(f"{DEVICES[name]}: axis error (spinout)", "axis error", Inside(name, "error"),
                 of(DEVICES[name], SPINOUT), 0.2, REARM) for name in ("flywheel_b", "hood")]
    rows += [Row("flywheel motor 1: leaves closed loop without an error", "axis error", Inside("flywheel_a", "idle"),
                 (*of("flywheel motor 1", says(bot.MOTOR_NOT_DRIVEN)), *says(bot.WHEELS_OFF_SPEED)), 0.2, lasts_s=0.1),
             Row("hood encoder: magnet lost", "axis error", Inside("hood_encoder", "magnet"), says(bot.MAGNET_LOST),
                 STALE_S)]
    return rows


def _wires() -> list[Row]:
    return [
        Row("another host commands a torque", "another host", fault.Wire("another host commands"),
            says(hw.FOREIGN_HOST, frame="0x02e"), STALE_S),
        Row("another host stops a motor", "another host", fault.Wire("another host stops"),
            says(hw.FOREIGN_HOST, frame="0x022"), STALE_S, REARM),
        Row("a second device with the id of flywheel motor 1", "wrong id", fault.Wire("two with one id"),
            says(bot.FLYWHEELS_DIFFER, hw.DUPLICATE_ID), 0.3, REARM),
        Row("unknown frames", "strangers", fault.Wire("strangers"), (), 0.0, KEEPS),
        Row("remote frames of strangers", "strangers", fault.Wire("questions"), (), 0.0, KEEPS),
        Row("garbled lines (slcan), garbled frames", "garbled", fault.Wire("garbled"), (), 0.0, KEEPS),
        Row("controller bus-off", "bus-off", fault.Wire("bus off"),
            says(bot.CAN_LOST, hw.CAN_REOPENED, bot.DEVICE_STALE), STALE_S, REARM, real=True),
        Row("nothing on the bus for 2.5 s", "bus-off", fault.Wire("silent"), SILENT, STALE_S, REARM, lasts_s=2.5,
            real=True),
        Row("adapter pulled out, and in again", "adapter", fault.Wire("adapter out"), says(bot.CAN_LOST), STALE_S,
            REARM, 1.5, True),
        Row("the transmit queue is full", "queue full", fault.Wire("queue full"), says(bot.FRAMES_NOT_SENT), STALE_S,
            REARM),
        Row("the receive queue overruns (64 frames), the tick stalls", "queue full", fault.Wire("overrun"),
            says(hw.CAN_OVERRUN), 0.8, REARM, lasts_s=0.6, real=True)]


def _camera() -> list[Row]:
    seen = says(bot.TARGET_STALE)
    return [Row(f"camera: {words}", "camera", fault.Camera(what), reason, within_s, after, lasts_s, real)
            for words, what, reason, within_s, after, lasts_s, real in (
                ("the same image again and again", "frozen", seen, SEEN_S, ITSELF, 1.0, True),
                ("the same image for 7 s", "frozen", FROZEN, 2.4, ITSELF, 7.0, True),
                ("no images", "hangs", seen, SEEN_S, ITSELF, 1.0, False),
                ("no images for 3 s", "hangs", says(bot.CAMERA_LOST), 2.4, ITSELF, 3.0, True),
                ("pulled out, and in again", "unplugged", says(bot.CAMERA_LOST), SEEN_S, ITSELF, 1.5, True),
                ("black", "black", _seen(bot.IMAGE_DARK), SEEN_S, ITSELF, 1.0, False),
                ("saturated", "saturated", _seen(bot.IMAGE_BRIGHT), SEEN_S, ITSELF, 1.0, False),
                ("images half a second old", "slow", seen, SEEN_S, ITSELF, 1.0, False),
                ("one image per second", "1 per second", seen, SEEN_S, KEEPS, 3.0, False),
                ("two targets", "two targets", _seen(bot.SEVERAL_TARGETS), SEEN_S, ITSELF, 1.0, False),
                ("reflection on the floor", "reflections", (), 0.0, KEEPS, 1.0, False),
                ("another place", "elsewhere", says(bot.NOT_AT_PLACE), 0.3, ITSELF, 1.0, False),
                ("stamps out of order", "old stamps", (), 0.0, KEEPS, 1.0, False),
                ("stamps to come (driver's clock)", "stamps to come", (), 0.0, KEEPS, 1.0, True))] + [
        Row("camera: another place, reached while fire is asked for", "camera", fault.Camera("drives off"),
            says(bot.NOT_AT_PLACE), 1.5, ITSELF, 5.0, first=True)]


def _box() -> list[Row]:
    box, refused = "button box: ", hw.BOX_LINES_REFUSED
    return [Row(words, "box", fault.Box(what), reason, within_s, after, lasts_s, real)
            for words, what, reason, within_s, after, lasts_s, real in (
                (box + "pulled out, and in again", "unplugged", says(bot.BOX_LOST), STALE_S, DISARMS, 0.6, True),
                (box + "silent for 3 s", "silent", says(bot.BOX_SILENT), 2.1, DISARMS, 3.0, False),
                (box + "loses its power", "no power", says(bot.BOX_SILENT), 2.1, DISARMS, 2.5, False),
                (box + "garbage between its lines", "garbage", says(refused), STALE_S, KEEPS, 0.6, False),
                (box + "half lines", "half lines", says(refused, bot.BOX_SILENT), 2.1, DISARMS, 2.5, False),
                (box + "presses lost", "loses presses", PRESSES_LOST, STALE_S, DISARMS, 0.6, False),
                (box + "every button bounces", "bounces", (), 0.0, KEEPS, 0.6, False),
                (box + "every line twice", "all twice", says(hw.BOX_PRESSES_REPEATED), STALE_S, KEEPS, 0.6, False),
                ("fire button stuck", "stuck fire", (), 0.0, KEEPS, 0.6, False),
                ("arm button stuck", "stuck arm", says(bot.NOT_ARMED, bot.NOT_SETTLED), STALE_S, ITSELF, 0.6, False),
                ("reject button stuck", "stuck reject", (), 0.0, KEEPS, 0.6, False))]


def _near() -> list[Row]:
    return [
        Row("ticks stand still for 0.6 s", "time", fault.Time("late ticks"), says(bot.TICKS_STALLED), 0.8, REARM),
        Row("wall clock set forward by an hour", "time", fault.Time("clock +1 h"), (), 0.0, KEEPS),
        Row("wall clock set back by an hour", "time", fault.Time("clock -1 h"), (), 0.0, KEEPS),
        *(Row(words, "disk", fault.Disk(what), _not_recording(*causes), within_s, after, lasts_s, True)
          for words, what, causes, within_s, after, lasts_s in (
              ("disk full", "full", (bot.DISK_FULL, bot.DISK_ERROR), 0.4, ITSELF, 1.0),
              ("disk turns read-only", "turns read-only", (bot.DISK_ERROR,), 0.4, ITSELF, 1.0),
              ("disk hangs for 4 s", "hangs", (bot.DISK_UNRESPONSIVE,), 3.0, ITSELF, 4.0),
              ("folder of the images gone", "loses a folder", (bot.DISK_ERROR,), 0.5, KEEPS, 1.5))),
        *(Row(f"model: {words}", "model", fault.Model(what), reason, 0.05, after)
          for words, what, reason, after in (
              ("raises", "raises", says(bot.MODEL_FAILED, error="RuntimeError"), ITSELF),
              ("gives no number", "no number", says(bot.MODEL_OUTSIDE_DOMAIN, bot.MODEL_NOT_FINITE), ITSELF),
              ("gives NaN", "not a number", says(bot.MODEL_NOT_FINITE), ITSELF),
              ("says it is outside its domain", "outside", says(bot.MODEL_OUTSIDE_DOMAIN), ITSELF),
              ("says this is novel", "novel", says(bot.MODEL_OUTSIDE_DOMAIN, novelty=3.0), ITSELF),
              ("gives a low probability", "doubts", says(bot.MODEL_BELOW_THRESHOLD), ITSELF))),
        Row("model: takes 0.3 s a tick", "model", fault.Model("slow"), says(bot.TICKS_STALLED), 0.8, REARM, 1.5),
        Row("devices' process stopped for 0.6 s (SIGSTOP)", "process", fault.Process("devices", "stop"), SILENT,
            STALE_S),                 # their watchdogs stand still with it
        Row("devices' process killed, started again", "process", fault.Process("devices", "kill"),
            says(bot.DEVICE_STALE, bot.CAN_LOST), STALE_S, DISARMS, lasts_s=1.0),
        Row("control process stopped for 0.6 s (SIGSTOP)", "process", fault.Process("control", "stop"),
            says(bot.TICKS_STALLED), 0.8, REARM),
        Row("control process killed, started again", "process", fault.Process("control", "kill"), (), 0.25, REARM,
            lasts_s=2.0, buses=("slcan", "socketcan")),
        Row("vision process stopped for 1 s (SIGSTOP)", "process", fault.Process("vision", "stop"),
            says(bot.TARGET_STALE, bot.CAMERA_LOST), SEEN_S, lasts_s=1.0, real=True),
        Row("vision process killed, which starts again", "process", fault.Process("vision", "kill"),
            NO_VISION, 0.3, lasts_s=0.3, real=True),
        Row("recorder process stopped for 3 s (SIGSTOP)", "process", fault.Process("recorder", "stop"),
            _not_recording(bot.RECORDER_UNRESPONSIVE), 2.0, lasts_s=3.0, real=True),
        Row("recorder process killed, all started again", "process", fault.Process("recorder", "kill"), (), 1.0,
            REARM, lasts_s=2.0, buses=("slcan", "socketcan"))]


# --- SPARKs

FAULTS_S = 1.15                       # what a SPARK says of its faults may be 1 s old
TOLD_S = 0.4                          # STATUS_1 comes every 0.25 s
BAD_RPM = says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, signal="velocity_rpm"))
STATUSES = {"STATUS_0": (says(bot.DEVICE_HEARTBEAT_STALE), BEAT_S, 0.6),
            "STATUS_1": (says(hw.SPARK_FAULTS_STALE, bot.DEVICE_FAULTS_STALE, bot.DEVICE_FAULTS_NEVER_RECEIVED),
                         FAULTS_S, 1.6),
            "STATUS_2": (SILENT, STALE_S, 0.6)}
TROUBLES = (("flywheel_b", "too hot", "too hot", hw.ERROR_OVER_TEMPERATURE),
            ("hood", "gate driver fault", "gate driver", hw.ERROR_GATE_DRIVER),
            ("feeder", "sensor fault", "sensor", hw.ERROR_SENSOR),
            ("flywheel_a", "a fault that came and went (sticky)", "came and went", hw.ERROR_GATE_DRIVER))
WHOSE = {"motor", "device"}
RESET, LOCKED = (says(bot.MOTOR_ERROR, errors=(error(),)) for error in (hw.ERROR_HAS_RESET, hw.ERROR_LOCKED))


def _spark_frames(launcher: str, names: tuple[str, ...]) -> list[Row]:
    """Of devices that speak SPARK, whoever drives them."""
    rows = [_spark(launcher, name, f"no {message}, the others go on", "lost", Device(name, "silent", message), reason,
                 within_s, lasts_s=lasts_s)
            for name in names for message, (reason, within_s, lasts_s) in STATUSES.items()]
    rows += [_spark(launcher, name, "no frames", "lost", Device(name, "silent"), SILENT, STALE_S) for name in names]
    for name in names[:1]:
        rows += [_spark(launcher, name, "status frames cut short", "short", Device(name, "truncated", length=5),
                      says(bot.BAD_FRAME, cause=says(hw.FRAME_LENGTH, bytes=5)), STALE_S),
                 _spark(launcher, name, "speed is not a number", "not finite",
                      Device(name, "overwritten", "STATUS_2", at=0, data=NAN), BAD_RPM, STALE_S),
                 _spark(launcher, name, "speed of 1e20", "implausible",
                      Device(name, "overwritten", "STATUS_2", at=0, data=HUGE), BAD_RPM, STALE_S),
                 _spark(launcher, name, "status frames held back, then all at once", "late", Device(name, "held"),
                      SILENT, STALE_S),
                 _spark(launcher, name, "encoder stuck", "stuck", Device(name, "stuck", "STATUS_2"),
                      says(hw.ENCODER_STUCK), STALE_S, REARM if launcher == "spark" else ITSELF)]
    whose = "SPARKs" if launcher == "spark" else "advice only"
    rows.append(Row(f"{whose}, both flywheel motors: say the speed that is wanted, and turn at another",
                    "contradiction", tell_wanted("STATUS_2", 0, math.tau / 60.0),
                    says(bot.AXIS_LATCHED) if launcher == "spark" else TURNS_AT, 1.0,
                    REARM if launcher == "spark" else ITSELF, 2.0, first=True, launcher=launcher))
    return rows


def _spark_inside() -> list[Row]:
    rows = [_spark("spark", name, words, "fault", Inside(name, what), says(bot.MOTOR_ERROR, errors=(error(),)), TOLD_S,
                 REARM) for name, words, what, error in TROUBLES]
    rows += [_spark("spark", name, "reset, its settings forgotten", "settings lost", Inside(name, "settings lost"),
                  (*SILENT, *RESET), TOLD_S, REARM) for name in ("flywheel_a", "hood")]
    rows += [_spark("spark", name, "loses its power", "power", Device(name, "unpowered"), SILENT, STALE_S, REARM)
             for name in ("flywheel_a", "hood")]
    return [
        *rows,
        _spark("spark", "flywheel_a", "cable out, and in again", "unplugged", Device("flywheel_a", "unplugged"),
             SILENT, STALE_S),
        _spark("spark", "flywheel_a", "receives no frames, no heartbeat enables it", "heartbeat",
             Device("flywheel_a", "deaf"), says(hw.SPARK_NOT_DRIVING), 0.4),
        _spark("spark, long feed", "feeder", "receives no frames when it is to feed", "heartbeat",
             Device("feeder", "deaf"), says(hw.SPARK_NOT_DRIVING), 1.0, REARM, 3.0),
        _spark("spark", "flywheel_b", "locked to a competition controller, until its power is cycled", "heartbeat",
             Inside("flywheel_b", "locked"), LOCKED, STALE_S, REARM),
        _spark("spark", "hood", "limit switch sticks closed, hood is up", "limit switch",
             Inside("hood", "switch closed"), says(bot.AXIS_LATCHED, joint="hood"), 0.2, REARM),
        _spark("spark", "hood", "limit switch never closes, from the start", "limit switch",
             Inside("hood", "switch open"), says(bot.HOOD_NOT_HOMED), 1.0, REARM, 4.0, first=True),
        _spark("spark", "flywheel_a", "firmware 24 from the start, then updated", "firmware",
             Inside("flywheel_a", "old firmware"), says(hw.SPARK_FIRMWARE_UNSUPPORTED, version="24.0.1"), 0.5, REARM,
             3.0, first=True),
        _spark("spark", "hood", "firmware 27 from the start, then exchanged", "firmware",
               Inside("hood", "new firmware"), says(hw.SPARK_FIRMWARE_UNSUPPORTED, version="27.0.0"), 0.5, REARM, 3.0,
               first=True)]


def _spark_wires() -> list[Row]:
    return [
        Row("SPARKs: a second device with the id of flywheel motor 1", "wrong id", fault.Wire("two sparks with one id"),
            says(hw.DUPLICATE_ID), 1.2, REARM, lasts_s=2.0, launcher="spark"),
        Row("SPARKs: another host's heartbeat disables them", "strangers", fault.Wire("another host's heartbeat"),
            says(hw.FOREIGN_HOST), STALE_S, launcher="spark"),
        Row("SPARKs: a competition controller on the bus locks them all", "heartbeat",
            fault.Wire("competition controller"), LOCKED, STALE_S, REARM, launcher="spark"),
        Row("SPARKs: nothing on the bus for 2.5 s", "bus-off", fault.Wire("silent"), SILENT, STALE_S, lasts_s=2.5,
            real=True, launcher="spark"),
        Row("SPARKs: control process stopped for 0.6 s (SIGSTOP)", "process", fault.Process("control", "stop"),
            says(bot.TICKS_STALLED), 0.8, launcher="spark"),
        Row("SPARKs: control process killed, started again", "process", fault.Process("control", "kill"), (), 0.25,
            REARM, lasts_s=2.0, buses=("slcan", "socketcan"), launcher="spark")]


def _advice() -> list[Row]:
    return [
        *_spark_frames("advisory", ("flywheel_a",)),
        _spark("advisory", "hood", "no frames", "lost", Device("hood", "silent"), SILENT, STALE_S),
        _spark("advisory", "feeder", "gate driver fault", "fault", Inside("feeder", "gate driver"),
             says(bot.MOTOR_ERROR, errors=(hw.ERROR_GATE_DRIVER(),)), TOLD_S),
        _spark("advisory", "hood_encoder", "no frames", "lost", Device("hood_encoder", "silent"), SILENT, STALE_S),
        Row("advice only: its own controller commands and keeps its heartbeat", "strangers",
            fault.Wire("competition controller"), (), 0.0, KEEPS, launcher="advisory")]


def _spark(launcher: str, name: str, words: str, family: str, breaking: Device | Inside, reason: Signs, within_s: float,
         after: str = ITSELF, lasts_s: float = 0.6, first: bool = False) -> Row:
    whose = "advice only" if launcher == "advisory" else "SPARK"
    signs = tuple(sign for one in reason for sign in (of(DEVICES[name], (one,)) if one.code.params.keys() & WHOSE
                                                      else (one,)))
    return Row(f"{whose}, {DEVICES[name]}: {words}", family, breaking, signs, within_s, after, lasts_s, first=first,
               launcher=launcher)


# --- NetworkTables

AT_ONCE_S, OLD_S = 2.0 / nt.HZ, nt.FRESH_S + 3.0 / nt.HZ
JUMPS_S = 0.1 + 2.0 / nt.HZ              # it is away every other tenth of a second
BATTERY_OLD_S = 10.0 * nt.FRESH_S + 2.0 / nt.HZ
GONE = ("disappears", "not a number")
LAST_S = nt.BEGIN_S + 2.0                # of a trouble: longer than a battery may stand still
MISSING, IMPOSSIBLE = says(bot.KEY_MISSING), says(bot.CAMERA_LOST)
JUMPED, CAMERA_JUMPED = says(bot.KEY_JUMPED), says(bot.CAMERA_LOST, cause=says(bot.KEY_JUMPED))
UNKNOWN = says(bot.ROBOT_SPEED_UNKNOWN)
PLAIN = {"distance": "/Vision/Distance", "hood angle": "/Hood/Angle", "wheel speed": "/Shooter/RPM",
         "battery": "/Battery"}


def _key(name: str, key: str, old: Signs, old_s: float, jumped: Signs, gone: Signs) -> list[Row]:
    return [Row(f"advise: {name} {what}", "key", fault.Key(what, key), reason, within_s, lasts_s=LAST_S,
                buses=("virtual",), launcher="NetworkTables")
            for what, reason, within_s in (("freezes", old, old_s), ("jumps", jumped, JUMPS_S),
                                           ("disappears", gone, AT_ONCE_S), ("not a number", gone, AT_ONCE_S))]


def _some(rows: list[Row], *whats: str) -> list[Row]:
    """Those of these troubles: what may stand still, or change at once, is well."""
    return [row for row in rows if row.name.endswith(whats)]


def _stale(device: str) -> Signs:
    return says(bot.DEVICE_STALE, device=device)


KEY_ROWS = (
    *_key("distance", "/Vision/Distance", says(bot.TARGET_STALE), OLD_S, JUMPED, MISSING),
    *_key("hood angle", "/Hood/Angle", _stale("hood angle"), OLD_S, JUMPED, MISSING),
    *_key("wheel speed", "/Shooter/RPM", _stale("wheel speed"), OLD_S, JUMPED, MISSING),
    *_key("battery", "/Battery", _stale("battery"), BATTERY_OLD_S, JUMPED, MISSING),
    *_key("PhotonVision's target", nt.POSE, says(bot.TARGET_STALE), OLD_S, CAMERA_JUMPED, IMPOSSIBLE),
    *_some(_key("PhotonVision's heartbeat", f"{nt.FRONT}/heartbeat", FROZEN, OLD_S, FROZEN, IMPOSSIBLE),
           "freezes", *GONE),
    *_some(_key("PhotonVision's hasTarget", f"{nt.FRONT}/hasTarget", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE), *GONE),
    *_some(_key("PhotonVision's latency", f"{nt.FRONT}/latencyMillis", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE),
           *GONE),
    *_key("Limelight's target", f"{nt.LIMELIGHT}/targetpose_cameraspace", says(bot.TARGET_STALE), OLD_S, CAMERA_JUMPED,
           IMPOSSIBLE),
    *_some(_key("Limelight's heartbeat", f"{nt.LIMELIGHT}/hb", FROZEN, OLD_S, FROZEN, IMPOSSIBLE), "freezes", *GONE),
    *(row for name in ("tv", "tid", "cl", "stddevs") for row in _some(
        _key(f"Limelight's {name}", f"{nt.LIMELIGHT}/{name}", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE), *GONE)),
    *_key("robot's velocity", "/Drive/Speeds", UNKNOWN, OLD_S, UNKNOWN, UNKNOWN),
    *_key("robot's heading", nt.HEADING, UNKNOWN, OLD_S, UNKNOWN, UNKNOWN),
    *_some(_key("robot's loop", nt.ALIVE, UNKNOWN, OLD_S, UNKNOWN, UNKNOWN), "freezes", *GONE),
    *(Row(f"advise: {name} impossible", "key", fault.Key("impossible", key), says(bot.NT_VALUE_IMPOSSIBLE), AT_ONCE_S,
          lasts_s=LAST_S, buses=("virtual",), launcher="NetworkTables") for name, key in PLAIN.items()),
    Row("advise: server gone", "key", fault.Key("server gone", ""), says(bot.NT_LOST), AT_ONCE_S, lasts_s=LAST_S,
        buses=("virtual",), launcher="NetworkTables"))


# --- motion

GONE_S, WRONG_S, REST_S = 0.12, 0.08, 0.25   # readings stop; freeze under torque or jump; are wrong since rest
NEVER_S = 0.01                        # not driven at all
SWITCH_S = 0.15                       # an ODrive is asked for its switch every 0.05 s
TRAVEL_DEG, COAST_DEG = 5.0, 8.0      # the second from half as much again as its speed limit
HOMING_S = 0.5                        # until encoder and screw are 1.5 degrees apart, from rest
WHEELS = ("flywheel_a", "flywheel_b")

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
    **dict.fromkeys(("overspeed", "repeated", "jam", "homing"), RELEASED),
    "encoders": ("hood_encoders_disagree", *RELEASED),
    "dropped": ("hood_push_dropped",),
    "switch": (),
}


def _wheels() -> Iterator[Row]:
    for name, what, names, code in (
            ("both encoders read 0", "zero", WHEELS, "no response"),
            ("both speeds read 0, positions go on", "speed zero", WHEELS, "disagree"),
            ("both speeds read 40 % too low", "speed x 0.6", WHEELS, "disagree"),
            ("both positions read 40 % too low", "position x 0.6", WHEELS, "disagree"),
            ("both encoders are reversed", "reversed", WHEELS, "direction"),
            ("both encoders are big-endian", "big-endian", WHEELS, "any"),
            ("both motors turn the other way", "wheels backwards", (), "direction"),
            ("motors turn against each other", "motor 2 backwards", (), "no response"),
            ("the belt is jammed", "wheels jam", (), "no response"),
            ("the motors have no power", "wheels have no power", (), "no response")):
        yield _wheel(f"{name}, since rest", Motion(what, names, "start", "wheels", "push", code), REST_S,
                     EITHER if what == "big-endian" else REARM, 3.0)
    yield _wheel("no estimates of motor 1 since the start",
                 Motion("silent", WHEELS[:1], "start", "wheels", "push", "stale"), NEVER_S, ITSELF, 2.0)
    for words, names in (("both encoders", WHEELS), ("motor 1's encoder", WHEELS[:1])):
        for name, what, since, code, within_s, after in (
                ("stop, heartbeats go on", "silent", "reading", "stale", GONE_S, ITSELF),
                ("freeze", "frozen", "fault", "frozen", WRONG_S, EITHER),
                ("jump to 0", "zero", "fault", "jump", WRONG_S, REARM),
                ("jump to half the speed", "half", "fault", "jump", WRONG_S, REARM),
                ("turn round", "reversed", "fault", "direction", WRONG_S, REARM),
                ("turn big-endian", "big-endian", "fault", "any", WRONG_S, EITHER),
                ("are not numbers", "not a number", "fault", "faulty", GONE_S, ITSELF)):
            yield _wheel(f"{words}: readings {name} while spinning up",
                         Motion(what, names, "spinning", "wheels", since, code), within_s, after, 3.0)
    yield _wheel("motor 2 keeps its torque, whatever it is asked for",
                 Motion("keeps its torque", WHEELS[1:], "spinning", "wheels", "fault", "overspeed"), 1.0, REARM, 3.0)
    # three gaps in 10 s; the third begins 2.4 s after the first, and latches
    yield _wheel("motor 1's readings stop for 0.25 s, again and again",
                 Motion("stutters", WHEELS[:1], "settled", "wheels", "fault", "repeated"), 2.4 + GONE_S, REARM, 7.0)
    yield _wheel("no target and no request for more than 10 s",
                 Motion("no target", (), "settled", "wheels", "fault", "none"), 10.2, ITSELF, 13.0)


def _hood() -> Iterator[Row]:
    encoder = ("hood_encoder",)
    for name, what, names, when, since, code, within_s, after in (
            ("no angles", "silent", encoder, "hood rises", "reading", "stale", GONE_S, ITSELF),
            ("its encoder is frozen", "frozen", encoder, "hood rises", "fault", "frozen", REST_S, EITHER),
            ("its encoder jumps by 10 degrees", "10 degrees off", encoder, "hood rises", "fault", "encoders", REST_S,
             EITHER),
            ("its magnet is lost", "magnet lost", encoder, "hood rises", "fault", "faulty", GONE_S, ITSELF),
            ("no estimates of its motor", "silent", ("hood",), "hood rises", "reading", "stale", GONE_S, ITSELF),
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
    yield _hooded("is jammed 0.6 degrees below its set point: a small push is dropped",
                  Motion("hood jams", (), "hood is near", "hood", "push", "dropped", travel_deg=TRAVEL_DEG), 0.5, REARM)
    yield _hooded("its limit switch sticks closed while it rises",
                  Motion("switch closed", (), "hood rises", "hood", "fault", "homing", travel_deg=TRAVEL_DEG),
                  SWITCH_S, REARM)
    # down from where it is found, and the stop's push, and once more
    yield _hooded("its limit switch never closes", Motion("switch dead", (), "start", "hood", "push", "homing", 2),
                  1.45, REARM)
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
    # 1.1 times the travel at the speed limit; three times as long as the travel takes
    yield _hooded("has no encoder, and its screw has come loose of the motor: homing ends by travel",
                  Motion("hood comes loose", (), "start", "hood", "push", "homing", start_deg=60.0, has_encoder=False),
                  5.0, REARM, 9.0)
    yield _hooded("creeps from 60 degrees: homing ends by time",
                  Motion("hood creeps", (), "start", "hood", "push", "homing", start_deg=60.0), 9.1, REARM, 10.5)
    yield _hooded("has no encoder, homes from 60 degrees and rises",
                  Motion("nothing", (), "start", "", "fault", "none", start_deg=60.0, has_encoder=False), 0.0, KEEPS,
                  9.0)
    yield _hooded("its screw is stiff", Motion("hood is stiff", (), "start", "", "fault", "none"), 0.0, KEEPS, 6.0)
    yield _hooded("its encoder reads 0.8 degrees low, set point at the soft limit",
                  Motion("encoder 0.8 degrees low", (), "start", "", "fault", "none", hood_deg=60.0, high_deg=60.0),
                  0.0, KEEPS, 6.0)
    yield _hooded("rises from its switch to 70 degrees",
                  Motion("nothing", (), "start", "", "fault", "none", hood_deg=70.0), 0.0, KEEPS, 6.0)


def _moved(part: str, words: str, motion: Motion, within_s: float, after: str, lasts_s: float = 3.0) -> Row:
    return Row(f"motion, {part}: {words}", "motion", motion, (), within_s, after, lasts_s, first=motion.when == "start")


_wheel, _hooded = partial(_moved, "wheels"), partial(_moved, "hood")


def _with_sparks(row: Row) -> Row:
    """The same of a launcher with SPARKs."""
    return replace(row, name=row.name.replace("motion, ", "motion, SPARK "), launcher="spark")


ODRIVE_ROWS = (*_wheels(), *_hood())
# Of an ODrive's heartbeat, every 0.1 s, comes that it has given up. A SPARK's switch is in the frame that says it lives
ONLY_ODRIVE = (_wheel("motor 2 gives up with an error while spinning up",
                      Motion("gives up", WHEELS[1:], "spinning", "wheels", "fault", "faulty"), 0.1 + GONE_S, EITHER,
                      3.0),
               # an emulated SPARK brakes by a torque, which such a world would turn round, too
               _hooded("its motor turns the other way, since rest",
                       Motion("hood backwards", (), "start", "hood", "push", "any", travel_deg=TRAVEL_DEG), REST_S,
                       REARM),
               # a SPARK, whose readings are younger, brakes it in time; an idle ODrive lets it coast
               _hooded("its driver gives full torque, however little it is asked for, since it rises",
                       Motion("hood is strong", (), "hood starts", "hood", "fault", "overspeed",
                              travel_deg=COAST_DEG, most_deg_s=40.0), 0.08, REARM),
               _hooded("its limit switch never answers",
                       Motion("switch never answers", ("hood",), "start", "hood", "push", "switch"), NEVER_S, ITSELF))
MOTION_ROWS = (*ODRIVE_ROWS, *ONLY_ODRIVE, *map(_with_sparks, ODRIVE_ROWS))

ROWS = (*_frames(), *_devices(), *_wires(), *_camera(), *_box(), *_near(),
        *_spark_frames("spark", ("flywheel_a", "hood", "feeder")), *_spark_inside(), *_spark_wires(), *_advice(),
        *KEY_ROWS, *MOTION_ROWS)
