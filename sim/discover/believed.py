"""The believed simulation fitted to a dataset: coefficients and scatter that all shots share."""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from sim.discover import outcomes
from sim.discover.chain import Chain, see
from sim.discover.evidence import Array, Evidence
from sim.discover.intake import Intake
from sim.discover.linear import Layout, Spot, linearise, nowhere, pad_lanes

Progress = Callable[[float, str], None]
GRID = (-1.0, -0.5, 0.0, 0.5, 1.0)    # of each coefficient's prior, in standard deviations, where the fit may start
MOST_GRID = 3                         # coefficients that are gridded; more start from the prior's centre
SCATTER_GRID = (1.0, 3.0, 10.0)       # times the usual one
USUAL_SPEED = 0.015
ROUNDS = 40
HALVINGS = 8
SETTLED = 1e-3                        # nats
LEAST_ROUNDS = 2                      # with tracks, whose shots' own deviations must settle too
SLACK = 0.3                           # nats a step may lose: scores leave out that slopes change the spread, too


@dataclass(frozen=True)
class Fitted:
    """The believed simulation at its best: where, and the evidence there with the columns asked for."""

    intake: Intake
    layout: Layout
    spot: Spot
    evidence: Evidence

    @property
    def values(self) -> dict[str, float]:
        """{shared column: value}; scatters themselves, not their logs."""
        first = self.evidence.first_shared
        named = zip(self.evidence.columns[first:], self.evidence.point[first:], strict=True)
        return {column.name: float(np.exp(value) if column.name.startswith("scatter.") else value)
                for column, value in named if column.kind != "group"}


def fit_believed(intake: Intake, layout: Layout, progress: Progress = lambda done, note: None) -> Fitted:
    """Most probable shared columns by Newton's method with halved steps, relinearised at every step."""
    bare = only_shared(layout)
    spot, _ = climb(intake, bare, _start(intake, layout), progress)
    progress(0.9, "slopes")
    whole, _ = linearise(intake, layout, spot)
    return Fitted(intake, layout, spot, whole)


def climb(intake: Intake, layout: Layout, spot: Spot,
          progress: Progress = lambda done, note: None) -> tuple[Spot, Evidence]:
    """Uphill in all columns of the layout, which must all be shared ones, until a step is far below their doubt."""
    evidence, deviates = linearise(intake, layout, spot)
    best = objective(evidence, layout)
    for number in range(ROUNDS):
        progress(0.9 * number / ROUNDS, "fit")
        step, worth = newton_step(evidence)
        if worth < SETTLED and number >= LEAST_ROUNDS * (intake.samples is not None):
            break
        for halving in range(HALVINGS):
            tried = moved(layout, replace(spot, deviates=deviates), step * 0.5**halving)
            there, found = linearise(intake, layout, tried)
            value = objective(there, layout)
            if value >= best - SLACK:
                break
        else:
            break
        best, spot, evidence, deviates = value, tried, there, found
    return spot, evidence


def newton_step(evidence: Evidence) -> tuple[Array, float]:
    """(Fisher scoring step [P] for layouts of shared columns only, nats that it promises)."""
    info, slope = evidence.info.sum(0) + np.diag(evidence.precision), evidence.score.sum(0) + evidence.pull
    step = np.linalg.solve(info + 1e-12 * np.diag(np.diag(info) + 1e-12), slope)
    return step, 0.5 * float(step @ slope)


def objective(evidence: Evidence, layout: Layout) -> float:
    """Log posterior, up to a constant."""
    off = evidence.point[evidence.first_shared:] - layout.centre
    value = float(evidence.log_score.sum() - 0.5 * (layout.precision * off**2).sum())
    return value if np.isfinite(value) else -np.inf


def moved(layout: Layout, spot: Spot, change: Array) -> Spot:
    """The spot after its columns change by `change` [P]; log scatters by no more than 1 at a time."""
    values, log_scatter = spot.values.copy(), spot.log_scatter.copy()
    slots = (layout.source >= 0) & (layout.source < len(layout.chain.slots))
    values[layout.source[slots]] += change[slots]
    for number, column in enumerate(layout.scatters):
        if column >= 0:
            log_scatter[number] = np.clip(log_scatter[number] + np.clip(change[column], -1.0, 1.0), -9.0, 1.0)
    return Spot(values, log_scatter, spot.deviates, spot.effects + change[layout.source == -2])


def only_shared(layout: Layout, more: Iterable[str] = ()) -> Layout:
    """The layout without free columns and terms, but for the named ones, which become shared with their usual size
    as a prior."""
    first = len(layout.columns) - len(layout.precision)
    wanted = set(more)
    named = [k for k, column in enumerate(layout.columns[:first]) if column.name in wanted]
    kept = [*named, *range(first, len(layout.columns))]
    place = {column: number for number, column in enumerate(kept)}
    precision = np.concatenate([[layout.columns[k].usual**-2.0 for k in named], layout.precision])
    return Layout(layout.chain, tuple(layout.columns[k] for k in kept), layout.source[kept],
                  tuple(place.get(column, -1) for column in layout.scatters), precision,
                  np.concatenate([np.zeros(len(named)), layout.centre]), layout.edges_s, layout.groups)


def _start(intake: Intake, layout: Layout) -> Spot:
    """The best of a grid over up to MOST_GRID coefficients, by outcomes; the prior's middle without outcomes."""
    chain = layout.chain
    first = len(layout.columns) - len(layout.precision)
    values = np.array([default_of(chain, slot) for slot in chain.slots])
    shared = [k for k in range(first, len(layout.columns)) if 0 <= layout.source[k] < len(chain.slots)]
    for k in shared:
        values[layout.source[k]] = layout.centre[k - first]
    log_scatter = np.log([USUAL_SPEED, 0.007, 0.007])
    if len(intake.marked) < 5:
        return nowhere(intake, layout, values, log_scatter)
    axes = [(layout.source[k], layout.centre[k - first], layout.precision[k - first]**-0.5) for k in shared][:MOST_GRID]
    found = [(-np.inf, nowhere(intake, layout, values, log_scatter))]
    for steps in itertools.product(GRID, repeat=len(axes)):
        tried = values.copy()
        for step, (slot, centre, sd) in zip(steps, axes, strict=True):
            tried[slot] = centre + step * sd
        found += [(value - 0.5 * sum(step**2 for step in steps), spot)
                  for value, spot in _rough(intake, layout, tried, log_scatter)]
    return max(found, key=lambda pair: pair[0])[1]


def _rough(intake: Intake, layout: Layout, values: Array, log_scatter: Array) -> list[tuple[float, Spot]]:
    """Log-likelihood of the outcomes at some sizes of one scatter of the height."""
    lanes, n = pad_lanes(intake.lanes)
    chain = layout.chain
    flying = replace(chain, track=False)
    seen = see(flying, lanes, jnp.asarray(values), np.zeros((len(lanes.distance_m), flying.deviates)),
               jnp.zeros(max(chain.bands - 1, 0)))
    mean, near = np.asarray(seen.plane)[:n, 0][intake.marked], np.asarray(seen.near)[:n][intake.marked]
    mean = np.where(near, mean, -10.0)
    spot = nowhere(intake, layout, values, log_scatter)
    made = []
    for factor in SCATTER_GRID:
        value = outcomes.log_likelihood(intake.seen, mean, np.full(len(mean), 0.08 * factor)).sum()
        made.append((float(value), replace(spot, log_scatter=log_scatter + np.log(factor))))
    return made


def default_of(chain: Chain, slot: tuple[str, str]) -> float:
    """The value of a parameter that nobody speaks of."""
    from sim.physics.catalogue import find_parameter
    return float(find_parameter(".".join(slot)).default)
