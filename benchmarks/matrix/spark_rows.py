"""The catalogue for launchers with SPARKs: its own, and one that another controller drives (driver "advisory")."""

import math

from benchmarks.matrix.breaking import Device, Inside, Process, Wire
from benchmarks.matrix.row import BEAT_S, DEVICES, HUGE, ITSELF, KEEPS, NAN, REARM, STALE_S, TURNS_AT, Row, tell_wanted
from benchmarks.matrix.signs import Signs, of, says
from truearc.hw import fault_codes as hw
from truearc.robot import reasons as bot

FAULTS_S = 1.15                       # what a SPARK says of its faults may be 1 s old
TOLD_S = 0.4                          # STATUS_1 comes every 0.25 s
SILENT = says(bot.DEVICE_STALE)
BAD_SPEED = says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, signal="velocity_rpm"))
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


def _frames(launcher: str, names: tuple[str, ...]) -> list[Row]:
    """Of devices that speak SPARK, whoever drives them."""
    rows = [_row(launcher, name, f"no {message}, the others go on", "lost", Device(name, "silent", message), reason,
                 within_s, lasts_s=lasts_s)
            for name in names for message, (reason, within_s, lasts_s) in STATUSES.items()]
    rows += [_row(launcher, name, "no frames", "lost", Device(name, "silent"), SILENT, STALE_S) for name in names]
    for name in names[:1]:
        rows += [_row(launcher, name, "status frames cut short", "short", Device(name, "truncated", length=5),
                      says(bot.BAD_FRAME, cause=says(hw.FRAME_LENGTH, bytes=5)), STALE_S),
                 _row(launcher, name, "speed is not a number", "not finite",
                      Device(name, "overwritten", "STATUS_2", at=0, data=NAN), BAD_SPEED, STALE_S),
                 _row(launcher, name, "speed of 1e20", "implausible",
                      Device(name, "overwritten", "STATUS_2", at=0, data=HUGE), BAD_SPEED, STALE_S),
                 _row(launcher, name, "status frames held back, then all at once", "late", Device(name, "held"),
                      SILENT, STALE_S),
                 _row(launcher, name, "encoder stuck", "stuck", Device(name, "stuck", "STATUS_2"),
                      says(hw.ENCODER_STUCK), STALE_S, REARM if launcher == "spark" else ITSELF)]
    whose = "SPARKs" if launcher == "spark" else "advice only"
    rows.append(Row(f"{whose}, both flywheel motors: say the speed that is wanted, and turn at another",
                    "contradiction", tell_wanted("STATUS_2", 0, math.tau / 60.0),
                    says(bot.AXIS_LATCHED) if launcher == "spark" else TURNS_AT, 1.0,
                    REARM if launcher == "spark" else ITSELF, 2.0, first=True, launcher=launcher))
    return rows


def _inside() -> list[Row]:
    rows = [_row("spark", name, words, "fault", Inside(name, what), says(bot.MOTOR_ERROR, errors=(error(),)), TOLD_S,
                 REARM) for name, words, what, error in TROUBLES]
    rows += [_row("spark", name, "reset, its settings forgotten", "settings lost", Inside(name, "settings lost"),
                  (*SILENT, *RESET), TOLD_S, REARM) for name in ("flywheel_a", "hood")]
    rows += [_row("spark", name, "loses its power", "power", Device(name, "unpowered"), SILENT, STALE_S, REARM)
             for name in ("flywheel_a", "hood")]
    return [
        *rows,
        _row("spark", "flywheel_a", "cable out, and in again", "unplugged", Device("flywheel_a", "unplugged"),
             SILENT, STALE_S),
        _row("spark", "flywheel_a", "receives no frames, no heartbeat enables it", "heartbeat",
             Device("flywheel_a", "deaf"), says(hw.SPARK_NOT_DRIVING), 0.4),
        _row("spark, long feed", "feeder", "receives no frames when it is to feed", "heartbeat",
             Device("feeder", "deaf"), says(hw.SPARK_NOT_DRIVING), 1.0, REARM, 3.0),
        _row("spark", "flywheel_b", "locked to a competition controller, until its power is cycled", "heartbeat",
             Inside("flywheel_b", "locked"), LOCKED, STALE_S, REARM),
        _row("spark", "hood", "limit switch sticks closed, hood is up", "limit switch",
             Inside("hood", "switch closed"), says(bot.AXIS_LATCHED, joint="hood"), 0.2, REARM),
        _row("spark", "hood", "limit switch never closes, from the start", "limit switch",
             Inside("hood", "switch open"), says(bot.HOOD_NOT_HOMED), 1.0, REARM, 4.0, first=True),
        _row("spark", "flywheel_a", "firmware 24 from the start, then updated", "firmware",
             Inside("flywheel_a", "old firmware"), says(hw.SPARK_FIRMWARE_UNSUPPORTED, version="24.0.1"), 0.5, REARM,
             3.0, first=True),
        _row("spark", "hood", "firmware 27 from the start, then exchanged", "firmware", Inside("hood", "new firmware"),
             says(hw.SPARK_FIRMWARE_UNSUPPORTED, version="27.0.0"), 0.5, REARM, 3.0, first=True)]


def _wires() -> list[Row]:
    return [
        Row("SPARKs: a second device with the id of flywheel motor 1", "wrong id", Wire("two sparks with one id"),
            says(hw.DUPLICATE_ID), 1.2, lasts_s=2.0, launcher="spark"),
        Row("SPARKs: another host's heartbeat disables them", "strangers", Wire("another host's heartbeat"),
            says(hw.FOREIGN_HOST), STALE_S, launcher="spark"),
        Row("SPARKs: a competition controller on the bus locks them all", "heartbeat", Wire("competition controller"),
            LOCKED, STALE_S, REARM, launcher="spark"),
        Row("SPARKs: nothing on the bus for 2.5 s", "bus-off", Wire("silent"), SILENT, STALE_S, lasts_s=2.5,
            real=True, launcher="spark"),
        Row("SPARKs: control process stopped for 0.6 s (SIGSTOP)", "process", Process("control", "stop"),
            says(bot.TICKS_STALLED), 0.8, launcher="spark"),
        Row("SPARKs: control process killed, started again", "process", Process("control", "kill"), (), 0.25,
            REARM, lasts_s=2.0, buses=("slcan", "socketcan"), launcher="spark")]


def _advice() -> list[Row]:
    return [
        *_frames("advisory", ("flywheel_a",)),
        _row("advisory", "hood", "no frames", "lost", Device("hood", "silent"), SILENT, STALE_S),
        _row("advisory", "feeder", "gate driver fault", "fault", Inside("feeder", "gate driver"),
             says(bot.MOTOR_ERROR, errors=(hw.ERROR_GATE_DRIVER(),)),
             TOLD_S),
        _row("advisory", "hood_encoder", "no frames", "lost", Device("hood_encoder", "silent"), SILENT, STALE_S),
        Row("advice only: its own controller commands and keeps its heartbeat", "strangers",
            Wire("competition controller"), (), 0.0, KEEPS, launcher="advisory")]


def _row(launcher: str, name: str, words: str, family: str, breaking: Device | Inside, reason: Signs, within_s: float,
         after: str = ITSELF, lasts_s: float = 0.6, first: bool = False) -> Row:
    whose = "advice only" if launcher == "advisory" else "SPARK"
    signs = tuple(sign for one in reason for sign in (of(DEVICES[name], (one,)) if one.code.params.keys() & WHOSE
                                                      else (one,)))
    return Row(f"{whose}, {DEVICES[name]}: {words}", family, breaking, signs, within_s, after, lasts_s, first=first,
               launcher=launcher)


SPARK_ROWS = (*_frames("spark", ("flywheel_a", "hood", "feeder")), *_inside(), *_wires(), *_advice())
