"""The operator page's view of the newest tick, as text and as numbers with their units.

`look` keeps the newest tick, sighting and outcomes in a Glance; `describe` turns a Glance into one event for the
browser. `tell` explains to the driver each reason for a HOLD and what to do about it. The functions are pure. The texts
are in `driver_messages.toml`, in order of importance, and `docs/reference/reasons.md` lists them all.
"""

import math
import tomllib
from collections.abc import Iterable, Iterator
from importlib.resources import files
from itertools import product
from operator import itemgetter

from msgspec import UNSET, Struct, UnsetType, field
from msgspec.structs import replace

from truearc.hw.devices.registry import family_of, find_messages
from truearc.hw.protocols import NS, MotorReading
from truearc.hw.reason import FAULT, YOU, Message, Reason, fill
from truearc.robot import reasons as bot
from truearc.robot.config.schema import Config
from truearc.robot.config.targets import Target
from truearc.robot.estimate import HEARTBEAT_S
from truearc.robot.motors import name_axes
from truearc.robot.reasons import BOX_GONE, FIRE_NOT_REQUESTED, NOT_RECORDING, text
from truearc.robot.types import Outcome, Shot, Sighting, Tick, Verdict

TAKEN_NS = 500_000_000                # a controller that is enabled drives by then: it tells its state every 0.1 s
FIRED_S = 0.5                         # a verdict of FIRE lasts one tick; the tile stays for as long as one can read it
ABSENT = "–"
RECENT = 6                            # trials that are listed
SEVERAL = ("motor", "device", "joint")           # reasons that differ in these alone are shown as one ...
PASSING = ("age_s",)                  # ... regardless of these
# what a message says of the buttons, and what it says where the target faces up
MARKS_UP = ("MISS-LOW, MISS-HIGH, TWO or THREE",
            "MISS-LOW (short), MISS-HIGH (long), MISS-LEFT, MISS-RIGHT or TWO (hit)")


class PageTrial(Struct, frozen=True):
    """One shot, or a request that was never granted; `outcome` is "" until it is known."""

    trial: int
    shot: Shot | None = None
    outcome: str = ""
    reasons: tuple[Reason, ...] = ()


class Glance(Struct, frozen=True):
    """State of the page, replaced as a whole with every tick, so that its parts belong together."""

    seq: int = 0
    tick: Tick | None = None
    sighting: Sighting | None = None              # newest, whatever it showed
    shots: int = 0
    outcomes: dict[str, int] = field(default_factory=dict)
    recent: tuple[PageTrial, ...] = ()                # oldest first
    enabled_t_ns: tuple[int, ...] = (0, 0, 0)         # since when wheels, hood and feeder are; 0: they are not


def look(glance: Glance, tick: Tick) -> Glance:
    """Return the glance after one more tick, in a time independent of the session's length."""
    for outcome in tick.outcomes:
        glance = _with_outcome(glance, outcome)
    if (shot := tick.shot) is not None:
        recent = (*glance.recent, PageTrial(shot.trial, shot))[-RECENT:]
        glance = replace(glance, shots=glance.shots + 1, recent=recent)
    sighting, command = tick.inputs.sighting, tick.command
    enabled_t_ns = tuple(since_ns or tick.inputs.t_ns if is_enabled else 0 for since_ns, is_enabled in zip(
        glance.enabled_t_ns, (command.enable_flywheel, command.enable_hood, command.enable_feeder), strict=True))
    return replace(glance, seq=glance.seq + 1, tick=tick, sighting=glance.sighting if sighting is None else sighting,
                   enabled_t_ns=enabled_t_ns)


def _with_outcome(glance: Glance, outcome: Outcome) -> Glance:
    """An earlier outcome of the same trial, such as a mark that is rejected now, no longer counts."""
    before = next((one for one in glance.recent if one.trial == outcome.trial), PageTrial(outcome.trial))
    now = replace(before, outcome=outcome.outcome, reasons=outcome.reasons)
    counts = dict(glance.outcomes)
    if before.outcome:
        counts[before.outcome] -= 1
    counts[now.outcome] = counts.get(now.outcome, 0) + 1
    others = (one for one in glance.recent if one.trial != outcome.trial)
    recent = tuple(sorted((*others, now), key=lambda one: one.trial))
    return replace(glance, outcomes=counts, recent=recent[-RECENT:])


class Told(Struct, frozen=True):
    """One or several reasons in the page's words; `reasons`: their log texts."""

    kind: str
    means: str
    do: str
    reasons: tuple[str, ...]


def load_messages() -> Iterator[Message]:
    """Load the messages of driver_messages.toml, most important first."""
    text = (files("truearc.robot.operator_ui") / "driver_messages.toml").read_text(encoding="utf-8")
    for row in tomllib.loads(text)["message"]:
        for code, case in product(_listed(row["code"]), _listed(row.get("case", ""))):
            yield Message(bot.BY_NAME[code], row["kind"], row["means"], row.get("do", ""), case)


def _listed(names: str | list[str]) -> list[str]:
    return [names] if isinstance(names, str) else names


MESSAGES = tuple(load_messages())
RANKS = {(message.code.name, message.case): rank for rank, message in enumerate(MESSAGES)}


def tell(reasons: Iterable[Reason]) -> tuple[Told, ...]:
    """Return the reasons as messages, most important first.

    Messages of other distributions' motors come first, as does a reason without a message, shown as its log text.
    """
    groups: dict[tuple[object, ...], tuple[int, Message | None, list[Reason]]] = {}
    for reason in reasons:
        message = find_message(reason)
        rank = -1 if message is None else RANKS.get((message.code.name, message.case), -1)
        alike = (bot.text(reason),) if message is None else (reason.code, *_differing(reason))
        groups.setdefault((rank, *alike), (rank, message, []))[2].append(reason)
    return tuple(_together(message, members) for _, message, members in sorted(groups.values(), key=itemgetter(0)))


def find_message(reason: Reason) -> Message | None:
    """Return the message for a reason; None if there is none."""
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


class Line(Struct, frozen=True):
    """One value and its name; `ok` is false where it prevents firing."""

    name: str
    value: str
    ok: bool = True


class Block(Struct, frozen=True):
    title: str
    lines: tuple[Line, ...]


class Here(Struct, frozen=True):
    """The robot's configuration as its gate receives it; None where unknown."""

    distance_m: float | None
    motor_ratio: float | None
    hood_deg: float | None


class Live(Struct, frozen=True):
    """Numbers that the page plots against their set points; None where unknown or not asked for."""

    wheels_rad_s: tuple[float | None, ...]        # motor speeds
    wheels_wanted_rad_s: float | None
    hood_deg: float | None
    hood_wanted_deg: float | None


class Offer(Struct, frozen=True):
    """An aim file that awaits the driver; `is_open`: the launcher is disarmed, so that it may be accepted."""

    sha256: str
    note: str
    is_open: bool


class PageView(Struct, frozen=True):
    """One event for the browser."""

    seq: int
    t_robot_s: float
    state: str                                    # FIRE or HOLD; that it is STALE a browser must find out by itself
    tone: str                                     # "fire", "ready", "you" (all as it should be), "fault"
    told: tuple[Told, ...]
    blocks: tuple[Block, ...]
    here: Here
    offer: Offer | None
    live: Live


def describe(glance: Glance, tick: Tick, config: Config, recording: str) -> PageView:
    """Return the page's view; `tick` is the glance's own; `recording`: where it is recorded, "" = nowhere."""
    told, target = tell(_as_shown(reason, glance, tick, config) for reason in tick.verdict.reasons), config.rig.target
    if target is not None and target.faces_up:
        told = tuple(replace(one, do=one.do.replace(*MARKS_UP)) for one in told)
    fire = _is_fire(glance, tick, told)
    blocks = (_aim(glance.sighting, tick, config), _robot(tick, recording), _shots(glance, target),
              _links(glance.sighting, tick, config))
    belief = tick.estimate
    return PageView(glance.seq, round(tick.inputs.t_ns * NS, 3), "FIRE" if fire else "HOLD", _tone(tick, fire, told),
                    told, blocks, Here(*map(_finite, (belief.distance_m, belief.motor_ratio, belief.hood_deg))),
                    _offer(tick), _live(tick, config))


def _live(tick: Tick, config: Config) -> Live:
    wanted = tick.aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    return Live(tuple(_finite(one.velocity_rad_s) for one in tick.inputs.flywheels), _finite(wanted or None),
                _finite(tick.estimate.hood_deg), _finite(tick.aim.hood_deg) if wanted else None)


def _as_shown(reason: Reason, glance: Glance, tick: Tick, config: Config) -> Reason:
    """Of a controller of ours that leaves control without an error the verdict says what it says of one not enabled
    yet."""
    if reason.code != bot.MOTOR_NOT_DRIVEN.name:
        return reason
    motor, axes = str(reason.params["motor"]), config.axes
    which = 0 if motor.startswith("flywheel") else 1 if motor.startswith("hood") else 2
    since_ns = glance.enabled_t_ns[which]
    is_ours = family_of((axes.flywheels[0], axes.hood, axes.feeder)[which]).is_commanded
    is_late = is_ours and since_ns and tick.inputs.t_ns - since_ns >= TAKEN_NS
    return bot.MOTOR_LEFT_CONTROL(**reason.params) if is_late else reason


def _offer(tick: Tick) -> Offer | None:
    offer = tick.inputs.aim_offer
    if offer is UNSET or offer.sha256 == tick.memory.aim_sha256:
        return None
    return Offer(offer.sha256, offer.note, not tick.memory.armed)


def _is_fire(glance: Glance, tick: Tick, told: tuple[Told, ...]) -> bool:
    if tick.verdict.fire:
        return True
    shot = tick.memory.last_shot
    fired = tick.memory.armed and shot is not None and 0 <= (tick.inputs.t_ns - shot.t_ns) * NS < FIRED_S
    return fired and not any(one.kind == FAULT for one in told)


def _tone(tick: Tick, fire: bool, told: tuple[Told, ...]) -> str:
    if fire:
        return "fire"
    if [reason.code for reason in tick.verdict.reasons] == [FIRE_NOT_REQUESTED.name]:
        return "ready"
    return FAULT if any(one.kind == FAULT for one in told) else YOU


def _aim(sighting: Sighting | None, tick: Tick, config: Config) -> Block:
    belief, aim, verdict = tick.estimate, tick.aim, tick.verdict
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    by_belief = [Line(name, value) for name, value, told in (
        ("turn", f"{_side(-_given(aim.lead_deg))} of the target", _given(aim.lead_deg) != 0.0),
        ("corrected", f"{_given(aim.correction):+.1%} speed by the marks", _given(aim.correction) != 0.0)) if told]
    return Block("Aim", (
        Line("distance", f"{belief.distance_m:.2f} ± {_number(belief.distance_sigma_m, '.2f')} m"
             if belief.distance_m is not None else "not known", belief.distance_m is not None),
        Line("target", *_target(sighting, tick, config)),
        Line("wheels", f"{belief.motor_rad_s:.0f}{f' of {wanted:.0f}' if wanted else ''} rad/s",
             not wanted or abs(belief.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s),
        Line("hood", f"{_number(belief.hood_deg, '.1f')}{f' of {aim.hood_deg:.1f}' if wanted else ''}°",
             belief.hood_deg is not None and (not wanted
                                              or abs(belief.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg)),
        *_chances(verdict, config.rig.target), *by_belief))


def _chances(verdict: Verdict, target: Target | None) -> tuple[Line, ...]:
    if target is not None and target.faces_up and target.hit_or_miss:
        return (Line("p(hit)", _number(verdict.p_three, ".0%")),)
    return Line("p(three)", _number(verdict.p_three, ".0%")), Line("p(two)", _number(verdict.p_two, ".0%"))


def _given(value: float | UnsetType) -> float:
    return 0.0 if value is UNSET else value


def _target(sighting: Sighting | None, tick: Tick, config: Config) -> tuple[str, bool]:
    seen_s, newest = tick.estimate.sighting_s, tick.memory.last_sighting
    if seen_s is not None and 0.0 <= seen_s <= config.gate.sighting_age_s:
        bearing_deg = None if newest is None else newest.bearing_deg
        return "in sight" if bearing_deg is None else f"in sight, {_side(bearing_deg)}", True
    since = "never seen" if seen_s is None else f"not seen for {_age(seen_s)}"
    return since + (f": {text(sighting.reason)}" if sighting is not None and sighting.reason is not None else ""), False


def _side(bearing_deg: float) -> str:
    return f"{abs(bearing_deg):.1f}° to the {'right' if bearing_deg > 0.0 else 'left'}"


def _robot(tick: Tick, recording: str) -> Block:
    memory, battery_v = tick.memory, tick.estimate.battery_v
    trouble = next((text(fault) for fault in tick.inputs.faults if fault.code == NOT_RECORDING.name), "")
    return Block("Robot", (
        Line("armed", "yes" if memory.armed else "no", memory.armed),
        Line("homed", "yes" if memory.homed else "no", memory.homed),
        Line("shot requested", _age((tick.inputs.t_ns - memory.request_t_ns) * NS) + " ago" if memory.request_t_ns
             else "no"),
        Line("trial", str(memory.trial)),
        Line("battery", f"{battery_v:.1f} V" if battery_v else ABSENT),
        Line("recording", trouble or recording or "nothing is recorded",
             bool(recording) and not trouble)))


def _shots(glance: Glance, target: Target | None) -> Block:
    counts = ", ".join(f"{count} {_word(mark, target)}" for mark, count in sorted(glance.outcomes.items()) if count)
    return Block("Shots", (Line("this session", f"{glance.shots} fired" + (f": {counts}" if counts else "")),
                           *(_trial(one, target) for one in reversed(glance.recent))))


def _word(outcome: str, target: Target | None) -> str:
    return outcome if target is None or outcome in ("held", "rejected") else target.button(outcome)


def _trial(one: PageTrial, target: Target | None) -> Line:
    name = f"{one.trial}" + (f" from {one.shot.distance_m:.2f} m" if one.shot is not None else "")
    if one.outcome == "held":
        return Line(name, "held: " + "; ".join(told.means for told in tell(one.reasons)[:1]))
    return Line(name, _word(one.outcome, target) or "not marked yet", bool(one.outcome))


def _links(sighting: Sighting | None, tick: Tick, config: Config) -> Block:
    inputs = tick.inputs
    motors = (*inputs.flywheels, inputs.hood_motor, inputs.feeder)
    lines = [_motor(name, motor, inputs.t_ns, config.gate.reading_age_s)
             for (name, _), motor in zip(name_axes(config), motors, strict=True)]
    if config.hood_encoder.is_heard:
        angle_ns = inputs.hood_angle.t_ns if inputs.hood_angle is not None else 0
        lines.append(_reading("hood encoder", angle_ns, inputs.t_ns, config.gate.reading_age_s))
    gone = any(fault.code in BOX_GONE for fault in inputs.faults)
    return Block("Links: age of reading / heartbeat", (
        *lines,
        _reading("camera", sighting.t_ns if sighting is not None else 0, inputs.t_ns, config.gate.sighting_age_s),
        Line("button box", "gone" if gone else "answers", not gone)))


def _motor(name: str, motor: MotorReading, t_ns: int, limit_s: float) -> Line:
    reading, beat = (_reading(name, stamp_ns, t_ns, most_s)
                     for stamp_ns, most_s in ((motor.t_ns, limit_s), (motor.heartbeat_t_ns, HEARTBEAT_S)))
    return Line(name, f"{reading.value} / {beat.value}", reading.ok and beat.ok)


def _reading(name: str, stamp_ns: int, t_ns: int, limit_s: float) -> Line:
    if not stamp_ns:
        return Line(name, "never", False)
    age_s = (t_ns - stamp_ns) * NS
    return Line(name, _age(age_s), 0.0 <= age_s <= limit_s)


def _age(age_s: float) -> str:
    return f"{age_s * 1e3:.0f} ms" if abs(age_s) < 1.0 else f"{age_s:.1f} s"


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _number(value: float | None, form: str) -> str:
    return ABSENT if value is None else format(value, form)
