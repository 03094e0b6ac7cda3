"""The marks of one opened world: its claims compared with the truth, and with the ceiling that the data allow.

A decoy varies strongly but has no effect, so its name is a false claim regardless of what it resembles. A set of names
that the data cannot distinguish may contain the decoy's name; this module removes it, also for older rounds.

For small effects the scores are normally distributed, so the best achievable result is computed from random draws of
them.

Solvers never receive the sealed hold-out shots. These shots follow from the sealed world alone (they are another season
of the same robot, with its own balls and random effects), so the seal commits to them as well.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct, structs

from truearc.sim.data.dataset import Dataset, circumstances_of, counts_shots
from truearc.sim.discover.select.terms import ALIAS, efficient, nats_for, one_step
from truearc.sim.infer.belief import Belief, along, point_belief
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit, coefficients_of
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, plane_terms
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.simulate import opening_of, predict
from truearc_proof.rounds.worlds import (
    ALIKE,
    DECOY,
    FOREIGN,
    MUJOCO,
    NUMPY,
    OWN,
    PARAMETER,
    WEAR,
    Drawn,
    changes_of,
    dirty_plan,
    play_robot,
    unseen,
    world_of,
)
from truearc_proof.truth import world as truth
from truearc_proof.truth.generate import play, shift_m

# --- what the data allow, and sealed shots

FALSE_ALARM = 0.05
DRAWS = 2000
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
    """Return the ceiling for the term's column `name` at its true amplitude; None if it was not tested.

    Efficient scores of terms (fitted parameters projected out) are drawn as N(information x amplitude, information);
    the threshold is that of the largest of as many correlated scores of noise.
    """
    columns = np.array([one.column for one in one_step(evidence)[0] if one.visible], dtype=int)
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
    alike = _correlated(left, names, name, level)
    stages = [evidence.columns[k].stage for k in columns]
    right = ([one == name for one in names], [one == name or _term(one) in alike for one in names],
             [stage == stages[names.index(name)] for stage in stages])
    first, up_to_alias, in_stage = (float((detected & np.array(one)[best]).mean()) for one in right)
    return Ceiling(float(detected.mean()), first, up_to_alias, in_stage, alike)


def _correlated(left: Array, names: list[str], name: str, level: str) -> tuple[str, ...]:
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
    """Return the chi-squared (lambda) by which outcomes show an effect that moves the heights at the plane by shift_m
    (one value per shot), with fitted parameters projected out.

    None where tracks or measured exits speak too, and where there are no outcomes: heights are not all there is then.
    """
    plane, shared = evidence.plane, evidence.shared
    if plane is None or evidence.bend.any():
        return None
    mine = np.nan_to_num(shift_m[evidence.rows[plane.rows]])
    none = np.zeros((len(mine), 1))
    deal = evidence.deal.some(plane.rows)
    by, spread, *moved = (np.concatenate([first, deal.spread(part)[:, shared]], axis=1) for first, part in (
        (mine[:, None], plane.by_column), (none, plane.log_spread_by),
        *((none, part) for part in np.moveaxis(plane.moved_by, 1, 0))))
    plane = replace(plane, by_column=by, moved_by=np.stack(moved, axis=1), log_spread_by=spread)
    info = plane_terms(plane, plane.seen, plane.mean_m, plane.spread_m)[1].sum(0)
    taken = np.linalg.solve(info[1:, 1:] + evidence.precision, info[1:, 0])
    return float(info[0, 0] - info[0, 1:] @ taken)


class Measured(NamedTuple):
    """allowed: as Ceiling, of one hidden effect of the catalogue; alike: terms of its
    class in these data; best_sd: least standard error of its amplitude; strength: lambda of an effect that no catalogue
    has, where only heights speak of it.
    before, oracle: what is believed, fitted by the grader, without the true term and with it."""

    allowed: tuple[float, ...] | None = None
    alike: tuple[str, ...] = ()
    best_sd: float | None = None
    strength: float | None = None
    before: Belief | None = None
    oracle: Belief | None = None


def measure(drawn: Drawn, dataset: Dataset, claimed: bool = True, seed: int = 0) -> Measured:
    """Measure worlds of the NumPy engine with one hidden effect.

    For those with none or more only what is believed is measured, if something was claimed; for others nothing is
    known.
    """
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
        return Measured(strength=strength_of(fitted.scores, shift_m(world_of(drawn))))
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
    return Measured(tuple(ceiling[:4]), ceiling.alike, best_sd,
                    oracle=_believed(told.scores, dataset.facts.believe.terms))


def _believed(evidence: ScoreTable, terms: tuple[str, ...]) -> Belief:
    """The point belief at the evidence's point, of these terms and those fitted with them."""
    return point_belief(coefficients_of(evidence, terms, BUILT_IN), among=BUILT_IN)


class Unseen(NamedTuple):
    """The season as the robot's sensors have it, and how high above the opening's centre each ball came [n], in m; nan
    where it never got to the plane."""

    dataset: Dataset
    above_m: np.ndarray


def shoot_unseen(drawn: Drawn) -> Unseen | None:
    """Shoot the hold-out season; None for an external world, which only its maker can shoot."""
    seed = drawn.seed + APART
    if drawn.engine in (FOREIGN, NUMPY):
        world = world_of(drawn)
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


# --- what a finding says

Finding = Mapping[str, Any]
SET_SHARE = 0.9
# Names that data of a level can hardly or not at all tell apart, whatever the solver says (design, section 4.2).
ALIASES: dict[str, tuple[frozenset[str], ...]] = {
    "L0": (frozenset({"distance_bias", "distance_scale", "target_height", "release_height"}),
           frozenset({"hood_offset", "wheel_slip", "drag_reynolds"}), frozenset({"ball_wear", "drag_wear"}),
           frozenset({"buoyancy", "added_mass"}), frozenset({"spin_drag", "spin_decay"})),
    "L1": (frozenset({"target_height", "release_height"}), frozenset({"buoyancy", "added_mass"})),
    "L2": (frozenset({"distance_bias", "distance_scale"}), frozenset({"buoyancy", "added_mass"})),
}
# Of effects in no catalogue: covariates of which any is right, and the direction. Balls of one supplier are identified
# by the ball's or the supplier's name; effects within a flight by time or speed in it.
SPEEDS = ("motor_ratio", "exit_speed_m_s", "exit_spin_rev_s", "wheel_lower_rad_s", "wheel_upper_rad_s",
          "fed_wheel_lower_rad_s", "fed_wheel_upper_rad_s")
GOES_WITH: dict[str, tuple[tuple[str, ...], str]] = {
    "late_gust": (("time_in_flight_s",), "along"),
    "far_kick": (("distance_m",), "along"), "supplier_drag": (("supplier", "ball_id"), "along"),
    "seam_force": (("temperature_c",), "lateral"), "cold_rubber": (("temperature_c",), "along"),
    "hood_flex": (SPEEDS, "vertical"), "worn_wheel": (SPEEDS, "along"),
    "drag_crisis": (("speed_in_flight_m_s",), "along")}
BY_BALL = ("ball_wear", "drag_wear")  # amplitudes are those of the most used ball
STAGE_OF = {effect.name: effect.stage for effect in truth.EFFECTS} | {
    "drag": "flight", "magnus": "flight", "exit_efficiency": "launch"}


def goes_with_right(name: str, finding: Finding) -> bool:
    """Return whether the verdict is unknown, with a right covariate and the right direction."""
    where, unknown = finding.get("where") or {}, finding.get("unknown") or {}
    said = unknown if unknown.get("covariate") else where
    covariates, direction = GOES_WITH[name]
    names = {said.get("covariate"), *(where.get("inseparable") or ())}
    return (finding.get("verdict") == "unknown" and bool(names & set(covariates))
            and said.get("direction") == direction)


def said_stage(where: Mapping[str, Any]) -> str | None:
    """Return the stage that is claimed, or else the likeliest."""
    stage, shares = where.get("stage"), where.get("stage_probability") or {}
    return stage if stage or not shares else max(shares, key=lambda name: shares[name] or 0.0)


def names_ranked(finding: Finding) -> list[str]:
    """Return terms by probability, likeliest first."""
    return [entry["term"] for entry in sorted(finding.get("what") or (), key=lambda e: -(e.get("probability") or 0.0))]


def said_set(finding: Finding) -> list[str]:
    """Return the claimed set; else, from a ranking, as many names as hold 90 % of what is not unknown."""
    if finding.get("set"):
        return list(finding["set"])
    shares = {entry["term"]: entry.get("probability") or 0.0 for entry in finding.get("what") or ()}
    names: list[str] = []
    for name in sorted(shares, key=lambda name: -shares[name]):
        if names and sum(shares[one] for one in names) >= SET_SHARE * sum(shares.values()):
            break
        names.append(name)
    return names


def is_alias(level: str, name: str, top: Sequence[str]) -> bool:
    """Return whether the first name is of the true one's class at this level."""
    return bool(top) and any(name in names and top[0] in names for names in ALIASES[level])


def in_catalogue(name: str, amount: float) -> tuple[str, float] | None:
    """Return the parameter of the catalogue's term that an effect's amplitude is, and its value; None if no term
    matches."""
    if name not in PARAMETER:
        return None
    parameter, value = PARAMETER[name]
    return parameter, value(amount)


# --- marks

NULLS = ("clean", "dirty")
SHOTS, MEASUREMENT = "shots", "measurement"


class Mark(Struct, frozen=True):
    """One world's; None where the question does not arise. `hidden`: what was true of it.

    first: the first name is right. alias: or of a class with the right one, be it a decoy's
    (`up_to_alias` takes those out). covered: the set has a right name. both: of two effects both are
    named. error: amplitude of the right name, less the truth, over the best standard error that anybody could have
    (Cramer and Rao). allowed: chances that the data allow to find, name, name up to alias, place. goes_with:
    covariate and direction of what is in no catalogue. right: names of the catalogue that would be right. off_m: RMS
    errors of heights in the sealed test, by what was believed, by what was adopted, and, where the grader knows it,
    by what is believed with the true term. asked: SHOTS, a MEASUREMENT or "". rivals: of others put to the same
    data, whether each says something, and of its first name what `first` and `alias` are of ours, decoys taken out.
    said, unexplained: probabilities that were claimed of the first name, and of a change that no term explains.
    """

    world: str
    engine: str
    kind: str
    level: str
    shots: int
    hidden: tuple[str, ...]
    strength: float | None
    found: bool
    p_value: float | None
    verdict: str
    names: tuple[str, ...]
    set_size: int | None = None
    stage: bool | None = None
    first: bool | None = None
    alias: bool | None = None
    covered: bool | None = None
    both: bool | None = None
    holds: bool | None = None
    error: float | None = None
    allowed: tuple[float, ...] | None = None
    goes_with: bool | None = None
    right: tuple[str, ...] = ()
    rivals: dict[str, tuple[bool, bool | None, bool | None]] = {}
    off_m: tuple[float, ...] | None = None
    asked: str = ""
    said: float | None = None
    unexplained: float | None = None


def mark(drawn: Drawn, finding: Finding, measured: Measured, rivals: Mapping[str, Any] | None = None) -> Mark:
    """Mark claims against the sealed truth.

    `measured`: what the data themselves allow, as far as computed; rivals: {name: its claim
    (truearc_proof.rivals.claim)}.
    """
    names, found = names_ranked(finding)[:1], bool(finding["mismatch"]["found"])
    further = [one["what"][0]["term"] for one in finding.get("also") or () if one.get("set") and one["what"]]
    said = said_set(finding) if found else []
    plain = Mark(drawn.name, drawn.engine, drawn.kind, drawn.level, drawn.shots, hidden_of(drawn),
                 _strength(drawn, measured), found, finding["mismatch"].get("p_value"),
                 str(finding["verdict"]), tuple(said) if finding["verdict"] in ("named", "set") else (),
                 len(said) if said else None)
    right, stages = right_names(drawn), right_stages(drawn)
    plain = structs.replace(plain, allowed=measured.allowed, right=right, rivals={
        name: mark_rival(drawn, claim, right, measured) for name, claim in (rivals or {}).items()})
    if not found or drawn.kind in NULLS:
        return plain
    likeliest = max((one.get("probability") or 0.0 for one in finding.get("what") or ()), default=None)
    more = {"said": likeliest, "unexplained": finding.get("unexplained"),
            "stage": said_stage(finding.get("where") or {}) in stages if stages else None}
    if not right:                     # in no catalogue: only the stage can be right, and no name
        hidden = hidden_of(drawn)
        known = drawn.kind == "off" and len(hidden) == 1 and set(hidden) <= set(GOES_WITH)
        goes_with = goes_with_right(hidden[0], finding) if known else None
        return structs.replace(plain, **more, goes_with=goes_with)
    more |= {"first": bool(names) and names[0] in right, "covered": bool(set(said) & set(right)),
             "alias": _alike(drawn, names, right, measured)}
    if drawn.kind == "two":
        more["both"] = all({*names, *further} & set(each) for each in _right_of_each(drawn))
    return structs.replace(plain, **more, **_size(drawn, finding, measured))


def _strength(drawn: Drawn, measured: Measured) -> float | None:
    """Lambda in these very data where it was worked out, else by the ladder's table."""
    return min(drawn.strength.values(), default=None) if measured.strength is None else measured.strength


def _alike(drawn: Drawn, names: Sequence[str], right: Sequence[str], measured: Measured) -> bool:
    """Whether the first of these names is right, or of a class with a right one."""
    return bool(names) and (names[0] in right or names[0] in measured.alike
                            or any(is_alias(drawn.level, name, names) for name in right))


def mark_rival(drawn: Drawn, claim: Mapping[str, Any], right: Sequence[str],
               measured: Measured) -> tuple[bool, bool | None, bool | None]:
    """Whether it says something, and of its first name whether it is right, or of a class with a right one; None where
    no name of the catalogue would be right."""
    says, names = bool(claim["says_something"]), list(claim["names"])[:1]
    if not right:
        return says, None, None
    # ours: up_to_alias
    decoy = drawn.engine != OWN and drawn.kind == "decoy" and names == [DECOY]
    return (says, says and bool(names) and names[0] in right,
            says and not decoy and _alike(drawn, names, right, measured))


def hidden_of(drawn: Drawn) -> tuple[str, ...]:
    """Return the names of the hidden effects, or of the changes of MuJoCo's robot."""
    if drawn.engine == MUJOCO:
        return tuple(change.name for change in changes_of(drawn.change))
    return tuple(drawn.effects)


def right_names(drawn: Drawn) -> tuple[str, ...]:
    """Return names of the catalogue that would be right; none for effects in no catalogue."""
    return tuple(dict.fromkeys(name for names in _right_of_each(drawn) for name in names))


def _right_of_each(drawn: Drawn) -> list[tuple[str, ...]]:
    """Names that would be right of each thing that is hidden; of MuJoCo's aliases those of the whole class are."""
    if drawn.engine == MUJOCO and drawn.kind == "alias":
        return [ALIKE[drawn.level]]
    if drawn.engine == MUJOCO:
        return [change.names for change in changes_of(drawn.change)]
    return [(name,) for name, amount in drawn.effects.items() if in_catalogue(name, amount)]


def right_stages(drawn: Drawn) -> tuple[str, ...]:
    if drawn.engine == MUJOCO:
        alike = [(STAGE_OF[name],) for name in ALIKE[drawn.level]] if drawn.kind == "alias" else None
        each: Sequence[tuple[str, ...]] = alike or [change.stages for change in changes_of(drawn.change)]
        return tuple(dict.fromkeys(stage for stages in each for stage in stages))
    return tuple(STAGE_OF[name] for name in drawn.effects if name in STAGE_OF)


def _size(drawn: Drawn, finding: Finding, measured: Measured) -> dict[str, Any]:
    """Whether the interval of the first name, where that is the one hidden effect, holds the truth, and its error."""
    first = names_ranked(finding)[:1]
    if drawn.engine == MUJOCO or len(drawn.effects) != 1 or first != list(drawn.effects):
        return {}
    (name, amount), = drawn.effects.items()
    told = in_catalogue(name, amount)
    if told is None:
        return {}
    parameter = told[0]
    truth = amount if drawn.engine == OWN else told[1]       # strangers state the catalogue's own number
    given = change_of(next(one for one in finding["what"] if one["term"] == name), parameter)
    if given is None or (drawn.level == "L0" and name in BY_BALL):
        return {}                     # balls not told apart: wear is what it comes to by the end, not a ball's own
    value, low90, high90 = given
    error = None if measured.best_sd is None else (value - truth) / measured.best_sd
    return {"holds": low90 <= truth <= high90, "error": error}


def change_of(named: Mapping[str, Any], parameter: str) -> tuple[float, float, float] | None:
    """Return (value, low90, high90) of a named term's change of what was believed; None where no interval is given.

    value: nan where claims state the interval alone.
    """
    given = named.get("change") or (named.get("parameters") or {}).get(parameter)
    if given is None or given["low90"] is None:
        return None
    before = 0.0 if named.get("change") else named.get("believed") or 0.0
    return given.get("value", np.nan) - before, given["low90"] - before, given["high90"] - before


def named_decoy(mark: Mark) -> bool | None:
    """Return whether the decoy's name comes first, alone or in a set.

    None in other worlds, and where the level's data have nothing of the decoy.
    """
    return None if _absent(mark) else mark.names[:1] == (DECOY,)


def up_to_alias(mark: Mark) -> bool | None:
    """Return whether the first name is right or of a class with the right one, and not a decoy's."""
    return mark.alias and not named_decoy(mark)


def _absent(mark: Mark) -> bool:
    return mark.engine == OWN or mark.kind != "decoy" or DECOY in unseen(mark.level)
