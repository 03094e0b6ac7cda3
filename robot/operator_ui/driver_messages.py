"""What each reason for a HOLD means to a driver, and what can be done about it.

The order of MESSAGES is that of importance: a wire that is gone comes before the readings that went with it, and before
what the driver is to do next. `docs/reasons.md` shows them all.
"""

from collections.abc import Iterable
from operator import itemgetter

from msgspec import Struct

from truearc.hw import fault_codes as hw
from truearc.hw.devices.registry import find_messages
from truearc.hw.reason import FAULT, WAIT, YOU, Message, Reason, fill
from truearc.robot import reasons as bot

SEVERAL = ("motor", "device")         # reasons that differ in these alone are shown as one ...
PASSING = ("age_s",)                  # ... whatever these are
REARM = "press ARM twice (off, on)"


class Told(Struct, frozen=True):
    """One or several reasons as the page words them; `reasons`: their log texts."""

    kind: str
    means: str
    do: str
    reasons: tuple[str, ...]


ADAPTER = (
    Message(bot.CAN_LOST, FAULT, "The CAN bus has shut itself off",
            "look for a loose or crushed CAN wire, a missing terminator, a device with another bit rate",
            hw.CAN_BUS_OFF.name),
    Message(bot.CAN_LOST, FAULT, "No device sends on the CAN bus",
            "main switch on? motor controllers powered? CAN plug in?", hw.CAN_SILENT.name),
    Message(bot.CAN_LOST, FAULT, "CAN adapter pulled out?", "plug it in; it is found again by itself"),
    Message(hw.CAN_REOPENED, FAULT, "CAN adapter is back, but no device has sent yet",
            "wait two seconds; then look whether the motor controllers have power"),
    Message(hw.DUPLICATE_ID, FAULT, "Two devices on the CAN bus may have the same number",
            "unplug the one that was added last"),
    Message(hw.FOREIGN_HOST, FAULT, "Something else commands our motors (frame {frame})",
            "stop the other program or controller"),
    Message(bot.FRAMES_NOT_SENT, FAULT, "The CAN bus takes nothing more: {frames} frames could not be sent",
            "look for a loose CAN wire, a missing terminator, an adapter that is too slow"),
    Message(bot.TICKS_STALLED, FAULT, "The robot's computer stood still for {stall_s:.2f} s",
            "end other programs on it"),
    *(Message(code, FAULT, f"The program wanted to send {what} (frame {{frame}})",
              "do not fire on; keep the recording and report it")
      for code, what in ((hw.FRAME_NOT_ALLOWED, "what it may not"), (hw.FRAME_RATE_EXCEEDED, "more than it may"))),
    Message(bot.BAD_FRAME, FAULT, "A device sends a frame that cannot be right",
            "if it stays: look at that device's plug and firmware"),
    Message(hw.CAN_OVERRUN, FAULT, "The robot's computer is too busy: {frames} CAN frames lost",
            "end other programs on it"),
)
OTHER_WIRES = (
    Message(bot.CAMERA_LOST, FAULT, "The camera's picture is frozen",
            "pull its plug and put it back; it is found again by itself", hw.CAMERA_FROZEN.name),
    *(Message(bot.CAMERA_LOST, FAULT, "The robot cannot see: {cause}",
              "it is started again by itself; if it stays: restart the program", cause.name)
      for cause in (bot.VISION_UNRESPONSIVE, hw.PROCESS_STARTING, hw.PROCESS_KILLED, hw.PROCESS_ENDED)),
    Message(bot.CAMERA_LOST, FAULT, "The robot cannot make out what it sees",
            "if it stays: restart the program; report it", bot.VISION_FAILED.name),
    Message(bot.CAMERA_LOST, FAULT, "No pictures from the camera", "look at its plug; it is found again by itself"),
    Message(bot.BOX_LOST, FAULT, "Button box pulled out?", "plug it in; it is found again by itself"),
    Message(bot.BOX_SILENT, FAULT, "Button box does not respond: no shot could be marked", "look at its plug"),
    Message(hw.BOX_PRESSES_LOST, FAULT, "{presses:~ }presses of buttons lost", "it is disarmed: press ARM, then again"),
    Message(hw.BOX_PRESSES_REPEATED, FAULT, "{presses} presses of buttons came twice: each counts once",
            "if it stays: look at the box's cable"),
    Message(hw.BOX_RESTARTED, FAULT, "Button box has restarted",
            "it is disarmed: press ARM, then again; if it comes back: look at its cable"),
    Message(bot.BOX_PRESS_UNCERTAIN, WAIT, "Waiting for the button box: a press may be lost",
            "if it stays: look at its plug and cable"),
    Message(hw.BOX_LINES_REFUSED, FAULT, "Button box cannot be understood", "look at its plug and cable"),
    Message(bot.NOT_RECORDING, FAULT, "The disk is full: nothing is recorded",
            "make room on it, or end and start with another folder", bot.DISK_FULL.name),
    Message(bot.NOT_RECORDING, FAULT, "The disk does not respond: nothing is recorded",
            "look at the memory card or the disk's plug", bot.DISK_UNRESPONSIVE.name),
    *(Message(bot.NOT_RECORDING, FAULT, "Nothing is recorded: {cause}",
              "mark the shot that is out; restart the program, unless it comes back by itself", cause.name)
      for cause in (bot.RECORDER_UNRESPONSIVE, hw.PROCESS_STARTING, hw.PROCESS_KILLED, hw.PROCESS_ENDED)),
    Message(bot.NOT_RECORDING, FAULT, "Nothing is recorded", "look at the disk; it is tried again by itself"),
)
DEVICES = (
    Message(bot.DEVICE_NEVER_RECEIVED, FAULT, "{device}: no frames since the start", "powered? CAN plug in?"),
    Message(bot.DEVICE_STALE, FAULT, "{device}: no frames for {age_s:.2f} s", "lost power, or its CAN plug?"),
    Message(bot.DEVICE_HEARTBEAT_STALE, FAULT, "{device}: no heartbeat for {age_s:.2f} s",
            "lost power, or its CAN plug?"),
    Message(bot.DEVICE_FAULTS_NEVER_RECEIVED, FAULT, "{device}: does not report its faults",
            "if it stays: switch its power off and on"),
    Message(bot.DEVICE_FAULTS_STALE, FAULT, "{device}: no longer reports its faults",
            "if it stays: switch its power off and on"),
    Message(bot.MOTOR_NOT_FINITE, FAULT, "{motor}: non-finite reading",
            "switch its power off and on; if it comes back: look at its controller"),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: stopped by its watchdog (no commands received)", REARM,
            hw.ERROR_WATCHDOG_EXPIRED.name),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: emergency stop", f"release it, then {REARM}",
            hw.ERROR_ESTOP_REQUESTED.name),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: voltage too low", "battery charged? plugs tight?",
            hw.ERROR_DC_BUS_UNDER_VOLTAGE.name),
    *(Message(bot.MOTOR_ERROR, FAULT, "{motor}: {errors:,}", "let it cool down", error.name)
      for error in (hw.ERROR_MOTOR_OVER_TEMPERATURE, hw.ERROR_INVERTER_OVER_TEMPERATURE, hw.ERROR_OVER_TEMPERATURE)),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: its controller has restarted", f"look at its power plug, then {REARM}",
            hw.ERROR_HAS_RESET.name),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: obeys a competition controller",
            "take that off the bus, then switch the motor's power off and on",
            hw.ERROR_LOCKED.name),
    Message(bot.MOTOR_ERROR, FAULT, "{motor}: its controller reports {errors:,}",
            f"{REARM}; if it comes back: look at that motor"),
    Message(hw.SPARK_FIRMWARE_UNKNOWN, FAULT, "{motor}: SPARK {spark} does not respond",
            "powered? CAN plug in? the right number?"),
    Message(hw.SPARK_FIRMWARE_UNSUPPORTED, FAULT, "{motor}: SPARK {spark} has an unsupported firmware ({version})",
            "update it with its maker's tool"),
    *(Message(code, WAIT, "{motor}: SPARK {spark} is being set up", "if it stays: switch its power off and on")
      for code in (hw.SPARK_STATUS_OFF, hw.SPARK_SETTINGS_UNCONFIRMED)),
    Message(hw.SPARK_FAULTS_STALE, FAULT, "{motor}: SPARK {spark} does not report its faults",
            "if it stays: switch its power off and on"),
    Message(hw.SPARK_NOT_DRIVING, FAULT, "{motor}: SPARK {spark} does not drive",
            "at its limit switch? is a competition controller on the bus?"),
    Message(hw.ENCODER_STUCK, FAULT, "{motor}: its encoder is stuck at {speed_rad_s:.0f} rad/s",
            "look at that encoder's plug and magnet"),
    Message(hw.ENCODER_MISMATCH, FAULT, "{motor}: reports {speed_rad_s:.0f} rad/s and turns at {turned_rad_s:.0f}",
            "look at that encoder, and at its controller's settings"),
    Message(bot.MAGNET_LOST, FAULT, "Hood encoder cannot see its magnet", "is the magnet in its place?"),
    Message(bot.HOOD_ENCODERS_DISAGREE, FAULT,
            "Hood encoder and screw disagree: {encoder_deg:.1f} and {screw_deg:.1f} deg",
            "moved by hand? restart the program, so that the hood is homed"),
    Message(bot.FLYWHEELS_DIFFER, FAULT, "Flywheel motors differ by {spread_rad_s:.0f} rad/s", "is the belt on?"),
)
MODEL = (
    Message(bot.MODEL_MISSING, FAULT, "No gate model", "start with --gate"),
    Message(bot.AIM_FILE_MISSING, FAULT, "No aim file", "start with --aim"),
    Message(bot.MODEL_FAILED, FAULT, "The model has failed", "restart the program; report it"),
    Message(bot.MODEL_NOT_FINITE, FAULT, "The model gives a non-finite probability", "report it, with the recording"),
)
DRIVER = (
    Message(bot.DISARMED_BY_BOX, YOU, "Disarmed: {cause}, and ARM may have been pressed",
            "press ARM, then FIRE again"),
    Message(bot.NOT_ARMED, YOU, "Not armed", "press ARM"),
    Message(bot.SHOT_NOT_MARKED, YOU, "The last shot is not marked",
            "press MISS-LOW, MISS-HIGH, TWO or THREE; REJECT takes it back"),
    *(Message(code, FAULT, "The camera's picture is too bright",
              "turn away from lamps and sun; if it stays: look at the camera's exposure", cause.name)
      for code in (bot.TARGET_NEVER_SEEN, bot.TARGET_STALE) for cause in (bot.IMAGE_BRIGHT, bot.IMAGE_BURNT)),
    *(Message(code, YOU, "The camera's picture is dark",
              "turn towards the target; is the ring light on, the lens free?", bot.IMAGE_DARK.name)
      for code in (bot.TARGET_NEVER_SEEN, bot.TARGET_STALE)),
    *(Message(code, YOU, "{cause}", "turn so that only the target is in view", bot.SEVERAL_TARGETS.name)
      for code in (bot.TARGET_NEVER_SEEN, bot.TARGET_STALE)),
    Message(bot.TARGET_NEVER_SEEN, YOU, "Target not seen yet{cause:: ~}", "turn towards the target"),
    Message(bot.TARGET_STALE, YOU, "Target out of sight for {age_s:.1f} s{cause:: ~}", "turn towards the target"),
    Message(bot.TARGET_IMPLAUSIBLE, YOU, "Implausible target distance: {distance_m:.1f} ± {sigma_m:.1f} m",
            "turn towards the target"),
    Message(bot.NOT_AT_PLACE, YOU, "The plan wants this shot from {place_m:.2f} m", "drive there"),
    Message(bot.NO_SET_POINT, YOU, "No set point for {distance_m:.2f} m", "shoot from another distance"),
    Message(bot.MODEL_OUTSIDE_DOMAIN, YOU,
            "The model's training data has no shots like this one{novelty: (novelty ~, 1 is the limit)}",
            "shoot from another place"),
    Message(bot.MODEL_BELOW_THRESHOLD, YOU, "Three points only {p_three:.0%} likely, {threshold:.0%} needed",
            "shoot from a better place"),
    Message(bot.FIRE_NOT_REQUESTED, YOU, "Ready for FIRE: no shot requested", "press FIRE"),
)
COMING = (
    Message(bot.HOOD_NOT_HOMED, WAIT, "Hood is not homed",
            "armed, it homes by itself; if not: look at its limit switch"),
    Message(bot.HOOD_UNKNOWN, WAIT, "Hood angle not known yet", "it is once the hood is homed"),
    Message(bot.MOTOR_NOT_DRIVEN, WAIT, "{motor}: released", f"takes hold once armed; if not: {REARM}"),
    Message(bot.NO_AIM, WAIT, "No aim yet", "it comes once armed, with the target in sight and shots left in the plan"),
    Message(bot.MODEL_NO_INPUT, WAIT, "The model has no input yet", "it needs the distance and the hood's angle"),
    Message(bot.WHEELS_OFF_SPEED, WAIT, "Wheels are not at speed: {speed_rad_s:.0f} of {wanted_rad_s:.0f} rad/s"),
    Message(bot.HOOD_OFF_ANGLE, WAIT, "Hood is moving: at {angle_deg:.1f}, set point {wanted_deg:.1f} deg"),
    Message(bot.NOT_SETTLED, WAIT, "Wheels and hood are settling"),
    Message(bot.BALL_CLEARING, WAIT, "The last ball is still on its way out"),
)
IDENTIFYING = (
    Message(bot.IDENTIFY_WAITING, YOU, "Ready to identify: hands off, no ball", "press ARM"),
    Message(bot.IDENTIFY_STARTING, WAIT, "Motors are taking hold"),
    Message(bot.IDENTIFY_DONE, WAIT, "Identified"),
    Message(bot.IDENTIFY_RELEASED, YOU, "Released: {button} was pressed", "start it again"),
    Message(bot.IDENTIFY_RELEASED_BY_BOX, FAULT, "Released: {cause}", "look at the box, then start it again"),
    Message(bot.IDENTIFY_RUNNING, WAIT, "Identifying: {joint} {phase} ({number} of {last})", "any button releases"),
    Message(bot.IDENTIFY_STOPPED, FAULT, "Released: {causes}", "fix that, then start it again"),
)
UNKNOWN = (Message(bot.LEGACY_TEXT, FAULT, "{text}"),)
MESSAGES = (*ADAPTER, *OTHER_WIRES, *DEVICES, *MODEL, *DRIVER, *COMING, *IDENTIFYING, *UNKNOWN)
RANKS = {(message.code.name, message.case): rank for rank, message in enumerate(MESSAGES)}


def tell(reasons: Iterable[Reason]) -> tuple[Told, ...]:
    """The reasons as messages, most important first.

    Those of other distributions' motors come before all, and so does one without a message, as its log text.
    """
    groups: dict[tuple[object, ...], tuple[int, Message | None, list[Reason]]] = {}
    for reason in reasons:
        message = find_message(reason)
        rank = -1 if message is None else RANKS.get((message.code.name, message.case), -1)
        alike = (bot.text(reason),) if message is None else (reason.code, *_differing(reason))
        groups.setdefault((rank, *alike), (rank, message, []))[2].append(reason)
    return tuple(_together(message, members) for _, message, members in sorted(groups.values(), key=itemgetter(0)))


def find_message(reason: Reason) -> Message | None:
    """The message for a reason; None where there is none."""
    case = _case(reason)
    own = find_messages(case if reason.code == bot.MOTOR_ERROR.name else reason.code)
    rank = RANKS.get((reason.code, case), RANKS.get((reason.code, "")))
    return next((message for message in own if message.case in ("", case)), None if rank is None else MESSAGES[rank])


def _case(reason: Reason) -> str:
    cause, errors = reason.params.get("cause"), reason.params.get("errors", ())
    only = errors[0] if isinstance(errors, tuple | list) and len(errors) == 1 else cause
    return only.code if isinstance(only, Reason) else ""


def _differing(reason: Reason) -> tuple[object, ...]:
    return tuple(str(value) for name, value in reason.params.items() if name not in SEVERAL + PASSING)


def _together(message: Message | None, members: list[Reason]) -> Told:
    reasons = tuple(bot.texts(members))
    if message is None:
        return Told(FAULT, reasons[0], "", reasons)
    params = dict(members[0].params)
    for name in SEVERAL:
        if name in params:
            params[name] = tuple(str(member.params[name]) for member in members)
    means = fill(message.means, params, bot.BY_NAME)
    return Told(message.kind, means[:1].upper() + means[1:], fill(message.do, params, bot.BY_NAME), reasons)
