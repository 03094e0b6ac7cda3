"""An always-valid test for a change since a belief was formed, which may be evaluated after every shot.

The statistic is an e-value: the probability of all outcomes so far if something changed at some shot, divided by their
probability if nothing changed. If nothing changed, it exceeds 1 / alpha at any shot of an endless session with
probability at most alpha (Ville 1939; Ramdas et al. 2023, "Game-theoretic statistics and safe anytime-valid
inference"). A session may therefore be tested, and stopped, after any shot.

Both probabilities are means over the same posterior draws of the belief's numbers, so that an error within the belief's
uncertainty is not a change. The numerator is also a mean over directions (every candidate term, launch, distance and
push), over sizes, and over the shot at which the change begins; the cost per shot is constant. The test is exact for
these draws; heights are linear in all numbers, as in the score table. The settings of a shot may depend on earlier
outcomes.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri
from scipy.stats import qmc

from truearc.sim.infer.likelihood.score_table import ScoreTable

DRAWS = 256                           # of the belief's numbers; a power of 2, by a Sobol sequence
# Chosen, as AT_ONCE and HAZARD: the promised rate holds for any (Ville 1939). What these cost in shots to the alarm:
# docs/measured/README.md, python -m benchmarks.follow
SIZES = np.array([0.15, 0.4, 1.0, 2.5])       # of a change, in usual ones, either way
# Chosen: no preference
AT_ONCE = 0.5                         # probability that a change was there at the first shot, if there is one
# Chosen: once in a hundred shots, a session
HAZARD = 0.01                         # that it comes with the next shot, if it was not


@dataclass(frozen=True, eq=False)
class ChangeTest:
    """A test over m shots with an outcome or a height, in order.

    rows [m]: in the dataset; e_value [m] after each; directions: names of what may have changed.
    """

    rows: Int[np.ndarray, " m"]
    e_value: Float[np.ndarray, " m"]
    directions: tuple[str, ...]
    work: "_Work"

    def alarm(self, false_alarm: float) -> int | None:
        """Place of the first alarm among the m shots; None if there is none."""
        above = np.flatnonzero(self.e_value >= 1.0 / false_alarm)
        return int(above[0]) if len(above) else None

    def since(self, last: int) -> tuple[int, Float[np.ndarray, " k"]]:
        """Return (the likeliest shot of the change given the shots up to place `last`; the probability of each place
        [last + 1], with a uniform prior)."""
        likely = self.work.starts(last)
        return int(np.argmax(likely)), likely / likely.sum()


def test_change(evidence: ScoreTable, seed: int = 0, but: Collection[str] = ()) -> ChangeTest:
    """Test the shots of a score table made at the belief's mean, with the belief's posterior as prior of its shared
    columns.

    Tracks are not used. but: terms that are not among the directions. ValueError if no shot has an outcome or a height.
    """
    work = _Work.of(evidence, seed, but)
    e_value = work.run()
    assert evidence.plane is not None
    names = tuple(evidence.columns[k].name for k in work.directions)
    return ChangeTest(evidence.rows[evidence.plane.rows], e_value, names, work)


test_change.__test__ = False          # type: ignore[attr-defined]  # not one of pytest's


def directions_of(evidence: ScoreTable, but: Collection[str] = ()) -> Int[np.ndarray, " K"]:
    """Return columns of terms and of free changes that are equal in all shots, if any height depends on them."""
    assert evidence.plane is not None
    own = [k for k, column in enumerate(evidence.columns[:evidence.first_shared])
           if (column.kind == "term" or not column.follows) and column.term not in but]
    moves = np.abs(evidence.plane.by_column).max(0) + np.abs(evidence.plane.moved_by).max((0, 1))
    return np.array([k for k in own if moves[k] > 0.0], dtype=int)


@dataclass(frozen=True, eq=False)
class _Work:
    """Observables as drawn: mean_m, spread_m [m, S] of each draw, and moved [m, S] of each further number of Outcomes;
    shift_m, grown [m, K B] by each direction and size; before [m, S], filled by `run`: weight of each draw before each
    shot."""

    scores: ScoreTable
    directions: Int[np.ndarray, " K"]
    mean_m: Float[np.ndarray, "m S"]
    spread_m: Float[np.ndarray, "m S"]
    moved: tuple[Float[np.ndarray, "m S"], ...]
    shift_m: Float[np.ndarray, "m KB"]
    grown: tuple[Float[np.ndarray, "m KB"], ...]
    before: Float[np.ndarray, "m S"]

    @staticmethod
    def of(evidence: ScoreTable, seed: int, but: Collection[str]) -> "_Work":
        plane = evidence.plane
        if plane is None:
            raise ValueError("no shot has an outcome or a height at the target")
        numbers = np.asarray(drawn(evidence, seed))
        place = evidence.deal.place[plane.rows][:, evidence.first_shared:] - evidence.first_shared
        mine = numbers[:, place]                                     # [S, m, C - first]
        further = np.moveaxis(plane.moved_by, 1, 0)
        mean, log_spread, *moved = (np.einsum("smc,mc->ms", mine, by[:, evidence.first_shared:]) for by in (
            plane.by_column, plane.log_spread_by, *further))
        among = directions_of(evidence, but)
        usual = np.array([evidence.columns[k].usual for k in among])
        sizes = np.concatenate([-SIZES, SIZES])
        m = len(plane.rows)
        shift, *grown = (((by[:, among] * usual)[:, :, None] * sizes).reshape(m, -1)
                         for by in (plane.by_column, *further))
        return _Work(evidence, among, plane.mean_m[:, None] + mean,
                     plane.spread_m[:, None] * np.exp(np.clip(log_spread, -2.0, 2.0)), tuple(moved), shift,
                     tuple(grown), np.zeros(mean.shape))

    def run(self) -> Float[np.ndarray, " m"]:
        """The e-values [m]."""
        m, draws = self.mean_m.shape
        weight, changed = np.full(draws, 1.0 / draws), np.zeros((draws, self.shift_m.shape[1]))
        rest, e_value = 1.0, np.zeros(m)
        for shot in range(m):
            self.before[shot] = weight
            now = rest * (AT_ONCE if shot == 0 else HAZARD)
            rest -= now
            same, other = self._chances(shot)
            told = weight @ same
            changed = (changed + now * weight[:, None]) * other / told
            weight = weight * same / told
            e_value[shot] = changed.sum() / changed.shape[1] + rest
        return e_value

    def starts(self, last: int) -> Float[np.ndarray, " k"]:
        """Likelihood [last + 1] of the outcomes up to `last` if the change came with each shot, over none."""
        likely, ratio = np.zeros(last + 1), np.ones((self.mean_m.shape[1], self.shift_m.shape[1]))
        for shot in range(last, -1, -1):
            same, other = self._chances(shot)
            ratio *= other / (self.before[shot] @ same)
            likely[shot] = (self.before[shot] @ ratio).mean()
        return likely

    def _chances(self, shot: int) -> tuple[Float[np.ndarray, " S"], Float[np.ndarray, "S KB"]]:
        """Likelihood of a shot's outcome by each draw, unchanged and changed."""
        assert self.scores.plane is not None
        seen, mean, spread = self.scores.plane.seen, self.mean_m[shot], self.spread_m[shot]
        moved = [part[shot] for part in self.moved]
        changed = [part[:, None] + grown[shot] for part, grown in zip(moved, self.grown, strict=True)]
        return seen.chance(shot, mean, spread, moved), seen.chance(shot, mean[:, None] + self.shift_m[shot],
                                                                   spread[:, None], changed)


def drawn(evidence: ScoreTable, seed: int) -> Float[np.ndarray, "S p"]:
    """Draw departures of the shared columns from the belief's mean, from its posterior."""
    precision = evidence.precision
    root = np.linalg.cholesky(np.linalg.inv(precision))
    uniform = qmc.Sobol(len(precision), seed=seed).random(DRAWS)
    return np.asarray(ndtri(np.clip(uniform, 1e-9, 1.0 - 1e-9)) @ root.T)
