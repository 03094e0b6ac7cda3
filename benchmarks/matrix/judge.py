"""The judgement of a run by its files alone: whether the robot reacted as the row states.

The ages of the readings at each FIRE are recomputed from the raw frames of can0.log.
"""

from bisect import bisect_right
from pathlib import Path

import msgspec
from msgspec import Struct

from benchmarks.matrix.devices import Seen
from benchmarks.matrix.fault import DISARMS, ITSELF, KEEPS, REARM, Key, Motion, Row
from benchmarks.matrix.keys import first_hold, judge_keys, replays
from benchmarks.matrix.motion import judge_motion
from benchmarks.matrix.play import AIM, ends_robot, make_config
from benchmarks.matrix.robot_side import AnswersAgain, RobotSide
from benchmarks.matrix.run import Span, needed_frames, with_launcher
from truearc.errors import InputError
from truearc.robot.config.schema import Config, read_axis
from truearc.robot.reasons import texts
from truearc.robot.recording.files import parse_candump
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import CAN, load_trials
from truearc.robot.types import Tick

NS = 1e-9
GRACE_S = 0.2                         # in real time, for a machine that is shared
SIGHTING_S = 0.3
ROUNDING_S = 2e-6                     # of can0.log
WHEEL_RAD_S, HOOD_DEG = 8.0, 0.7      # what was true of a ball may differ by this from what was wanted


class Result(Struct):
    """One cell of the table. `wrong` is empty when all is as it should be."""

    fault: str
    family: str
    bus: str
    outcome: str = ""                 # "HOLD", "fires on", "motors idle"
    hold_s: float | None = None       # from the fault to the first HOLD with the row's reason
    bound_s: float = 0.0
    reason: str = ""                  # the text of that reason
    after: str = ""
    recovery_s: float | None = None   # from the fault's end, or from arming again, to the next FIRE
    fires: int = 0                    # verdicts, in all
    stale: int = 0                    # FIRE with a required reading that was too old, by the raw frames
    wrong: list[str] = []
    tries: int = 1


def judge(row: Row, bus: str, stepped: bool, folder: Path) -> Result:
    """The result of the run in `folder`."""
    result = Result(row.name, row.family, bus, bound_s=row.within_s + (0.0 if stepped else GRACE_S), after=row.after)
    if isinstance(row.breaking, Key):
        judge_keys(row, row.breaking, folder, result)
        return result
    span = Span(folder / "span")
    try:
        ticks = [tick for tick, _ in TickReader(folder / "session")]
        later = [tick for tick, _ in TickReader(folder / "again" / "session")] if (folder / "again").exists() else []
        if isinstance(row.breaking, Motion):
            judge_motion(row, row.breaking, folder, result, ticks)
            _judge_recording(row, result, folder, ticks)
            return result
        seen = msgspec.json.decode((folder / "devices.json").read_bytes(), type=Seen)
    except (InputError, OSError, msgspec.DecodeError) as error:
        result.wrong.append(str(error))
        return result
    result.fires = sum(tick.verdict.fire for tick in ticks)
    if not span.begin_ns:
        result.wrong.append(f"was never ready to fire: {texts(ticks[-1].verdict.reasons) if ticks else ''}")
        return result
    _judge_fault(row, result, ticks, span, seen)
    result.reason = result.reason.replace(f"{folder}/", "")
    _judge_recovery(result, [*ticks, *later], span)
    _judge_freshness(result, folder / "session", ticks, make_config(row))
    _judge_balls(result, seen)
    _judge_recording(row, result, folder, ticks)
    return result


def _judge_fault(row: Row, result: Result, ticks: list[Tick], span: Span, seen: Seen) -> None:
    begin_ns, end_ns = span.begin_ns, span.end_ns or 1 << 62
    fires_ns = [tick.inputs.t_ns for tick in ticks if tick.verdict.fire]
    if not row.first and sum(t_ns < begin_ns for t_ns in fires_ns) < 2:
        result.wrong.append("had not fired before")
    if ends_robot(row.breaking):
        result.outcome = "motors idle"
        result.hold_s = (seen.idle_ns - begin_ns) * NS if seen.idle_ns else None
    else:
        result.hold_s, result.reason = first_hold(row, ticks, begin_ns) or (None, "")
    within_ns = begin_ns + round(result.bound_s * 1e9)
    during = [t_ns for t_ns in fires_ns if begin_ns < t_ns < end_ns]
    if row.after in (ITSELF, REARM, DISARMS):
        result.outcome = result.outcome or "HOLD"
        if result.hold_s is None or result.hold_s > result.bound_s:
            result.wrong.append(f"no HOLD with its reason within {result.bound_s:.2f} s")
        if wrong := sum(t_ns > within_ns for t_ns in during):
            result.wrong.append(f"fired {wrong} times while it stood")
    else:
        result.outcome = "fires on" if during else "HOLD"
        if row.after == KEEPS and not during:
            result.wrong.append("did not go on firing")
        if row.reason and result.hold_s is None:
            result.wrong.append("no message about it")


def _judge_recovery(result: Result, ticks: list[Tick], span: Span) -> None:
    since_ns = span.rearm_ns or span.end_ns
    fires_ns = [tick.inputs.t_ns for tick in ticks if tick.verdict.fire]
    if not span.end_ns:
        result.wrong.append("the fault never ended")
        return
    if result.after in (REARM, DISARMS):
        grace_ns = 5_000_000 if result.bound_s else 0
        early = [t_ns for t_ns in fires_ns if span.end_ns + grace_ns < t_ns < span.rearm_ns]
        if early:
            result.wrong.append(f"fired again {(early[0] - span.end_ns) * NS:.2f} s after the end without being armed")
    again = next((t_ns for t_ns in fires_ns if t_ns > since_ns), None)
    result.recovery_s = None if again is None else (again - since_ns) * NS
    if again is None:
        result.wrong.append(f"never fired again: {', '.join(texts(ticks[-1].verdict.reasons))}")


def _judge_freshness(result: Result, session: Path, ticks: list[Tick], config: Config) -> None:
    """Every reading that firing needs, at every FIRE, by the newest whole frame that had come before the tick."""
    wanted = needed_frames(config)
    came: dict[tuple[int, int], list[int]] = {key: [] for key in wanted}
    sent = 0
    with (session / CAN).open(encoding="ascii") as lines:
        for line in lines:
            parsed = parse_candump(line)
            if parsed is not None and parsed[1]:
                sent += 1
            elif parsed is not None:
                frame = parsed[0]
                came.get((frame.arbitration_id, len(frame.data)), []).append(frame.t_ns)
    if sent and config.axes == with_launcher(config, "advisory").axes:
        result.wrong.append(f"{sent} frames were transmitted, where nothing may be")
    seen_ns = 0
    for tick in ticks:
        sighting = tick.inputs.sighting
        seen_ns = sighting.t_ns if sighting is not None and sighting.found else seen_ns
        if tick.verdict.fire:
            t_ns = tick.inputs.t_ns
            ages = [(_age_s(came[key], t_ns), limit_s) for key, limit_s in wanted.items()]
            ages.append(((t_ns - seen_ns) * NS, SIGHTING_S))
            result.stale += any(not -ROUNDING_S <= age_s <= limit_s + ROUNDING_S for age_s, limit_s in ages)
    if result.stale:
        result.wrong.append(f"fired {result.stale} times on readings that were too old")


def _age_s(came_ns: list[int], t_ns: int) -> float:
    """Of the newest at `t_ns`."""
    before = bisect_right(came_ns, t_ns + 1000)
    return (t_ns - came_ns[before - 1]) * NS if before else float("inf")


def _judge_balls(result: Result, seen: Seen) -> None:
    """True values of each ball that went in."""
    wheel = AIM.motor_ratio * 594.0
    off = [ball for ball in seen.balls if abs(ball[1] - wheel) > WHEEL_RAD_S or abs(ball[2] - AIM.hood_deg) > HOOD_DEG]
    if off:
        result.wrong.append(f"{len(off)} balls went in at {off[0][1]:.0f} rad/s and {off[0][2]:.1f} deg")


def _judge_recording(row: Row, result: Result, folder: Path, ticks: list[Tick]) -> None:
    session = folder / "session"
    marked = {outcome.trial for tick in ticks for outcome in tick.outcomes}
    kept = {trial.outcome.trial for trial in load_trials(session)}
    if marked - kept:
        result.wrong.append(f"{len(marked - kept)} marked trials are not on disk")
    answers = None
    if (folder / "robot.json").exists():
        side = msgspec.json.decode((folder / "robot.json").read_bytes(), type=RobotSide)
        answers = side.answers
        if side.failed and not ends_robot(row.breaking):
            result.wrong.append(f"the recording failed: {side.failed}")
    config = msgspec.json.decode((session / "config.json").read_bytes(), type=Config, dec_hook=read_axis)
    result.wrong += replays(session, config, None if answers is None else AnswersAgain(answers))
