"""Which flight of a clip is which shot of a recording, by the pattern of their times.

The clocks of camera and robot differ by an offset, which is sought, and by a drift of some millionths. A flight may
belong to no recorded shot, and a shot may not have been seen. Every offset that puts a flight onto a shot is a
hypothesis; its log-likelihood counts residuals, flights without a shot and shots without a flight. Before the first and
after the last recorded shot, flights without a shot are as likely as others: teams shoot before they record. The best
hypothesis is used only if it is a thousand times as likely as the next, and as chance.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearc.errors import InputError
from truearc.sim.printed import Printed
from truearc.sim.video.ballistics import Floats

JITTERS_S = (0.01, 0.03, 0.1)         # from the command to feed until the ball is seen, shot to shot
DRIFT_SD = 2e-4                       # of two quartz clocks, one of them warm
SEEN = 0.8                            # probability that a shot in view is found
STRAY = 0.1                           # flights that belong to no shot, among recorded ones: a share of all
SURE_NATS = float(np.log(1000.0))     # by which the best offset must be ahead of the next, and of chance
REACH = 3.5                           # jitters between flight and shot
FEWEST = 3                            # flights that can make a pattern
REFINED = 40                          # offsets that are looked at closely
ROUNDS = 6                            # of assignment and least squares
BLOCK = 2000                          # offsets at a time


class Shift(NamedTuple):
    """One hypothesis.

    Fields:
        offset_s: Robot time less clip time at the clip's first flight.
        drift: Rate of the robot's clock less the clip's, as a share.
        shots: Row of the shot of each flight, -1 for none [n].
        nats: Log-likelihood.
        jitter_s: That fits best.
    """

    offset_s: float
    drift: float
    shots: npt.NDArray[np.int64]
    nats: float
    jitter_s: float

    @property
    def matched(self) -> int:
        """Number of flights that have a shot."""
        return int((self.shots >= 0).sum())


@dataclass(frozen=True)
class Matching(Printed):
    """The best offset between a clip and a recording, and the next.

    best, rival: None if no flight can be put onto a shot, or there is no other way.
    ahead_nats: By which the best is ahead of the next, or of chance if that is less.
    refusal: Why nothing is matched; empty if the best is used.
    """

    best: Shift | None
    rival: Shift | None
    ahead_nats: float
    refusal: str = ""

    @property
    def shots(self) -> npt.NDArray[np.int64]:
        """Row of the shot of each flight, -1 for none; all -1 after a refusal."""
        if self.best is None:
            return np.zeros(0, dtype=np.int64)
        return self.best.shots if not self.refusal else np.full_like(self.best.shots, -1)

    def lines(self) -> list[str]:
        if self.refusal or self.best is None:
            return [f"not matched: {self.refusal}"]
        of = len(self.best.shots)
        next_ = (f"{_times(self.ahead_nats)} as likely as the next, {_worded(self.rival)}" if self.rival is not None
                 else f"{_times(self.ahead_nats)} as likely as chance")
        return [f"matched {self.best.matched} of {of} flights: {_worded(self.best)}, "
                f"drift {1e6 * self.best.drift:+.0f} millionths; {next_}"]


def match_times(flight_s: Floats, shot_s: Floats, begin_s: float, end_s: float) -> Matching:
    """Match flights of one clip to shots of one recording.

    Args:
        flight_s: Times at which flights begin, on the clip's clock, rising [n].
        shot_s: Times at which balls were fed, on the robot's clock, rising [m].
        begin_s: When the clip begins, on its clock.
        end_s: When it ends.
    """
    if len(flight_s) < FEWEST or len(shot_s) < FEWEST:
        return Matching(None, None, 0.0, f"{len(flight_s)} flights and {len(shot_s)} shots have no pattern of times; "
                        f"at least {FEWEST} of each are needed, or --by-order")
    tried = [_refined(flight_s, shot_s, begin_s, end_s, offset) for offset in _offsets(flight_s, shot_s)]
    ranked = sorted((shift for shift in tried if shift.matched), key=lambda shift: -shift.nats)
    if not ranked:
        return Matching(None, None, 0.0, "no flight can be put onto a shot")
    best = ranked[0]
    rival = next((shift for shift in ranked[1:] if _differ(shift, best)), None)
    # chance: no flight is a recorded shot's, among as many offsets as were possible
    chance = len(flight_s) * np.log(_rate(flight_s, begin_s, end_s)) + np.log(len(flight_s) * len(shot_s))
    over_chance = best.nats - float(chance)
    ahead = min(over_chance, np.inf if rival is None else best.nats - rival.nats)
    if over_chance < SURE_NATS or best.matched < FEWEST:
        return Matching(best, rival, ahead, f"{best.matched} of {len(flight_s)} flights fit a shot at best, as chance "
                        "would have it: is it the recording of this clip?")
    if ahead < SURE_NATS and rival is not None:
        return Matching(best, rival, ahead, f"{_worded(best)} and {_worded(rival)} fit alike (the first "
                        f"{_times(ahead)} as likely): film without gaps from the first shot on, wait unevenly between "
                        "shots, or use --by-order")
    return Matching(best, rival, ahead)


def match_by_order(flights: int, shots: int) -> npt.NDArray[np.int64]:
    """Return rows of the shots of flights where the first flight is the first shot, and so on.

    Raises:
        InputError: their numbers differ.
    """
    if flights != shots:
        raise InputError(f"--by-order: {flights} flights and {shots} shots; their numbers must be equal")
    return np.arange(flights)


def _offsets(flight_s: Floats, shot_s: Floats) -> list[float]:
    """The offsets that put the most flights near shots, each of another place."""
    pairs = np.unique(np.round((shot_s[:, None] - flight_s[None]).ravel(), 3))
    reach = REACH * JITTERS_S[-1] / 2.0 + DRIFT_SD * np.ptp(flight_s)
    near = np.empty(len(pairs))
    for first in range(0, len(pairs), BLOCK):
        block = pairs[first:first + BLOCK, None] + flight_s
        gap = np.abs(block - shot_s[_nearest(shot_s, block)])
        near[first:first + BLOCK] = np.clip(1.0 - gap / reach, 0.0, None).sum(axis=1)
    found: list[float] = []
    for k in np.argsort(-near, kind="stable"):
        if all(abs(pairs[k] - other) > reach / 2.0 for other in found):
            found.append(float(pairs[k]))
        if len(found) == REFINED:
            break
    return found


def _nearest(shot_s: Floats, times: Floats) -> npt.NDArray[np.int64]:
    after = np.clip(np.searchsorted(shot_s, times), 1, len(shot_s) - 1)
    return after - (times - shot_s[after - 1] <= shot_s[after] - times)


def _refined(flight_s: Floats, shot_s: Floats, begin_s: float, end_s: float, offset_s: float) -> Shift:
    """The likeliest hypothesis near an offset, over all jitters."""
    tried = [_settled(flight_s, shot_s, begin_s, end_s, offset_s, jitter_s) for jitter_s in JITTERS_S]
    best = max(tried, key=lambda shift: shift.nats)
    return best._replace(nats=float(np.logaddexp.reduce([shift.nats for shift in tried]) - np.log(len(tried))))


def _settled(flight_s: Floats, shot_s: Floats, begin_s: float, end_s: float, offset_s: float, jitter_s: float) -> Shift:
    """Assign and fit in turn, from the widest jitter to this one."""
    since, drift = flight_s - flight_s[0], 0.0
    shots = np.full(len(flight_s), -1)
    for number in range(ROUNDS):
        now = max(jitter_s, JITTERS_S[-1] * 0.5 ** number)
        shots = _assigned(flight_s + offset_s + drift * since, shot_s, REACH * now)
        has = shots >= 0
        if not has.any():
            break
        # the offset is free, the drift has its prior
        rows = np.stack([np.ones(has.sum()), since[has]], axis=1)
        normal = rows.T @ rows / jitter_s ** 2 + np.diag([0.0, DRIFT_SD ** -2])
        offset_s, drift = np.linalg.solve(normal, rows.T @ (shot_s[shots[has]] - flight_s[has]) / jitter_s ** 2)
    nats = _nats(flight_s + offset_s + drift * since, shots, shot_s, jitter_s,
                 (begin_s + offset_s, end_s + offset_s), _rate(flight_s, begin_s, end_s))
    return Shift(float(offset_s), float(drift), shots, nats - 0.5 * (drift / DRIFT_SD) ** 2, jitter_s)


def _assigned(times: Floats, shot_s: Floats, reach: float) -> npt.NDArray[np.int64]:
    """The shot of each time: each the other's nearest, and within reach; -1 for none."""
    shots = _nearest(shot_s, times)
    back = _nearest(times, shot_s) if len(times) > 1 else np.zeros(len(shot_s), dtype=np.int64)
    mutual = back[shots] == np.arange(len(times))
    return np.where(mutual & (np.abs(times - shot_s[shots]) <= reach), shots, -1)


def _nats(times: Floats, shots: npt.NDArray[np.int64], shot_s: Floats, jitter_s: float, view_s: tuple[float, float],
          rate: float) -> float:
    """Log-likelihood of flights at these times on the robot's clock."""
    has = shots >= 0
    off = (times[has] - shot_s[shots[has]]) / jitter_s
    seen = has.sum() * np.log(SEEN / jitter_s / np.sqrt(2.0 * np.pi)) - 0.5 * (off ** 2).sum()
    recorded = (times > shot_s[0]) & (times < shot_s[-1])
    stray = (~has & recorded).sum() * np.log(STRAY * rate) + (~has & ~recorded).sum() * np.log(rate)
    in_view = (shot_s > view_s[0]) & (shot_s < view_s[1])
    in_view[shots[has]] = False
    return float(seen + stray + in_view.sum() * np.log(1.0 - SEEN))


def _rate(flight_s: Floats, begin_s: float, end_s: float) -> float:
    return len(flight_s) / max(end_s - begin_s, float(np.ptp(flight_s)), 1e-3)


def _differ(one: Shift, other: Shift) -> bool:
    """Whether at least one flight has different shots: then the two are not one hypothesis."""
    both = (one.shots >= 0) & (other.shots >= 0)
    return bool((one.shots[both] != other.shots[both]).any()) or not both.any()


def _worded(shift: Shift) -> str:
    return f"clip + {shift.offset_s:.2f} s ({shift.matched} flights within {1000.0 * shift.jitter_s:.0f} ms)"


def _times(nats: float) -> str:
    return f"{np.exp(nats):.1f} times" if nats < np.log(100.0) else f"e^{nats:.0f} times"
