"""The catalogue: what is broken, what is to come of it, how soon, and what it takes to fire again."""

import math
import struct

from benchmarks.matrix.breaking import Box, Camera, Device, Disk, Inside, Model, Process, Start, Time, Wire
from benchmarks.matrix.key_rows import KEY_ROWS
from benchmarks.matrix.motion_rows import MOTION_ROWS
from benchmarks.matrix.row import (
    AXES,
    BEAT_S,
    DEVICES,
    DISARMS,
    HUGE,
    ITSELF,
    KEEPS,
    NAN,
    REARM,
    REFUSED,
    SEEN_S,
    STALE_S,
    Row,
    tell_wanted,
)
from benchmarks.matrix.signs import Signs, of, says
from benchmarks.matrix.spark_rows import SPARK_ROWS
from truearc.hw import fault_codes as hw
from truearc.hw.reason import Code
from truearc.robot import reasons as bot

SILENT = says(bot.DEVICE_STALE)
BAD_SPEED = says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, signal="velocity_rev_s"))
WATCHDOG, SPINOUT = (says(bot.MOTOR_ERROR, errors=(error(),))
                     for error in (hw.ERROR_WATCHDOG_EXPIRED, hw.ERROR_SPINOUT))
FROZEN = says(bot.CAMERA_LOST, cause=says(hw.CAMERA_FROZEN))
NO_VISION = says(bot.CAMERA_LOST, cause=says(hw.PROCESS_KILLED, hw.PROCESS_STARTING, process="vision"))
PRESSES_LOST = says(bot.DISARMED_BY_BOX, cause=says(hw.BOX_PRESSES_LOST))


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
                 says(bot.FLYWHEELS_DIFFER), STALE_S),
             Row("hood encoder: reads another angle", "implausible",
                 Device("hood_encoder", "overwritten", "POSITION_OUTPUT", at=4, data=b"\0\x40"),
                 says(bot.HOOD_ENCODERS_DISAGREE), STALE_S)]
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
        Row("another host commands a torque", "another host", Wire("another host commands"),
            says(hw.FOREIGN_HOST, frame="0x02e"), STALE_S),
        Row("another host stops a motor", "another host", Wire("another host stops"),
            says(hw.FOREIGN_HOST, frame="0x022"), STALE_S, REARM),
        Row("a second device with the id of flywheel motor 1", "wrong id", Wire("two with one id"),
            says(bot.FLYWHEELS_DIFFER, hw.DUPLICATE_ID), 0.3),
        Row("unknown frames", "strangers", Wire("strangers"), (), 0.0, KEEPS),
        Row("remote frames of strangers", "strangers", Wire("questions"), (), 0.0, KEEPS),
        Row("garbled lines (slcan), garbled frames", "garbled", Wire("garbled"), (), 0.0, KEEPS),
        Row("controller bus-off", "bus-off", Wire("bus off"),
            says(bot.CAN_LOST, hw.CAN_REOPENED, bot.DEVICE_STALE), STALE_S, REARM, real=True),
        Row("nothing on the bus for 2.5 s", "bus-off", Wire("silent"), SILENT, STALE_S, REARM, lasts_s=2.5,
            real=True),
        Row("adapter pulled out, and in again", "adapter", Wire("adapter out"), says(bot.CAN_LOST), STALE_S, REARM,
            lasts_s=1.5, real=True),
        Row("the transmit queue is full", "queue full", Wire("queue full"), says(bot.FRAMES_NOT_SENT), STALE_S, REARM),
        Row("the receive queue overruns (64 frames), the tick stalls", "queue full", Wire("overrun"),
            says(hw.CAN_OVERRUN), 0.8, REARM, lasts_s=0.6, real=True)]


def _camera() -> list[Row]:
    seen = says(bot.TARGET_STALE)
    return [Row(f"camera: {words}", "camera", Camera(what), reason, within_s, after, lasts_s, real)
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
        Row("camera: another place, reached while fire is asked for", "camera", Camera("drives off"),
            says(bot.NOT_AT_PLACE), 1.5, ITSELF, 5.0, first=True)]


def _box() -> list[Row]:
    return [
        Row("button box: pulled out, and in again", "box", Box("unplugged"), says(bot.BOX_LOST), STALE_S, DISARMS,
            real=True),
        Row("button box: silent for 3 s", "box", Box("silent"), says(bot.BOX_SILENT), 2.1, DISARMS, lasts_s=3.0),
        Row("button box: loses its power", "box", Box("no power"), says(bot.BOX_SILENT), 2.1, DISARMS, lasts_s=2.5),
        Row("button box: garbage between its lines", "box", Box("garbage"), says(hw.BOX_LINES_REFUSED), STALE_S, KEEPS),
        Row("button box: half lines", "box", Box("half lines"), says(hw.BOX_LINES_REFUSED, bot.BOX_SILENT), 2.1,
            DISARMS, lasts_s=2.5),
        Row("button box: presses lost", "box", Box("loses presses"), PRESSES_LOST, STALE_S, DISARMS),
        Row("button box: every button bounces", "box", Box("bounces"), (), 0.0, KEEPS),
        Row("button box: every line twice", "box", Box("all twice"), says(hw.BOX_PRESSES_REPEATED), STALE_S, KEEPS),
        Row("fire button stuck", "box", Box("stuck fire"), (), 0.0, KEEPS),
        Row("arm button stuck", "box", Box("stuck arm"), says(bot.NOT_ARMED, bot.NOT_SETTLED), STALE_S),
        Row("reject button stuck", "box", Box("stuck reject"), (), 0.0, KEEPS)]


def _near() -> list[Row]:
    return [
        Row("ticks stand still for 0.6 s", "time", Time("late ticks"), says(bot.TICKS_STALLED), 0.8, REARM),
        Row("wall clock set forward by an hour", "time", Time("clock +1 h"), (), 0.0, KEEPS),
        Row("wall clock set back by an hour", "time", Time("clock -1 h"), (), 0.0, KEEPS),
        Row("disk full", "disk", Disk("full"), _not_recording(bot.DISK_FULL, bot.DISK_ERROR), 0.4, real=True,
            lasts_s=1.0),
        Row("disk turns read-only", "disk", Disk("turns read-only"), _not_recording(bot.DISK_ERROR), 0.4, real=True,
            lasts_s=1.0),
        Row("disk hangs for 4 s", "disk", Disk("hangs"), _not_recording(bot.DISK_UNRESPONSIVE), 3.0, real=True,
            lasts_s=4.0),
        Row("folder of the images gone", "disk", Disk("loses a folder"), _not_recording(bot.DISK_ERROR), 0.5, KEEPS,
            real=True, lasts_s=1.5),
        Row("sessions folder cannot be made", "disk", Start("no folder"), (), 0.0, REFUSED,
            refusal="File exists|Not a directory"),
        *(Row(f"model: {words}", "model", Model(what), reason, 0.05, after)
          for words, what, reason, after in (
              ("raises", "raises", says(bot.MODEL_FAILED, error="RuntimeError"), ITSELF),
              ("gives no number", "no number", says(bot.MODEL_OUTSIDE_DOMAIN, bot.MODEL_NOT_FINITE), ITSELF),
              ("gives NaN", "not a number", says(bot.MODEL_NOT_FINITE), ITSELF),
              ("says it is outside its domain", "outside", says(bot.MODEL_OUTSIDE_DOMAIN), ITSELF),
              ("says this is novel", "novel", says(bot.MODEL_OUTSIDE_DOMAIN, novelty=3.0), ITSELF),
              ("gives a low probability", "doubts", says(bot.MODEL_BELOW_THRESHOLD), ITSELF))),
        Row("model: takes 0.3 s a tick", "model", Model("slow"), says(bot.TICKS_STALLED), 0.8, REARM, lasts_s=1.5),
        *(Row(f"model file: {what}", "model", Start(what), (), 0.0, REFUSED, refusal=refusal) for what, refusal in (
            ("corrupted", "damaged or altered|not a usable ONNX"), ("truncated", "not a usable ONNX"),
            ("foreign", "contract|damaged"), ("no number", "gives no probability"),
            ("no model", "No such file"), ("policy model, no file", "gate.policy is 'model', so --gate is needed"))),
        Row("devices' process stopped for 0.6 s (SIGSTOP)", "process", Process("devices", "stop"), SILENT,
            STALE_S),                 # their watchdogs stand still with it
        Row("devices' process killed, started again", "process", Process("devices", "kill"),
            says(bot.DEVICE_STALE, bot.CAN_LOST), STALE_S, DISARMS, lasts_s=1.0),
        Row("control process stopped for 0.6 s (SIGSTOP)", "process", Process("control", "stop"),
            says(bot.TICKS_STALLED), 0.8, REARM),
        Row("control process killed, started again", "process", Process("control", "kill"), (), 0.25, REARM,
            lasts_s=2.0, buses=("slcan", "socketcan")),
        Row("vision process stopped for 1 s (SIGSTOP)", "process", Process("vision", "stop"),
            says(bot.TARGET_STALE, bot.CAMERA_LOST), SEEN_S, lasts_s=1.0, real=True),
        Row("vision process killed, which starts again", "process", Process("vision", "kill"),
            NO_VISION, 0.3, lasts_s=0.3, real=True),
        Row("recorder process stopped for 3 s (SIGSTOP)", "process", Process("recorder", "stop"),
            _not_recording(bot.RECORDER_UNRESPONSIVE), 2.0, lasts_s=3.0, real=True),
        Row("recorder process killed, all started again", "process", Process("recorder", "kill"), (), 1.0,
            REARM, lasts_s=2.0, buses=("slcan", "socketcan"))]


ROWS = tuple([*_frames(), *_devices(), *_wires(), *_camera(), *_box(), *_near(), *SPARK_ROWS, *KEY_ROWS,
              *MOTION_ROWS])
