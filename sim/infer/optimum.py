"""The most probable parameters: SciPy's trust region with exact gradient and Hessian, some of them held if need be."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from truearc.sim.infer.likelihood.observations import Observations
from truearc.sim.infer.likelihood.shot_likelihood import Points, derivatives, objective
from truearc.sim.infer.parameters import Model

GRADIENT = 1e-4                       # in units of the prior's sd: far below any standard error
LEFT = 1e-5                           # nats, or standard errors squared over two
MOST_ITERATIONS = 60
FAR = 12.0                            # prior standard deviations: nothing is looked for beyond
FAR_COST = 1e4


@dataclass(frozen=True, eq=False)
class Problem:
    """What is minimised: minus the log posterior of a model given evidence, units counted by weight [n + f]."""

    model: Model
    evidence: Observations
    points: Points
    weight: np.ndarray

    def value(self, u: np.ndarray) -> float:
        """The objective; far from anything believable a steep wall, so that no step ends there."""
        value = float(objective(self.model, self.evidence, self.points, self.weight, np.asarray(u)))
        return value if np.isfinite(value) and np.abs(u).max() < FAR else FAR_COST * (1.0 + float(u @ u))

    def derivatives(self, u: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        value, gradient, hessian = derivatives(self.model, self.evidence, self.points, self.weight, np.asarray(u))
        return float(value), np.asarray(gradient), np.asarray(hessian)


@dataclass(frozen=True, eq=False)
class Optimum:
    """u [p], minus log posterior, its gradient [p] and Hessian [p, p] (of all parameters, held ones too)."""

    u: np.ndarray
    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    converged: bool


def minimise(problem: Problem, start: np.ndarray, held: tuple[int, ...] = ()) -> Optimum:
    """Go downhill from `start`, leaving the parameters `held` where they are.

    Converged: the curvature is positive, and its parabola promises no more than LEFT nats below where the search ended.
    """
    free = np.array([index for index in range(len(start)) if index not in held], dtype=int)
    whole = np.array(start, dtype=float)
    seen: dict[bytes, tuple[float, np.ndarray, np.ndarray]] = {}

    def place(part: np.ndarray) -> np.ndarray:
        u = whole.copy()
        u[free] = part
        return u

    def at(part: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        key = np.asarray(part).tobytes()
        if key not in seen:
            seen[key] = problem.derivatives(place(part))
        return seen[key]

    def value_at(part: np.ndarray) -> float:
        return problem.value(place(part))

    def gradient_at(part: np.ndarray) -> np.ndarray:
        gradient: np.ndarray = at(part)[1][free]
        return gradient

    def hessian_at(part: np.ndarray) -> np.ndarray:
        hessian: np.ndarray = at(part)[2][np.ix_(free, free)]
        return hessian

    if free.size:
        found = minimize(value_at, whole[free], method="trust-exact", jac=gradient_at, hess=hessian_at,
                         options={"gtol": GRADIENT, "maxiter": MOST_ITERATIONS, "initial_trust_radius": 0.5,
                                  "max_trust_radius": 3.0})
        whole = place(found.x)
    value, gradient, hessian = at(whole[free])
    return Optimum(whole, value, gradient, hessian, _settled(gradient[free], hessian[np.ix_(free, free)]))


def _settled(gradient: np.ndarray, hessian: np.ndarray) -> bool:
    if not gradient.size:
        return True
    if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()) or np.linalg.eigvalsh(hessian).min() <= 0.0:
        return False
    return bool(0.5 * gradient @ np.linalg.solve(hessian, gradient) < LEFT)


def best_of(problem: Problem, starts: list[np.ndarray], progress: Callable[[float, str], None]) -> Optimum:
    """The best optimum reached from any of the starts; a converged one before one that is not."""
    found: list[Optimum] = []
    for number, start in enumerate(starts):
        progress(number / len(starts), f"start {number + 1} of {len(starts)}")
        found.append(minimise(problem, start))
    return min(found, key=lambda one: (not one.converged, one.value))
