"""What each reason for a HOLD means to a driver, and what can be done about it.

A reason is a sentence that some part of the robot has made; here it is met by a template. The order of TABLE is that of
importance: a wire that is gone comes before the readings that went with it, and before what the driver is to do next.
Where two templates fit, the first one counts. `docs/page.md` has the same table.
"""

import re
from collections.abc import Iterable
from string import Formatter

from msgspec import Struct

FAULT = "fault"                       # something is not as it should be
YOU = "you"                           # it is the driver's turn
WAIT = "wait"                         # comes by itself
FIRE_BUTTON = "waiting for the fire button"

# What a placeholder stands for; one that is not here, for anything at all
SHAPES = {"motor": r"(?:flywheel motor \d+|hood motor|feeder motor)",
          "device": r"(?:flywheel motor \d+|hood motor|feeder motor|hood encoder)"}
SEVERAL = ("motor", "device")         # reasons that differ in these alone are told as one ...
PASSING = ("time",)                   # ... whatever they say of these


class Words(Struct, frozen=True):
    """One kind of reason. `means` and `do` may use the template's placeholders; `do` is "" where there is nothing."""

    template: str
    kind: str
    means: str
    do: str = ""


class Told(Struct, frozen=True):
    """One or several reasons as the driver is told; `reasons` are the robot's own sentences."""

    kind: str
    means: str
    do: str
    reasons: tuple[str, ...]


ADAPTER = (
    Words("CAN lost: {bus}: bus off", FAULT, "The CAN bus has shut itself off",
          "look for a loose or crushed CAN wire, a missing terminator, a device with another bit rate"),
    Words("CAN lost: {bus}: nothing heard for {time} s", FAULT, "Nobody speaks on the CAN bus",
          "main switch on? motor controllers powered? CAN plug in?"),
    Words("CAN lost: {why}", FAULT, "CAN adapter pulled out?", "plug it in; it is found again by itself"),
    Words("{bus}: opened again, nothing heard yet ({why})", FAULT, "CAN adapter is back, but nobody speaks yet",
          "wait two seconds; then look whether the motor controllers have power"),
    Words("two devices with one id? {what}", FAULT, "Two devices on the CAN bus may have the same number",
          "unplug the one that was added last"),
    Words("another host sends {frame}, which is ours to send", FAULT,
          "Something else commands our motors (frame {frame})", "stop the other program or controller"),
    Words("{count} frames could not be sent", FAULT, "The CAN bus takes nothing more: {count} frames could not be sent",
          "look for a loose CAN wire, a missing terminator, an adapter that is too slow"),
    Words("ticks stood still for {time} s", FAULT, "The robot's computer stood still for {time} s",
          "end other programs on it"),
    Words("not sent: {what}", FAULT, "The program wanted to send what it may not",
          "do not fire on; keep the recording and report it"),
    Words("bad frame: {what}", FAULT, "A device says what it cannot mean",
          "if it stays: look at that device's plug and firmware"),
    Words("{bus}: {count} frames lost, the tick came too late for them", FAULT,
          "The robot's computer is too busy: {count} CAN frames lost", "end other programs on it"),
)
OTHER_WIRES = (
    Words("camera lost: {camera}: gives the same image again and again", FAULT, "The camera's picture is frozen",
          "pull its plug and put it back; it is found again by itself"),
    Words("camera lost: the vision process {what}", FAULT, "The robot cannot see: its vision program {what}",
          "it is started again by itself; if it stays: start the program anew"),
    Words("camera lost: vision failed on an image ({error})", FAULT, "The robot cannot make out what it sees",
          "if it stays: start the program anew; report it"),
    Words("camera lost: {why}", FAULT, "No pictures from the camera",
          "look at its plug; it is found again by itself"),
    Words("button box lost: {why}", FAULT, "Button box pulled out?", "plug it in; it is found again by itself"),
    Words("button box silent: outcomes cannot be marked", FAULT, "Button box does not answer: no shot could be marked",
          "look at its plug"),
    Words("button box: {count} presses lost", FAULT, "{count} presses of buttons got lost",
          "it is disarmed: press ARM, then again"),
    Words("button box: {count} presses told twice", FAULT, "{count} presses of buttons came twice: each counts once",
          "if it stays: look at the box's cable"),
    Words("button box: restarted", FAULT, "Button box has restarted",
          "it is disarmed: press ARM, then again; if it comes back: look at its cable"),
    Words("button box: a press may have got lost", WAIT, "Waiting to hear from the button box whether a press got lost",
          "if it stays: look at its plug and cable"),
    Words("button box: {count} lines refused, first {line}", FAULT, "Button box cannot be understood",
          "look at its plug and cable"),
    Words("not recording: No space left on device", FAULT, "The disk is full: nothing is recorded",
          "make room on it, or end and start with another folder"),
    Words("not recording: the disk does not answer", FAULT, "The disk does not answer: nothing is recorded",
          "look at the memory card or the disk's plug"),
    Words("not recording: the recorder {what}", FAULT, "Nothing is recorded: the recorder {what}",
          "mark the shot that is out; start the program anew, unless it comes back by itself"),
    Words("not recording: {why}", FAULT, "Nothing is recorded",
          "look at the disk; it is tried again by itself"),
)
DEVICES = (
    Words("{device} has never answered", FAULT, "{device}: has never answered", "powered? CAN plug in?"),
    Words("{device} silent for {time} s", FAULT, "{device}: silent for {time} s", "lost power, or its CAN plug?"),
    Words("{device} sends no heartbeat since {time} s", FAULT, "{device}: no sign of life for {time} s",
          "lost power, or its CAN plug?"),
    Words("{device} has said nothing of its {troubles} {time}", FAULT, "{device}: does not say how it is",
          "if it stays: switch its power off and on"),
    Words("{motor} reads what is no number", FAULT, "{motor}: says what is no number",
          "switch its power off and on; if it comes back: look at its controller"),
    Words("{motor}: watchdog expired", FAULT, "{motor}: let go, having heard nothing from the robot for too long",
          "press ARM twice (off, on)"),
    Words("{motor}: estop requested", FAULT, "{motor}: emergency stop", "release it, then press ARM twice (off, on)"),
    Words("{motor}: bus under voltage", FAULT, "{motor}: too little voltage", "battery charged? plugs tight?"),
    Words("{motor}: {what} too hot", FAULT, "{motor}: {what} too hot", "let it cool down"),
    Words("{motor}: too hot", FAULT, "{motor}: too hot", "let it cool down"),
    Words("{motor}: has reset (was the supply interrupted?)", FAULT, "{motor}: its controller has restarted",
          "look at its power plug, then press ARM twice (off, on)"),
    Words("{motor}: locked to a competition controller's heartbeat: {rest}", FAULT,
          "{motor}: obeys a competition controller", "take that off the bus, then switch the motor's power off and on"),
    Words("{motor}: spark {id} has not said which firmware it runs", FAULT,
          "{motor}: SPARK {id} does not answer", "powered? CAN plug in? the right number?"),
    Words("{motor}: spark {id} runs firmware {version}; only {known}", FAULT,
          "{motor}: SPARK {id} has a firmware that is not known here ({version})", "update it with its maker's tool"),
    Words("{motor}: spark {id} has not turned its status frames on", WAIT, "{motor}: SPARK {id} is being set up",
          "if it stays: switch its power off and on"),
    Words("{motor}: spark {id} has not taken parameters {numbers}", WAIT, "{motor}: SPARK {id} is being set up",
          "if it stays: switch its power off and on"),
    Words("{motor}: spark {id} says nothing of its faults", FAULT, "{motor}: SPARK {id} does not say how it is",
          "if it stays: switch its power off and on"),
    Words("{motor}: spark {id} applies nothing of the duty that it is sent: {rest}", FAULT,
          "{motor}: SPARK {id} does not drive", "at its limit switch? is a competition controller on the bus?"),
    Words("{motor}: {whose} says {speed} rad/s, but its position stands still: encoder stuck?", FAULT,
          "{motor}: its encoder is stuck at {speed} rad/s", "look at that encoder's plug and magnet"),
    Words("{motor}: {whose} says {speed} rad/s, but its position turns at {other}: encoder or firmware?", FAULT,
          "{motor}: says {speed} rad/s and turns at {other}", "look at that encoder, and at its controller's settings"),
    Words("{motor}: {errors}", FAULT, "{motor}: its controller reports {errors}",
          "press ARM twice (off, on); if it comes back: look at that motor"),
    Words("hood encoder cannot see its magnet", FAULT, "Hood encoder cannot see its magnet",
          "is the magnet in its place?"),
    Words("hood encoder says {encoder} deg, its screw {screw}", FAULT,
          "Hood encoder and screw disagree: {encoder} and {screw} deg",
          "moved by hand? start the program anew, so that the hood is homed"),
    Words("flywheel motors differ by {speed} rad/s: belt?", FAULT, "Flywheel motors differ by {speed} rad/s",
          "is the belt on?"),
)
MODEL = (
    Words("no gate model loaded", FAULT, "No model to ask", "start with --gate"),
    Words("model failed: {error}", FAULT, "The model has failed", "start the program anew; report it"),
    Words("model gives no number", FAULT, "The model gives no number", "report it, with the recording"),
)
DRIVER = (
    Words("not armed: the button box {what}", YOU, "Disarmed: the button box {what}, and ARM may have been pressed",
          "press ARM, then FIRE again"),
    Words("not armed", YOU, "Not armed", "press ARM"),
    Words("mark the last shot first", YOU, "The last shot is not marked",
          "press MISS-LOW, MISS-HIGH, TWO or THREE; REJECT takes it back"),
    Words("target never seen", YOU, "Target not seen yet", "turn towards the target"),
    Words("target last seen {time} s ago", YOU, "Target out of sight for {time} s", "turn towards the target"),
    Words("target {seen} ({what}: the exposure is too long, or not locked)", FAULT,
          "The camera's picture is too bright",
          "turn away from lamps and sun; if it stays: look at the camera's exposure"),
    Words("target {seen} (the picture is dark all over: {what})", YOU, "The camera's picture is dark",
          "turn towards the target; is the ring light on, the lens free?"),
    Words("target {seen} ({count} things in view look like the target)", YOU,
          "{count} things in view look like the target", "turn so that only the target is in view"),
    Words("target {seen} ({why})", YOU, "Target {seen}: {why}", "turn towards the target"),
    Words("target seen {distance} m away, give or take {sigma}", YOU, "What looks like the target is {distance} m away",
          "turn towards the target"),
    Words("stand at {distance} m", YOU, "The plan wants this shot from {distance} m", "drive there"),
    Words("model: outside what it was trained on (novelty {novelty})", YOU,
          "The model has not seen shots like this one (novelty {novelty}, 1 is the limit)", "shoot from another place"),
    Words("model: outside what it was trained on", YOU, "The model has not seen shots like this one",
          "shoot from another place"),
    Words("model: three points {chance} likely, {needed} needed", YOU,
          "Three points only {chance} likely, {needed} needed", "shoot from a better place"),
    Words(FIRE_BUTTON, YOU, "Nobody has asked for a shot", "press FIRE"),
)
COMING = (
    Words("hood not homed", WAIT, "Hood has not found its end yet",
          "armed, it goes there by itself; if not: look at its limit switch"),
    Words("hood angle unknown", WAIT, "Hood angle not known yet", "it is once the hood has found its end"),
    Words("{motor} is not under control (state {state})", WAIT, "{motor}: released",
          "takes hold once armed; if not: press ARM twice (off, on)"),
    Words("no aim", WAIT, "No aim yet", "it comes once armed, with the target in sight and shots left in the plan"),
    Words("nothing to rate", WAIT, "The model has nothing to judge yet", "it needs the distance and the hood's angle"),
    Words("wheels at {now} rad/s, wanted {wanted}", WAIT, "Wheels are not at speed: {now} of {wanted} rad/s"),
    Words("hood at {now} deg, wanted {wanted}", WAIT, "Hood is on its way: at {now}, wanted {wanted} deg"),
    Words("wheels and hood only just arrived", WAIT, "Wheels and hood are settling"),
    Words("the last ball is still clearing", WAIT, "The last ball is still on its way out"),
)
IDENTIFYING = (
    Words("identify: waiting for the arm button", YOU, "Ready to identify: hands off, no ball", "press ARM"),
    Words("identify: waiting for the axes", WAIT, "Motors are taking hold"),
    Words("identify: done", WAIT, "Identified"),
    Words("identify: released by the operator ({button})", YOU, "Let go: {button} was pressed", "start it anew"),
    Words("identify: {phase} ({number} of {last})", WAIT, "Identifying: {phase} ({number} of {last})",
          "any button lets go"),
    Words("identify: {why}", FAULT, "Let go: {why}", "mend that, then start it anew"),
)
TABLE = (*ADAPTER, *OTHER_WIRES, *DEVICES, *MODEL, *DRIVER, *COMING, *IDENTIFYING)


def placeholders(template: str) -> tuple[str, ...]:
    return tuple(name for _, name, _, _ in Formatter().parse(template) if name is not None)


def tell(reasons: Iterable[str]) -> tuple[Told, ...]:
    """The reasons in a driver's words, most important first; one that nobody has words for as it is, before all."""
    groups: dict[tuple[int, tuple[str, ...]], list[tuple[dict[str, str], str]]] = {}
    for reason in reasons:
        rank, found = _find(reason)
        differing = tuple(text for name, text in found.items() if name not in SEVERAL + PASSING)
        groups.setdefault((rank, differing if rank >= 0 else (reason,)), []).append((found, reason))
    return tuple(_together(rank, members) for (rank, _), members in sorted(groups.items(), key=lambda item: item[0][0]))


def find_words(reason: str) -> Words | None:
    """The words that fit; None when nobody has any."""
    rank, _ = _find(reason)
    return TABLE[rank] if rank >= 0 else None


def _find(reason: str) -> tuple[int, dict[str, str]]:
    for rank, pattern in enumerate(PATTERNS):
        if match := pattern.fullmatch(reason):
            return rank, match.groupdict()
    return -1, {}


def _together(rank: int, members: list[tuple[dict[str, str], str]]) -> Told:
    reasons = tuple(reason for _, reason in members)
    if rank < 0:
        return Told(FAULT, reasons[0], "", reasons)
    words, (first, _) = TABLE[rank], members[0]
    said = {name: ", ".join(found[name] for found, _ in members) if name in SEVERAL else text
            for name, text in first.items()}
    means = words.means.format_map(said)
    return Told(words.kind, means[:1].upper() + means[1:], words.do.format_map(said), reasons)


def _compile(template: str) -> re.Pattern[str]:
    parts = (re.escape(text) + ("" if name is None else f"(?P<{name}>{SHAPES.get(name, '.*')})")
             for text, name, _, _ in Formatter().parse(template))
    return re.compile("".join(parts), re.DOTALL)


PATTERNS = tuple(_compile(words.template) for words in TABLE)
