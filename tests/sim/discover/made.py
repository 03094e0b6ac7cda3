"""Evidence made by hand: linear-Gaussian models whose answers are known in closed form, and random heights."""

from typing import Any, TypeVar
from unittest.mock import Mock

import numpy as np

from tests.sim.discover.worlds import FACTS
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood.data import see_outcomes
from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.infer.likelihood.score_table import Column, PlaneScores, ScoreTable, make_evidence

BORDERS = ("miss", "two", "three")
Kind = TypeVar("Kind")


def stand_in(kind: type[Kind], **fields: Any) -> Kind:
    """Something that passes for a `kind` and has these fields."""
    made: Kind = Mock(spec=kind, **fields)
    return made


def column(name: str, kind: str = "free", stage: str = "flight", usual: float = 1.0) -> Column:
    return Column(name, kind, stage, "vertical", "m/s2", usual, ("up", "down"))


def gaussian(y: np.ndarray, slopes: np.ndarray, columns: tuple[Column, ...], precision: np.ndarray | None = None,
             pull: np.ndarray | None = None) -> ScoreTable:
    """y [n] = slopes [n, P] b + unit normal noise, one number a shot, about b = 0; shared columns without a prior."""
    shared = sum(one.kind == "shared" for one in columns)
    precision = np.zeros(shared) if precision is None else precision
    return make_evidence(np.arange(len(y)), columns, np.zeros(len(columns)), slopes * y[:, None],
                         slopes[:, :, None] * slopes[:, None, :], None, np.diag(precision),
                         np.zeros(shared) if pull is None else pull, -0.5 * y**2 - 0.5 * np.log(2.0 * np.pi))


def at_least_squares(y: np.ndarray, asked: np.ndarray, shared: np.ndarray, usual: float = 1.0) -> ScoreTable:
    """The same with shared [n, p] already fitted by least squares and asked [n, K] not: terms named t0, t1, ..."""
    left = y - shared @ np.linalg.lstsq(shared, y, rcond=None)[0] if shared.size else y
    columns = (*(column(f"t{k}.amplitude", "term", usual=usual) for k in range(asked.shape[1])),
               *(column(f"s{k}", "shared") for k in range(shared.shape[1])))
    return gaussian(left, np.concatenate([asked, shared], axis=1), columns)


def heights(n: int, rng: np.random.Generator) -> Outcomes:
    """Random outcomes, some with sides, some measured instead."""
    outcome = rng.choice(BORDERS, n)
    side = np.where((outcome != "three") & (rng.random(n) < 0.4), rng.choice(("low", "high"), n), "")
    measured = np.where(rng.random(n) < 0.3, rng.normal(0.0, 0.3, n), np.nan)
    shots = Shots(tuple(map(str, range(n))), {"miss_height_m": measured},
                  {"outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())})
    return see_outcomes(shots, FACTS)[1]


def with_plane(seed: int, n: int = 12, wide: int = 4) -> ScoreTable:
    """Random evidence of tracks and, for every second shot, of heights; the last two columns shared."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, wide, wide))
    rows = np.arange(0, n, 2)
    plane = PlaneScores(rows, heights(len(rows), rng), rng.normal(0.0, 0.3, len(rows)),
                        rng.uniform(0.05, 0.3, len(rows)), rng.normal(0.0, 0.3, (len(rows), wide)),
                        rng.normal(0.0, 0.01, (len(rows), 1, wide)), rng.normal(0.0, 0.1, (len(rows), wide)))
    columns = (*(column(f"c{k}") for k in range(wide - 2)), column("a", "shared"), column("b", "shared"))
    return make_evidence(np.arange(n), columns, np.zeros(wide), rng.normal(size=(n, wide)),
                         root @ np.swapaxes(root, 1, 2), plane, np.diag([2.0, 3.0]), np.array([0.3, -0.1]),
                         rng.normal(size=n))


def make_linear(slopes: np.ndarray, columns: tuple[Column, ...], precision: np.ndarray,
                observed: np.ndarray | None = None) -> ScoreTable:
    """n shots, each with g unit-variance observations: slopes [n, g, P], observed [n, g] (default zeros)."""
    seen = np.zeros(slopes.shape[:2]) if observed is None else observed
    score = np.einsum("ngp,ng->np", slopes, seen)
    info = np.swapaxes(slopes, 1, 2) @ slopes
    return make_evidence(np.arange(len(slopes)), columns, np.zeros(len(columns)), score, info, None, np.diag(precision),
                         np.zeros(len(precision)), -0.5 * (seen**2).sum(1))


def term(name: str, usual: float = 1.0, stage: str = "launch") -> Column:
    return Column(f"{name}.amount", "term", stage, "along", "1", usual)


def shared(name: str, kind: str = "shared") -> Column:
    return Column(name, kind, "launch", "along", "1", 1.0)
