"""The most probable parameters: SciPy's trust region with exact gradient and Hessian, some of them held if need be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from truearc.sim.infer.likelihood.observations import Observations
from truearc.sim.infer.likelihood.shot_likelihood import Points, derivatives, objective
from truearc.sim.infer.parameters import Model
from truearc.sim.progress import Progress

GRADIENT = 1e-4                       # in units of the prior's sd: far below any standard error
LEFT = 1e-5                           # nats, or standard errors squared over two
MOST_ITERATIONS = 60
FAR = 12.0                            # prior standard deviations: nothing is looked for beyond
FAR_COST = 1e4


@dataclass(frozen=True, eq=False)
class Problem:
    """The minimisation problem: minus the log posterior of a model given evidence, units counted by weight."""

    model: Model
    evidence: Observations
    points: Points
    weight: Float[np.ndarray, " units"]

    def value(self, u: Float[np.ndarray, " p"]) -> float:
        """The objective; far from anything believable a steep wall, so that no step ends there."""
        value = float(objective(self.model, self.evidence, self.points, self.weight, np.asarray(u)))
        return value if np.isfinite(value) and np.abs(u).max() < FAR else FAR_COST * (1.0 + float(u @ u))

    def derivatives(self, u: Float[np.ndarray, " p"]) -> tuple[float, Float[np.ndarray, " p"],
                                                               Float[np.ndarray, "p p"]]:
        value, gradient, hessian = derivatives(self.model, self.evidence, self.points, self.weight, np.asarray(u))
        return float(value), np.asarray(gradient), np.asarray(hessian)


@dataclass(frozen=True, eq=False)
class Optimum:
    """u, minus log posterior, and its Hessian (of all parameters, held ones too)."""

    u: Float[np.ndarray, " p"]
    value: float
    hessian: Float[np.ndarray, "p p"]
    converged: bool


def minimise(problem: Problem, start: Float[np.ndarray, " p"], held: tuple[int, ...] = ()) -> Optimum:
    """Go downhill from `start`, leaving the parameters `held` where they are.

    Converged: the curvature is positive, and its parabola promises no more than LEFT nats below where the search ended.
    """
    free = np.array([index for index in range(len(start)) if index not in held], dtype=int)
    whole = np.array(start, dtype=float)
    seen: dict[bytes, tuple[float, Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]] = {}

    def place(part: Float[np.ndarray, " free"]) -> Float[np.ndarray, " p"]:
        u = whole.copy()
        u[free] = part
        return u

    def at(part: Float[np.ndarray, " free"]) -> tuple[float, Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
        key = np.asarray(part).tobytes()
        if key not in seen:
            seen[key] = problem.derivatives(place(part))
        return seen[key]

    def value_at(part: Float[np.ndarray, " free"]) -> float:
        return problem.value(place(part))

    def gradient_at(part: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        return np.asarray(at(part)[1][free])

    def hessian_at(part: Float[np.ndarray, " free"]) -> Float[np.ndarray, "free free"]:
        return np.asarray(at(part)[2][np.ix_(free, free)])

    if free.size:
        found = minimize(value_at, whole[free], method="trust-exact", jac=gradient_at, hess=hessian_at,
                         options={"gtol": GRADIENT, "maxiter": MOST_ITERATIONS, "initial_trust_radius": 0.5,
                                  "max_trust_radius": 3.0})
        whole = place(found.x)
    value, gradient, hessian = at(whole[free])
    return Optimum(whole, value, hessian, _settled(gradient[free], hessian[np.ix_(free, free)]))


def _settled(gradient: Float[np.ndarray, " free"], hessian: Float[np.ndarray, "free free"]) -> bool:
    if not gradient.size:
        return True
    if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()) or np.linalg.eigvalsh(hessian).min() <= 0.0:
        return False
    return bool(0.5 * gradient @ np.linalg.solve(hessian, gradient) < LEFT)


def best_of(problem: Problem, starts: list[Float[np.ndarray, " p"]], progress: Progress) -> Optimum:
    """The best optimum reached from any of the starts; a converged one before one that is not."""
    found: list[Optimum] = []
    for number, start in enumerate(starts):
        progress(number / len(starts), f"start {number + 1} of {len(starts)}")
        found.append(minimise(problem, start))
    return min(found, key=lambda one: (not one.converged, one.value))
