"""Unexplained changes as part of the simulation: which nameless term holds one, and its evidence once it is flown.

Scores at the fit guess what a large change is worth too high; a name's evidence comes from a true refit, and an
unexplained change that rivals it is judged alike.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.sim.discover.select.hypotheses import KNOTS, Part
from truearc.sim.discover.select.refit import log_evidence_at
from truearc.sim.infer.belief import Curve
from truearc.sim.infer.fit import BaselineFit, climb, objective, usual_spot
from truearc.sim.infer.likelihood.data import Intake
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout, only_shared, with_curve
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.physics.nonparametric import find_nameless

TERMS = {"launch speed": ("free_speed", {"share": 1.0}), "launch elevation": ("free_elevation", {"angle_rad": 1.0}),
         "distance": ("free_distance", {"bias_m": 1.0})}
SIDES = {"along": "along", "vertical": "up", "lateral": "left"}
LONGEST_S = 60.0


def term_of(column: Column, layout: ParameterLayout) -> tuple[str, dict[str, float]] | None:
    """The nameless term, with its numbers, that changes what the column does; None where there is none, or where the
    layout has it already."""
    if column.name in TERMS:
        name, values = TERMS[column.name]
        values = dict(values)
    elif column.name.startswith("push "):
        name, values = "free_push", {"size_m_s2": 1.0, SIDES[column.direction]: 1.0}
        if column.times_s is not None:
            values |= {"from_s": column.times_s[0], "to_s": min(column.times_s[1], LONGEST_S)}
        elif column.follows:
            values |= {"with_speed": 1.0}
    else:
        return None
    return None if name in layout.chain.terms else (name, values)


def climb_with(fitted: BaselineFit, term: str, values: dict[str, float], curve: Curve,
               by: Float[Array, "n points"]) -> tuple[Intake, ParameterLayout, LinearizationPoint, ScoreTable]:
    """(intake, layout, top, evidence of the shared columns there) of the simulation with a curve of these shapes,
    uphill from a curve of zero: a step on slopes may lead to where the flown simulation is worse than without it."""
    lanes = fitted.intake.lanes
    before = np.asarray(lanes.circumstances.curve_by)
    curve_by: Any = np.concatenate([before, by], axis=1) if before.ndim == 2 else by
    intake = replace(fitted.intake, lanes=lanes._replace(circumstances=lanes.circumstances._replace(curve_by=curve_by)))
    layout = with_curve(fitted.layout, term, values, curve.moved(dict.fromkeys(curve.fitted, 0.0)))
    bare, new = only_shared(layout), len(layout.usual) - len(fitted.spot.values)
    starts = [replace(fitted.spot, values=np.concatenate([fitted.spot.values, layout.usual[-new:]]))]
    if fitted.lost:
        starts.append(usual_spot(intake, bare))
    top, evidence = max((climb(intake, bare, start) for start in starts), key=lambda found: objective(found[1], bare))
    return intake, layout, top, evidence


def nats_flown(fitted: BaselineFit, part: Part) -> float | None:
    """Log evidence of a part against none, where the simulation that has it fits best (Laplace); None for what no
    simulation of single shots can hold."""
    taken = term_of(fitted.evidence.columns[part.column], fitted.layout)
    shapes = part.shapes.shape[1]
    if taken is None or shapes > KNOTS:
        return None
    by = np.zeros((len(part.shapes), KNOTS + 1))       # as many for all, so that compiled code is shared
    by[:, :shapes] = part.shapes * part.sd / find_nameless(taken[0]).usual
    _, layout, _, evidence = climb_with(fitted, *taken, Curve((0.0,) * KNOTS, 0.0), by)
    return log_evidence_at(fitted, only_shared(layout), evidence)
