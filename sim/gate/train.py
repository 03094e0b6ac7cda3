"""Recorded shots and a belief -> a gate with the physics in it, and what it was worth on shots it had not seen."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.data.dataset import Shots
from truearc.sim.gate import model
from truearc.sim.gate.model import GateData, Physics, PhysicsGate
from truearc.sim.infer.belief import Belief
from truearc.sim.paper.network import usable_rows
from truearc.sim.physics.simulate import MISS, THREE, TWO
from truearc.sim.printed import Progress
from truearc.sim.statistics import Figures, figures_of, log_scores

# The plane from below to above: miss low, two low, three, two high, miss high.
CELLS = 5
UNKNOWN = (1,) * CELLS
CELLS_OF = {(MISS, ""): (1, 0, 0, 0, 1), (TWO, ""): (0, 1, 0, 1, 0), (THREE, ""): (0, 0, 1, 0, 0),
            (MISS, "low"): (1, 0, 0, 0, 0), (MISS, "high"): (0, 0, 0, 0, 1),
            (TWO, "low"): (0, 1, 0, 0, 0), (TWO, "high"): (0, 0, 0, 1, 0),
            # beside the centre: of the height it says no more than that it was within the two
            (TWO, "left"): (0, 1, 1, 1, 0), (TWO, "right"): (0, 1, 1, 1, 0),
            (MISS, "left"): UNKNOWN, (MISS, "right"): UNKNOWN}
ASIDE = ("left", "right")
LEVEL = {MISS: 0, TWO: 1, THREE: 2}
FOLDS = 5
MIN_CONFIGURATIONS = 15
TEMPERATURES = np.exp(np.linspace(np.log(0.6), np.log(1.8), 23))
TEMPERATURE_SPREAD = 0.15             # of its log, a priori: chance in a few shots does not move it far
BEYOND = 0.1                          # of the recorded range: where z stops on either side
SILENT_M = 0.02                       # a residual smaller than this is not worth a sentence


class OutcomeClasses(NamedTuple):
    """Shots that say something, one a row.

    features [n, 3] in the contract's order; cells [n, 5]: 1 where the height may have been, by the outcome and side;
    miss_m [n]: measured height minus the target's centre, nan where not measured (it then overrides the cells);
    level [n]: 0 miss, 1 two, 2 three, -1 not judged; aside [n]: a miss to the left or right, whose cells are all 1;
    group [n]: rows of one configuration share a number; shot_id [n].
    """

    features: np.ndarray
    cells: np.ndarray
    miss_m: np.ndarray
    level: np.ndarray
    aside: np.ndarray
    group: np.ndarray
    shot_id: np.ndarray

    def take(self, rows: np.ndarray) -> "OutcomeClasses":
        return OutcomeClasses(*(column[rows] for column in self))


def outcome_classes_of(shots: Shots, name: str, target: Target | None = None) -> tuple[OutcomeClasses, list[str]]:
    """Return the outcome classes of shots, and a sentence for each kind of shot of `name` left out.

    target: of the rig; where every hit counts alike, a hit is a three. InputError when no shot is left.
    """
    outcome, side, miss_m = shots.text("outcome"), shots.text("side"), shots.number("miss_height_m")
    if target is not None and target.hit_or_miss:
        outcome = tuple(THREE if one == TWO else one for one in outcome)
    silent = np.array([one not in LEVEL for one in outcome], bool) & np.isnan(miss_m)
    features, kept, left_out = usable_rows(shots, name, silent, "no outcome or miss_height_m")
    cells = np.array([CELLS_OF.get((outcome[row], side[row]), CELLS_OF.get((outcome[row], ""), UNKNOWN))
                      for row in kept], float)
    level = np.array([LEVEL.get(outcome[row], -1) for row in kept])
    aside = np.array([outcome[row] == MISS and side[row] in ASIDE for row in kept])
    return OutcomeClasses(features, cells, miss_m[kept], level, aside, _groups(shots, kept),
                          np.array(shots.shot_id)[kept]), left_out


def _groups(shots: Shots, kept: np.ndarray) -> np.ndarray:
    """Shots of one session with one config_id are a group; a shot without a config_id is one by itself. Their numbers
    do not depend on the order of rows."""
    session, config = shots.text("session"), shots.text("config_id")
    keys = [(session[row], config[row]) if config[row] else ("", shots.shot_id[row]) for row in kept]
    numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
    return np.array([numbers[key] for key in keys])


@dataclass(frozen=True, eq=False)
class Heldout:
    """Shots rated by gates that had not seen their configuration; the belief had.

    p [n, 2] and level [n] of the judged rows; `plain`: the same before calibration; `physics`: by the forecast alone,
    as the belief has it. The temperature of each fold is chosen on the others.
    """

    p: np.ndarray
    level: np.ndarray
    plain: Figures
    calibrated: Figures
    physics: Figures


def train_physics_gate(rig: Rig, belief: Belief, shots: Shots, seed: int = 0, name: str = "shots",
                       progress: Progress = lambda done, note: None) -> tuple[PhysicsGate, Heldout | None]:
    """Fit the gate of these shots, and rate it out of fold (None when there are too few judged configurations).

    The same arguments give the same gate. InputError when nothing can be learned.

    Folds are of configurations, drawn by seed. The temperature is kept only when it adds to the log score of folds
    that it was not chosen on.
    """
    marks, _ = outcome_classes_of(shots, name, rig.target)
    physics = model.physics_of(rig, belief, marks.features)
    progress(0.3, "forecasts made")
    gate = _fit(rig, belief, marks, physics, np.ones(len(marks.level)))
    progress(0.5, "fitted")
    fold = folds(marks.group, seed)
    if fold is None or (marks.level >= 0).sum() < MIN_CONFIGURATIONS:
        return gate, None
    heldout = []
    for number in range(FOLDS):
        fitted = _fit(rig, belief, marks, physics, (fold != number).astype(float))
        rows = np.flatnonzero((fold == number) & (marks.level >= 0))
        latent = fitted.correct(marks.features[rows], Physics(*(column[rows] for column in physics)))
        heldout.append(_Fold(fitted, *latent, marks.level[rows]))
        progress(0.5 + 0.5 * (number + 1) / FOLDS, f"fold {number + 1} of {FOLDS}")
    return _calibrate(gate, heldout, _alone(gate, physics, marks))


def folds(group: np.ndarray, seed: int) -> np.ndarray | None:
    """The fold [n] of each row: groups spread evenly in an order drawn by seed; None when there are too few."""
    names = np.unique(group)
    if len(names) < MIN_CONFIGURATIONS:
        return None
    deal = np.empty(len(names), np.int64)
    deal[np.random.default_rng([seed, 5]).permutation(len(names))] = np.arange(len(names)) % FOLDS
    return deal[np.searchsorted(names, group)]


@dataclass(frozen=True, eq=False)
class _Fold:
    gate: PhysicsGate
    mean_m: np.ndarray
    sigma_m: np.ndarray
    level: np.ndarray

    def p(self, temperature: float) -> np.ndarray:
        return self.gate.judge(self.mean_m, temperature * self.sigma_m)


def _fit(rig: Rig, belief: Belief, marks: OutcomeClasses, physics: Physics, weight: np.ndarray) -> PhysicsGate:
    seen = marks.features[weight > 0.0]
    scaling = scaling_of(seen)
    told = weight * ~marks.aside
    data = GateData(scaling(marks.features), *physics, marks.cells, marks.miss_m, told)
    aside = float((marks.aside * weight).sum() / weight.sum())
    fit = model.fit_widest(data, model.halves_of(rig))
    return PhysicsGate(rig, belief, scaling, fit, 1.0, aside, model.fit_novelty(seen))


def scaling_of(features: np.ndarray) -> model.Scaling:
    """Standardisation by these rows [n, 3]; a feature that never varies has deviation 1."""
    mean, deviation = features.mean(axis=0), features.std(axis=0)
    deviation = np.where(deviation > 1e-9, deviation, 1.0)
    low, high = ((edge - mean) / deviation for edge in (features.min(axis=0), features.max(axis=0)))
    margin = BEYOND * (high - low)
    return model.Scaling(mean, deviation, low - margin, high + margin)


def _calibrate(gate: PhysicsGate, parts: list[_Fold], alone: Figures) -> tuple[PhysicsGate, Heldout]:
    """The gate with the temperature of all folds, if temperatures chosen on the other folds did better than none."""
    table = np.array([[log_scores(part.p(t), part.level).sum() for t in TEMPERATURES] for part in parts])
    prior = -0.5 * (np.log(TEMPERATURES) / TEMPERATURE_SPREAD) ** 2
    chosen = [float(TEMPERATURES[np.argmax(prior + table.sum(axis=0) - row)]) for row in table]
    level = np.concatenate([part.level for part in parts])
    plain = np.concatenate([part.p(1.0) for part in parts])
    warmed = np.concatenate([part.p(t) for part, t in zip(parts, chosen, strict=True)])
    kept = log_scores(warmed, level).sum() > log_scores(plain, level).sum()
    best = float(TEMPERATURES[np.argmax(prior + table.sum(axis=0))]) if kept else 1.0
    p = warmed if kept else plain
    heldout = Heldout(p, level, figures_of(plain, level), figures_of(p, level), alone)
    return replace(gate, temperature=best), heldout


def _alone(gate: PhysicsGate, physics: Physics, marks: OutcomeClasses) -> Figures:
    """The forecast with nothing learned here: spread as the belief has it, half-heights of rig.toml, judged rows."""
    two_m, three_m = model.halves_of(gate.rig)
    shape = model.GateShape(1.0, model.PRIORS["floor_m"][0], two_m, min(three_m, two_m), model.PRIORS["lapse"][0])
    judged = marks.level >= 0
    spread_m = model.spread_m(shape, physics.sigma_m)
    cells = np.asarray(model.cell_probabilities(shape, physics.deviation_m, spread_m))[judged]
    return figures_of(np.stack([cells[:, 1:4].sum(axis=1), cells[:, 2]], axis=1), marks.level[judged])


def tell_residual(gate: PhysicsGate, features: np.ndarray, physics: Physics) -> list[str]:
    """How far the physics alone is off, and how shots scatter, at near, middle and far recorded shots [n, 3]."""
    learned_m, _ = model.residual(gate.fit, gate.scaling(features), physics)
    _, sigma_m = gate.correct(features, physics)
    order = np.array_split(np.argsort(features[:, 0], kind="stable"), 3)
    lines = []
    for rows in (rows for rows in order if rows.size):
        at_m, off_m = float(np.median(features[rows, 0])), -float(np.median(learned_m[rows]))
        side = "high" if off_m > 0.0 else "low"
        said = "the shots move the physics by less than 2 cm" if abs(off_m) < SILENT_M else (
            f"the physics alone is {100.0 * abs(off_m):.0f} cm {side}")
        lines.append(f"at {at_m:.1f} m {said}; "
                     f"a shot passes within {100.0 * float(np.median(sigma_m[rows])):.0f} cm of what the gate expects "
                     "two times in three")
    return lines


def tell_heldout(heldout: Heldout, temperature: float, target: Target | None = None) -> list[str]:
    """Report hold-out figures on configurations that the gate was not fitted to, though the belief may have been."""
    lines = ["on configurations that the correction had not learned from, each fifth in turn (the coefficients may "
             "have been fitted to them):",
             _figures("  the gate", heldout.plain), *_beside_commonest(heldout, target)]
    if temperature == 1.0:
        return [*lines, "calibration: the spread is as fitted; stretching it made unseen configurations no likelier"]
    how = "wider" if temperature > 1.0 else "narrower"
    return [*lines, _figures("  and calibrated", heldout.calibrated),
            f"calibration: the spread is made {abs(temperature - 1.0):.0%} {how}, as unseen configurations ask for"]


def _beside_commonest(heldout: Heldout, target: Target | None) -> list[str]:
    """Compare with what needs no gate: the commonest outcome for every shot, and the plain shares of outcomes."""
    shares, commonest = _commonest(heldout.level, target)
    by_shares = float((shares[shares > 0.0] * np.log(shares[shares > 0.0])).sum())
    lines = [f"  always naming the commonest, {commonest}: outcome right {shares.max():.1%}; by the plain shares of "
             f"outcomes: log score {by_shares:.3f}"]
    if heldout.calibrated.log_score <= by_shares:
        lines.append("warning: on shots that it had not seen the gate says no more than the plain shares of outcomes")
    return lines


def tell_too_few(group: np.ndarray, level: np.ndarray, target: Target | None) -> str:
    """Say that configurations [n] are too few to hold any out, and what needs no gate. level [n]: -1 is not judged."""
    shares, commonest = _commonest(level[level >= 0], target)
    return (f"warning: {len(np.unique(group[level >= 0]))} configurations with an outcome are too few to say whether "
            f"the gate is better than always naming the commonest, {commonest}, which is right for {shares.max():.1%} "
            f"of them; at least {MIN_CONFIGURATIONS} are needed")


def _commonest(level: np.ndarray, target: Target | None) -> tuple[np.ndarray, str]:
    """(shares of the outcomes, the word for the commonest)."""
    shares = np.bincount(level, minlength=len(LEVEL)) / max(len(level), 1)
    commonest = list(LEVEL)[int(np.argmax(shares))]
    return shares, commonest if target is None else target.word(commonest)


def _figures(name: str, figures: Figures) -> str:
    return (f"{name}: {figures.shots} shots, outcome right {figures.accuracy:.1%}, log score {figures.log_score:.3f}, "
            f"Brier {figures.brier:.4f}, stated and true shares differ by {figures.ece:.3f}")
