"""What could have been done in a concealed world, by the information that its own data hold.

For small effects the scores are normal; the best that anybody can do with them is worked out by drawing them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc.sim.discover.adopt import Investigation
from truearc.sim.discover.select.terms import ALIAS, efficient, nats_for, refit, visible_terms
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, plane_terms, unseen_score, without
from truearc_proof.scoring.score_finding import ALIASES

FALSE_ALARM = 0.05
DRAWS = 2000


class Ceiling(NamedTuple):
    """Chances that the largest of all terms' scores is significant, and that besides the likeliest term is the true
    one, one of its class, one of its stage. `alike`: the terms of its class: those that the design lists for the level
    and those whose slopes over these very shots correlate by ALIAS or more."""

    detected: float
    top: float
    alias: float
    stage: float
    alike: tuple[str, ...]


def ceiling_of(evidence: ScoreTable, level: str, name: str, amplitude: float, seed: int) -> Ceiling | None:
    """For the term's column `name` at its true amplitude; None where it was not tested.

    Efficient scores of terms (fitted parameters projected out) are drawn as N(information x amplitude, information);
    the threshold is that of the largest of as many correlated scores of noise.
    """
    columns = visible_terms(evidence)
    names = [evidence.columns[k].name for k in columns]
    if name not in {column.name for column in evidence.columns[:evidence.first_shared]}:
        return None
    if name not in names:
        return Ceiling(FALSE_ALARM, 0.0, 0.0, 0.0, ())
    left = efficient(evidence, columns)[1]
    noise = _draw(left, np.random.default_rng(seed))
    sd = np.sqrt(np.diag(left))
    critical = np.quantile(np.abs(noise / sd).max(1), 1.0 - FALSE_ALARM)
    scores = noise + left[:, names.index(name)] * amplitude
    nats = np.stack([nats_for(scores[:, j], float(left[j, j]), evidence.columns[k].usual)
                     for j, k in enumerate(columns)], axis=1)
    detected, best = np.abs(scores / sd).max(1) > critical, nats.argmax(1)
    alike = _alike(left, names, name, level)
    stages = [evidence.columns[k].stage for k in columns]
    right = ([one == name for one in names], [one == name or _term(one) in alike for one in names],
             [stage == stages[names.index(name)] for stage in stages])
    first, up_to_alias, in_stage = (float((detected & np.array(one)[best]).mean()) for one in right)
    return Ceiling(float(detected.mean()), first, up_to_alias, in_stage, alike)


def _alike(left: Array, names: list[str], name: str, level: str) -> tuple[str, ...]:
    size, true = np.sqrt(np.diag(left)), names.index(name)
    together = np.abs(left[true]) / (size * size[true])
    return tuple(_term(one) for k, one in enumerate(names) if k != true and (
        together[k] >= ALIAS or any({_term(one), _term(name)} <= group for group in ALIASES[level])))


def _term(column: str) -> str:
    return column.partition(".")[0]


def _draw(covariance: Array, rng: np.random.Generator) -> Array:
    """[DRAWS, K] normal, by the symmetric square root: the eigenvectors' signs and order, which differ from machine to
    machine, cancel in it, and it is there of singular covariances too, which no Cholesky factor is."""
    values, vectors = np.linalg.eigh(covariance)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    drawn: Array = rng.normal(size=(DRAWS, len(values))) @ root
    return drawn


def strength_of(evidence: ScoreTable, shift_m: Array) -> float | None:
    """How plain an effect is that moves the heights at the plane by shift_m (one of each of the dataset's shots): the
    chi-squared (lambda) by which the outcomes show it, fitted parameters projected out.

    None where tracks or measured exits speak too, and where there are no outcomes: heights are not all there is then.
    """
    plane, shared = evidence.plane, evidence.shared
    if plane is None or evidence.bend.any():
        return None
    mine = np.nan_to_num(shift_m[evidence.rows[plane.rows]])
    none = np.zeros((len(mine), 1))
    deal = evidence.deal.some(plane.rows)
    by, wider, spread = (np.concatenate([first, deal.spread(part)[:, shared]], axis=1) for first, part in (
        (mine[:, None], plane.by_column), (none, plane.wider_by), (none, plane.log_spread_by)))
    info = plane_terms(replace(plane, by_column=by, wider_by=wider, log_spread_by=spread), plane.seen, plane.mean_m,
                       plane.spread_m)[1].sum(0)
    taken = np.linalg.solve(info[1:, 1:] + evidence.precision, info[1:, 0])
    return float(info[0, 0] - info[0, 1:] @ taken)


def oracle_gain(investigation: Investigation, name: str, amplitude: float) -> float | None:
    """Return the gain in nats per unseen shot of a solver that knows the term; None where nothing was found."""
    fitted = investigation.fitted
    if fitted is None or not investigation.steps:
        return None
    if name not in {column.name for column in fitted.evidence.columns[:fitted.evidence.first_shared]}:
        return None
    told = refit(fitted, (name,), np.array([amplitude]))
    return float((unseen_score(told.evidence) - unseen_score(without(fitted.evidence))).mean())
