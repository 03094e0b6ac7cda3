"""State of the page: the newest tick, the newest sighting, and the outcomes of the shots so far."""

from msgspec import Struct, field
from msgspec.structs import replace

from truearc.hw.reason import Reason
from truearc.robot.types import Outcome, Shot, Sighting, Tick

RECENT = 6                            # trials that are listed


class PageTrial(Struct, frozen=True):
    """One shot, or a request that was never granted; `outcome` is "" until it is known."""

    trial: int
    shot: Shot | None = None
    outcome: str = ""
    reasons: tuple[Reason, ...] = ()


class Glance(Struct, frozen=True):
    """Replaced whole with every tick: whoever holds one holds things that belong together."""

    seq: int = 0
    tick: Tick | None = None
    sighting: Sighting | None = None              # newest, whatever it showed
    shots: int = 0
    outcomes: dict[str, int] = field(default_factory=dict)
    recent: tuple[PageTrial, ...] = ()                # oldest first


def look(glance: Glance, tick: Tick) -> Glance:
    """`glance` after one more tick. No longer for a long session than for a short one."""
    if tick.shot is not None or tick.outcomes:
        glance = _with_trials(glance, tick)
    sighting = tick.inputs.sighting
    return replace(glance, seq=glance.seq + 1, tick=tick, sighting=glance.sighting if sighting is None else sighting)


def _with_trials(glance: Glance, tick: Tick) -> Glance:
    for outcome in tick.outcomes:
        glance = _with_outcome(glance, outcome)
    if tick.shot is None:
        return glance
    recent = (*glance.recent, PageTrial(tick.shot.trial, tick.shot))[-RECENT:]
    return replace(glance, shots=glance.shots + 1, recent=recent)


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
