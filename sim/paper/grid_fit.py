"""The paper's coefficient search (section III-A and IV-C): every pair of drag and lift coefficient on a square grid."""

from dataclasses import dataclass, replace

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.grid_cells import THREE as LABEL_THREE
from truearc.sim.paper.grid_labels import Flyer, Hits, find_hits, fly_pairs, make_flyer
from truearc.sim.paper.settings import HIGH, LOW, STEP
from truearc.sim.physics.simulate import THREE, TWO, launch_of, require
from truearc.sim.printed import Progress

MAX_PARTS = 10000                     # of the range: a hundred times the paper's pairs


@dataclass(frozen=True)
class GridFit:
    """The map over the grid and the pair chosen from it. Maps are [len(axis), len(axis)]: row = cd, column = cl.

    `share_three`: of the shots whose outcome is three, those flown within the three's bounds. `share_two`: of those
    whose outcome is two or three, those flown within the two's. `tied`: best in share_three, and among those in
    share_two. `ties` [k, 4]: cd, cl, mean and median of |height - centre| in m over the shots whose outcome is three,
    for each tied pair, the chosen one first; infinite where a shot (for the median: half of them) is not reached.
    """

    axis: np.ndarray
    share_three: np.ndarray
    share_two: np.ndarray
    tied: np.ndarray
    ties: np.ndarray
    cd: float                         # the chosen pair, and its deviations
    cl: float
    mean_m: float
    median_m: float
    median_pair: tuple[float, float]  # (cd, cl) of the least median deviation among the tied
    shots_three: int
    shots_two: int
    hits: Hits

    @property
    def coefficients(self) -> dict[str, dict[str, float]]:
        return {"drag": {"cd": self.cd}, "magnus": {"cl": self.cl}}


@dataclass(frozen=True)
class Scoring:
    """The shots that the paper's measures count, ready to fly."""

    flyer: Flyer
    is_three: np.ndarray              # [launches]; the others' outcome is two
    target: tuple[float, float, float]  # centre, three's and two's half height in m

    def deviation_m(self, cd: np.ndarray, cl: np.ndarray) -> np.ndarray:
        """|height - centre| [pairs, shots whose outcome is three], infinite where not reached."""
        threes = replace(self.flyer, launch=self.flyer.launch[self.is_three])
        return np.nan_to_num(np.abs(fly_pairs(threes, cd, cl) - self.target[0]), nan=np.inf)


def fit_grid(rig: Rig, shots: Shots, step: float = STEP, progress: Progress = lambda done, note: None) -> GridFit:
    """Fly every scoring shot with every pair of the grid and choose as the paper does.

    First the share of three-point shots flown into the three, then of scoring shots into the two, then the least mean
    deviation (and least median, cd, cl, should that tie too). Shots whose outcome is miss or unknown play no part: the
    paper's measures do not count them. InputError: no shot with outcome three, no target, a step that does not divide
    5, or no pair that puts a single shot where it went.
    """
    axis = make_axis(step)
    progress(0.0, "the law of motion is compiled when it is new")
    scoring = make_scoring(rig, shots)
    hits = find_hits(scoring.flyer, axis, scoring.target, progress)
    three, two = count_hits(hits, scoring.is_three, axis.size)
    if not two.any():
        raise InputError("no pair of coefficients puts any of the scoring shots into the target: distances, launch, "
                       "release height and target of rig.toml cannot all be right")
    tied = (three == three.max()) & (two == two[three == three.max()].max())
    ties = rank_ties(scoring, axis, np.flatnonzero(tied.ravel()))
    median_pair = ties[np.lexsort((ties[:, 1], ties[:, 0], ties[:, 3]))[0], :2]
    cd, cl, mean_m, median_m = ties[0].tolist()
    threes = int(scoring.is_three.sum())
    return GridFit(axis, three.T / threes, two.T / len(scoring.is_three), tied.T, ties, cd, cl, mean_m, median_m,
                   (float(median_pair[0]), float(median_pair[1])), threes, len(scoring.is_three) - threes, hits)


def make_axis(step: float) -> np.ndarray:
    """The grid's values of one coefficient; InputError when the step does not divide the range."""
    parts = (HIGH - LOW) / step if step > 0.0 else 0.0
    if not parts <= MAX_PARTS:
        raise InputError(f"--step: {step:g} is too fine; {(HIGH - LOW) / MAX_PARTS:g} is the least")
    if parts < 1.0 or abs(parts - round(parts)) > 1e-6:
        raise InputError(f"--step: {step:g} does not divide the range {LOW:g} to {HIGH:g}")
    return np.linspace(LOW, HIGH, round(parts) + 1)


def make_scoring(rig: Rig, shots: Shots) -> Scoring:
    """The shots whose outcome is two or three; InputError when none is a three or the rig has no target."""
    if rig.target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": the fit is by outcomes")
    outcome = np.array(shots.text("outcome"))
    if not (outcome == THREE).any():
        raise InputError(f"{shots.source}: outcome: fit by grid needs at least one shot whose outcome is three")
    scoring = shots.take(np.flatnonzero((outcome == THREE) | (outcome == TWO)))
    flyer = make_flyer(rig, launch_of(rig, scoring), require(scoring, "distance_m"))
    target = (rig.target.centre_height_m, rig.target.three_half_height_m, rig.target.two_half_height_m)
    return Scoring(flyer, np.array(scoring.text("outcome")) == THREE, target)


def count_hits(hits: Hits, is_three: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Maps [cl, cd]: three-shots flown into the three, and all shots flown into the two."""
    in_three = (hits.label >= LABEL_THREE) & is_three[hits.launch]
    three, two = (np.bincount(pair, minlength=points**2) for pair in (hits.pair[in_three], hits.pair))
    return three.reshape(points, points), two.reshape(points, points)


def rank_ties(scoring: Scoring, axis: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """GridFit.ties of pairs given as indices of [cl, cd] laid flat."""
    cl, cd = axis[pairs // axis.size], axis[pairs % axis.size]
    deviation_m = scoring.deviation_m(cd, cl)
    mean_m, median_m = deviation_m.mean(axis=1), np.median(deviation_m, axis=1)
    return np.stack([cd, cl, mean_m, median_m], axis=1)[np.lexsort((cl, cd, median_m, mean_m))]


def map_deviation(rig: Rig, shots: Shots, cd: np.ndarray, cl: np.ndarray) -> np.ndarray:
    """Mean deviation in m of the shots whose outcome is three at each pair, infinite where one is not reached.

    cd and cl are arrays of one shape, and so is the result. Flies every pair: about a microsecond each and shot.
    """
    mean_m: np.ndarray = make_scoring(rig, shots).deviation_m(np.ravel(cd), np.ravel(cl)).mean(axis=1)
    return mean_m.reshape(np.shape(cd))
