"""What the data of a concealed world allow: chances, least errors, what follow-ups are worth, and sealed shots.

For small effects the scores are normal; the best that anybody can do with them is worked out by drawing them.

Sealed hold-out shots get to no solver. They follow from the sealed world alone (another season of the same robot, with
balls and random effects of its own), so that the seal commits to them as well.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from truearc.sim.data.conditions import circumstances_of, counts_shots
from truearc.sim.data.dataset import Dataset, join_datasets
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.plan.next_steps import Contest, worth
from truearc.sim.discover.select.terms import ALIAS, efficient, nats_for, visible_terms
from truearc.sim.infer.belief import Belief, along, point_belief
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit, coefficients_of
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.infer.likelihood.layout import column_of
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, plane_terms
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.simulate import opening_of, predict
from truearc_proof.scoring.score_finding import ALIASES, PARAMETER
from truearc_proof.truth.generate import play, shift_m
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.generate_data import play_robot
from truearc_proof.worlds.sampling_plan import MUJOCO, NUMPY, WEAR, Drawn, dirty_plan

FALSE_ALARM = 0.05
DRAWS = 2000
MOST = 64.0                           # times the first shots, up to which random ones are counted
HALVINGS = 30
APART = 1 << 41                       # of its seeds from those of the world's own season, and of its follow-up's


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
    if name not in {column.name for column in fitted.scores.columns[:fitted.scores.first_shared]}:
        return None
    told = fitted.with_terms((name,), np.array([amplitude]))
    return float((told.scores.held_out() - fitted.held_out()).mean())


class Measured(NamedTuple):
    """allowed: as truearc_proof.scoring.oracle.Ceiling, of one hidden effect of the catalogue; alike: terms of its
    class in these data; best_sd: least standard error of its amplitude; oracle_gain: nats per shot on unseen shots of
    a solver that knows the term; strength: lambda of an effect that no catalogue has, where only heights speak of it.
    before, oracle: what is believed, fitted by the grader, without the true term and with it."""

    allowed: tuple[float, ...] | None = None
    alike: tuple[str, ...] = ()
    best_sd: float | None = None
    oracle_gain: float | None = None
    strength: float | None = None
    before: Belief | None = None
    oracle: Belief | None = None


def measure(drawn: Drawn, dataset: Dataset, claimed: bool = True, seed: int = 0) -> Measured:
    """Of worlds of the NumPy engine with one hidden effect; of those with none or more only what is believed, if
    something was claimed; of others nothing is known."""
    single = len(drawn.effects) == 1
    if drawn.engine != NUMPY or not (single or claimed):
        return Measured()
    terms = dataset.facts.believe.terms
    fitted = fit_believed(Launcher.of(dataset, terms, BUILT_IN))
    before = _believed(fitted.scores, terms)
    return _of_one(drawn, dataset, fitted, seed)._replace(before=before) if single else Measured(before=before)


def _of_one(drawn: Drawn, dataset: Dataset, fitted: LauncherFit, seed: int) -> Measured:
    (name, amount), = drawn.effects.items()
    if name not in PARAMETER:
        world = make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt)
        return Measured(strength=strength_of(fitted.scores, shift_m(world)))
    column, amplitude = f"{name}.{PARAMETER[name][0]}", PARAMETER[name][1](amount)
    ceiling = ceiling_of(fitted.scores, drawn.level, column, amplitude, seed)
    if name in WEAR and not counts_shots(dataset.shots):       # it goes with balls, which are not told apart
        ceiling = Ceiling(FALSE_ALARM, 0.0, 0.0, 0.0, ())
    if ceiling is None:
        return Measured()
    index = np.array([fitted.scores.index(column)])
    information = float(efficient(fitted.scores, index)[1][0, 0])
    best_sd = information**-0.5 if information > 0.0 else None
    told = fitted.with_terms((column,), np.array([amplitude]))
    gain = told.scores.held_out() - fitted.held_out()
    return Measured(tuple(ceiling[:4]), ceiling.alike, best_sd, float(gain.mean()),
                    oracle=_believed(told.scores, dataset.facts.believe.terms))


def _believed(evidence: ScoreTable, terms: tuple[str, ...]) -> Belief:
    """The point belief at the evidence's point, of these terms and those fitted with them."""
    return point_belief(coefficients_of(evidence, terms, BUILT_IN), among=BUILT_IN)


def random_worth(first: Dataset, more: Dataset, finding: Mapping[str, Any]) -> int | None:
    """By what the given shots themselves say of the amplitudes of the set's names, each as large and as likely as was
    claimed before; None beyond MOST times the first shots, or for fewer than two names.

    Worth is the design's (truearc.sim.discover.plan.experiment_design.worth), with the information of shots that were
    really shot.
    """
    what = {one["term"]: one for one in finding["what"] if one["term"] in (finding["set"] or ())}
    whole = join_datasets(first, more)
    evidence = fit_believed(Launcher.of(whole, first.facts.believe.terms)).scores
    there = {column.name for column in evidence.columns[:evidence.first_shared]}
    names = [name for name in what if column_of(name) in there]
    if len(names) < 2:
        return None
    columns = np.array([evidence.index(column_of(name)) for name in names])
    sizes = [what[name]["parameters"][column_of(name).partition(".")[2]]["value"] for name in names]
    share = np.array([what[name]["probability"] for name in names])
    contest = Contest(evidence, columns, np.array(sizes), np.array([evidence.columns[k].usual for k in columns]),
                      share / share.sum(), np.zeros(len(names)))
    old = np.flatnonzero(evidence.rows < len(first.shots))
    new = np.flatnonzero(evidence.rows >= len(first.shots))
    return _as_many(contest, evidence.told_by(old), evidence.told_by(new), len(old))


def _as_many(contest: Contest, present: np.ndarray, more: np.ndarray, shots: int) -> int | None:
    """Random shots, each with 1 / shots of the present information, that are worth `more`, which is in the contest's
    evidence already."""
    wanted = worth(contest, 0.0)
    low, high = 0.0, MOST
    if worth(contest, high * present - more) < wanted:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if worth(contest, middle * present - more) >= wanted else (middle, high)
    return int(np.ceil(high * shots))


class Unseen(NamedTuple):
    """The season as the robot's sensors have it, and how high above the opening's centre each ball came [n], in m; nan
    where it never got to the plane."""

    dataset: Dataset
    above_m: np.ndarray


def shoot_unseen(drawn: Drawn) -> Unseen | None:
    """Shoot the hold-out season; None for an external world, which only its maker can shoot."""
    seed = drawn.seed + APART
    if drawn.engine == NUMPY:
        world = make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt)
        season = play(replace(world, seed=seed))
        return Unseen(season.dataset, season.flown.arrival.height_m - _centre_m(season.dataset)
                      - world.amount("target_height"))
    if drawn.engine != MUJOCO:
        return None
    played = play_robot(drawn, seed, dirty_plan(drawn.dirt, seed, drawn.shots))
    height_m = np.array([np.nan if one.z_m is None else one.z_m for one in played.results])
    return Unseen(played.dataset, height_m - _centre_m(played.dataset))


def off_m(belief: Belief, unseen: Unseen) -> float:
    """Return the RMS error in m of the belief's forecasts of heights above the opening's centre.

    A ball that it lets fall short is forecast at the floor. Shots that truly fell short do not count.
    """
    dataset, n = unseen.dataset, len(unseen.dataset.shots)
    around = along(belief.curves, circumstances_of(dataset), every_column(dataset), n)
    centre_m = opening_of(dataset.facts, belief.coefficients, None, around).centre_m
    height_m = np.asarray(predict(dataset.facts, belief.coefficients, dataset.shots, circumstances=around).height_m)
    told_m = np.where(np.isfinite(height_m), height_m, 0.0) - centre_m
    return float(np.sqrt(np.nanmean((unseen.above_m - told_m)**2)))


def _centre_m(dataset: Dataset) -> float:
    """Of the opening, by rig.toml."""
    assert dataset.facts.target is not None
    return dataset.facts.target.centre_height_m
