"""Next steps: shots or a measurement that would separate the remaining names, and the probability that they do so.

The candidates are configurations that were already shot: they are safe and within reach, and their information is known
from these data. The same place and hood angle with slightly slower or faster wheels, within the range of recorded
speeds, is a candidate too, because drivers aim at the middle of the target and outcomes are most informative at its
edge. Blocks of shots are chosen greedily by the separation that they add between every pair of names (Fedorov's
exchange without the backward step; the criterion of Box and Hill 1967 in its linear form).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.special import softmax

from truearc.robot.config.units import CONVERTED
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.discover.decide import Step
from truearc.sim.discover.detect.battery import name_of
from truearc.sim.discover.detect.covariates import IN_FLIGHT
from truearc.sim.discover.finding import CONFIGURATIONS, PLANNED_SHOTS
from truearc.sim.discover.identifiability import DRAWS, UNTOUCHED, Sight, TermIdentifiability
from truearc.sim.discover.select.terms import efficient, nats_for
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.term import Instrument, Term, WatchTerm

# Chosen: 1.7 and 3.3 of SPEED_SD, as far beside the centre as ASIDE, or farther
PACES = (1.0, 0.94, 0.97, 1.03, 1.06)             # of the wheels, times the recorded one
KEPT = 300                            # of the candidates, the best by themselves, that further blocks are chosen from
# Chosen: above the 0.9 of a name, for a plan is itself a forecast
SURE = 0.95                           # probability from which a name stands alone
LEAST_GAIN = 0.01                     # probability by which a plan must raise that of one name that stands alone
LEAST_PROBABILITY = 1e-6             # of a name: the logarithm of none has no end
MOST_NAMES = 8                        # bounds the work
MOST_RANDOM = 64                      # times the present shots, up to which random ones are counted

Option = tuple[int, float]            # row of the evidence's shots, pace
Information = Float[Array, "P P"]


@dataclass(frozen=True)
class Block:
    """Shots of one configuration: `row` of the evidence's shots, with wheels `pace` times as fast."""

    row: int
    shots: int
    pace: float = 1.0


@dataclass(frozen=True)
class PlannedMeasurement:
    instrument: Instrument
    terms: tuple[str, ...]
    probability: float                # that one name stands alone afterwards


@dataclass(frozen=True)
class Design:
    """names with their probabilities; before, after: probability that the right one stands alone, now and with the
    blocks. random: shots like the present ones that would part the names as well; None beyond MOST_RANDOM times."""

    names: tuple[str, ...]
    probability: Float[Array, " K"]
    blocks: tuple[Block, ...]
    before: float
    after: float
    random: int | None
    measurements: tuple[PlannedMeasurement, ...]


@dataclass(frozen=True)
class Contest:
    """K names: columns of the evidence, amplitudes, sizes, probabilities, and what refits add to one step."""

    scores: ScoreTable
    columns: Int[Array, " K"]
    amplitude: Float[Array, " K"]
    usual: Float[Array, " K"]
    probability: Float[Array, " K"]
    offset: Float[Array, " K"]        # nats


def make_design(step: Step, shots: int = PLANNED_SHOTS, configurations: int = CONFIGURATIONS, seed: int = 0) -> Design:
    """Return blocks of equal numbers of shots, most informative first. ValueError if fewer than two names compete."""
    if not can_design(step):
        raise ValueError("fewer than two names compete")
    names = _competing(step)
    contest = contest_of(step, names)
    block = max(shots // configurations, 1)
    there = at_paces(step.fitted)

    def information_of(option: Option) -> Information:
        return there[option[1]].told_by([option[0]])

    chosen = choose_blocks(contest, block, within_reach(step.fitted, there), configurations, information_of)
    more = block * np.sum([information_of(option) for option in chosen], axis=0)
    told_by = _measurements(contest, names, seed, step.fitted.model.catalogue)
    measurements = sorted(told_by, key=lambda one: -one.probability)
    return Design(names, contest.probability, tuple(Block(row, block, pace) for row, pace in chosen),
                  float((contest.probability * (contest.probability >= SURE)).sum()),
                  chance_of_name(contest, more, seed), _random_equal(contest, more), tuple(measurements))


def can_design(step: Step) -> bool:
    """Return whether there are two or more names to separate."""
    return not step.unknown and len(_competing(step)) > 1


def _competing(step: Step) -> tuple[str, ...]:
    """Of the set the names that were truly refitted, whose amplitudes are known."""
    return tuple(name for name in step.chosen if name in step.naming.refits)[:MOST_NAMES]


def contest_of(step: Step, names: tuple[str, ...]) -> Contest:
    """Return the contest between these names of a step."""
    evidence, naming = step.fitted.scores, step.naming
    columns = np.array([evidence.index(name) for name in names], dtype=int)
    usual = np.array([evidence.columns[k].usual for k in columns])
    # as the finding has them, of one of these names being right
    likely = np.array([max(naming.probability[name], LEAST_PROBABILITY) for name in names])
    nats = np.log(likely / likely.sum())
    score, left = efficient(evidence, columns, 0.0)
    linear = np.array([nats_for(score[k], float(left[k, k]), usual[k]) for k in range(len(names))])
    amplitude = np.array([naming.refits[name].amplitude[0] for name in names])
    return Contest(evidence, columns, amplitude, usual, softmax(nats), nats - linear)


def separation(contest: Contest, more: Information | float) -> Float[Array, "K K"]:
    """Return delta [K, K]: the chi-squared distance of name k, at its best, from data that j makes; 0 on the
    diagonal."""
    left = efficient(contest.scores, contest.columns, more)[1]
    own = np.maximum(np.diag(left), 1e-300)
    return contest.amplitude[:, None]**2 * np.maximum(own[:, None] - left**2 / own[None, :], 0.0)


def worth(contest: Contest, more: Information | float) -> float:
    """Return the mean log separation of pairs, each as likely as its two names; the criterion of a design."""
    weight = np.outer(contest.probability, contest.probability) * (1.0 - np.eye(len(contest.columns)))
    return float((weight * np.log1p(separation(contest, more))).sum() / weight.sum())


def at_paces(fitted: LauncherFit) -> dict[float, ScoreTable]:
    """Return {pace: expected evidence of all shots at it}; only the recorded pace if tracks or measured exits give the
    speed of each ball."""
    intake, there = fitted.model.data, {1.0: fitted.scores}
    if intake.samples is not None or np.isfinite(intake.exits).any() or not np.asarray(intake.lanes.rolled).any():
        return there
    rolling = intake.lanes.rolling
    for pace in PACES[1:]:
        faster = rolling._replace(speed_m_s=pace * np.asarray(rolling.speed_m_s),
                                  spin_rev_s=pace * np.asarray(rolling.spin_rev_s))
        lanes = intake.lanes._replace(rolling=faster)
        there[pace] = replace(fitted.model, data=replace(intake, lanes=lanes)).linearise(fitted.point)[0]
    return there


def within_reach(fitted: LauncherFit, paces: Iterable[float]) -> list[tuple[int, float]]:
    """Return (row, pace) of every configuration whose wheel speeds stay within the observed range."""
    lanes = fitted.model.data.lanes
    speed, rolled = np.asarray(lanes.rolling.speed_m_s), np.asarray(lanes.rolled)
    low, high = (speed[rolled].min(), speed[rolled].max()) if rolled.any() else (0.0, 0.0)
    return [(row, pace) for pace in paces for row in range(len(speed))
            if pace == 1.0 or (rolled[row] and low <= pace * speed[row] <= high)]


def choose_blocks(contest: Contest, block: int, options: Sequence[Option], count: int,
                  information_of: Callable[[Option], Information]) -> list[Option]:
    """The options of which `block` shots each are made; one may come more than once.

    information_of: [P, P], of one shot of an option."""
    total: Information | float = 0.0
    chosen: list[Option] = []
    left = list(options)
    for _ in range(count):
        value = np.array([worth(contest, total + block * information_of(option)) for option in left])
        chosen.append(left[int(np.argmax(value))])
        total = total + block * information_of(chosen[-1])
        if not chosen[1:]:
            left = [left[k] for k in np.argsort(-value, kind="stable")[:KEPT]]
    return chosen


def chance_of_name(contest: Contest, more: Information, seed: int) -> float:
    """Return the probability that the right name will hold SURE of the probability, given `more` information.

    Truths are drawn as likely as they are now, each at its fitted amplitude; scores to come are normal.
    """
    rng = np.random.default_rng(seed)
    score, left = efficient(contest.scores, contest.columns, 0.0)
    after = efficient(contest.scores, contest.columns, more)[1]
    gained = after - left
    values, vectors = np.linalg.eigh(gained)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    truth = rng.choice(len(contest.columns), DRAWS, p=contest.probability)
    come = rng.normal(size=(DRAWS, len(values))) @ root.T + (gained[:, truth] * contest.amplitude[truth]).T
    nats = np.stack([nats_for(score[k] + come[:, k], float(after[k, k]), contest.usual[k])
                     for k in range(len(contest.columns))], axis=1)
    return _stands_alone(nats + contest.offset, truth)


def _stands_alone(nats: Float[Array, "draws K"], truth: Int[Array, " draws"]) -> float:
    return float(np.mean(softmax(nats, axis=1)[np.arange(len(truth)), truth] >= SURE))


def _random_equal(contest: Contest, more: Information) -> int | None:
    """Shots drawn like the present ones that are worth as much as `more`."""
    wanted, present = worth(contest, more), contest.scores.information
    shots = len(contest.scores.rows)
    low, high = 0.0, float(MOST_RANDOM)
    if worth(contest, high * present) < wanted:
        return None
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if worth(contest, middle * present) >= wanted else (middle, high)
    return int(np.ceil(high * shots))


def _measurements(contest: Contest, names: tuple[str, ...], seed: int, among: Catalogue) -> list[PlannedMeasurement]:
    """Each thing that can be measured, and what it would do: it finds the amplitude of its terms, or nothing."""
    terms = [name.partition(".")[0] for name in names]
    instruments = [among.find([term])[0].instrument for term in terms]
    found = []
    proposed = {one.id: one for one in instruments if one is not None and one.sd is not None}
    for name, instrument in proposed.items():
        mine = {k: one.sd for k, one in enumerate(instruments)
                if one is not None and one.id == name and one.sd is not None}
        chance = _chance_measured(contest, len(terms), mine, seed)
        found.append(PlannedMeasurement(instrument, tuple(terms[k] for k in mine), chance))
    return found


def _chance_measured(contest: Contest, count: int, mine: Mapping[int, float], seed: int) -> float:
    """As chance_of_name of `count` names, for a measurement of the amplitudes of those that `mine` has the accuracy of.
    """
    rng = np.random.default_rng(seed)
    truth = rng.choice(count, DRAWS, p=contest.probability)
    nats = np.tile(np.log(contest.probability), (DRAWS, 1))
    for k, sd in mine.items():
        amplitude = contest.amplitude[k]
        seen = np.where(truth == k, amplitude, 0.0) + sd * rng.normal(size=DRAWS)
        nats[:, k] += (seen**2 - (seen - amplitude)**2) / (2.0 * sd**2)
    return _stands_alone(nats, truth)


SHOTS = PLANNED_SHOTS // CONFIGURATIONS
STAND_IN = "wind_z"                   # rising air pushes as lift does
FEW = 3                               # measurements proposed at most; chosen: a printed list


def next_steps(dataset: Dataset, step: Step, chosen: tuple[str, ...] | None) -> tuple[dict[str, Any], ...]:
    """Return measurements that settle the competing names (or confirm the only one), the configuration at which the
    two likeliest names differ most, and what to record for every later shot. The configuration comes first if its shots
    leave one name more often than the best measurement does, and is left out if they hardly ever do."""
    if chosen is None:
        vertical = step.place is not None and step.place.column.direction == "vertical"
        return (*_spin(dataset, vertical), *_about_unknown(step), *_sides(dataset))
    terms = [term for name in chosen for term in step.fitted.model.catalogue.find([name])]
    tracked = dataset.tracks is not None or dataset.times is not None
    steps = [*_spin(dataset, STAND_IN in chosen), *measure_terms(terms, tracked)]
    if len(step.chosen) < 2:
        return tuple(steps)
    shot = parting_shot(dataset, step, (step.chosen[0], step.chosen[1]))
    if shot is None:
        return (*steps, *_sides(dataset))
    row, asked = shot
    names = _competing(step)
    contest = contest_of(step, names)
    now = float(contest.probability[contest.probability >= SURE].sum())
    then = chance_of_name(contest, SHOTS * contest.scores.told_by([row]), 0)
    measured = max((one.probability for one in _measurements(contest, names, 0, step.fitted.model.catalogue)),
                   default=0.0)
    if then < now + LEAST_GAIN:
        return (*steps, *_sides(dataset))
    return (asked, *steps, *_sides(dataset)) if then >= measured else (*steps, asked, *_sides(dataset))


def has_spin(dataset: Dataset) -> bool:
    """Return whether lift can be tested: spin was measured, or there are wheels that give it."""
    return bool(dataset.rig.launcher.wheel) or any(
        np.isfinite(dataset.shots.number(name)).any() for name in ("exit_spin_rev_s", *SPIN_VECTOR))


def _spin(dataset: Dataset, like_lift: bool) -> tuple[dict[str, Any], ...]:
    """What looks like lift asks for the spin, where lift could not be tested."""
    return ({"do": "measure", "record": "exit_spin_rev_s", "what": "the spin of a marked ball as it leaves (column "
             "exit_spin_rev_s): missing lift would look like this"},) if like_lift and not has_spin(dataset) else ()


def blind_terms(sight: Sight) -> list[TermIdentifiability]:
    """Return the tested terms that these shots would not have shown at their usual size, four times in five.

    Those that move shots most come first, whether or not fitted numbers can stand in for them; last those that nothing
    in the data depends on.
    """
    blind = [one for one in sight.terms if one.smallest is None or one.smallest > one.usual]
    return sorted(blind, key=lambda one: (one.why == UNTOUCHED,
                                          -one.usual**2 * one.information / max(one.share_left, 1e-9)))


def measure_blind(blind: Sequence[TermIdentifiability], tracked: bool, among: Catalogue) -> tuple[dict[str, Any], ...]:
    """Return the measurements for the first of these terms; none for flights that are already filmed."""
    found: dict[str, tuple[str, list[str]]] = {}
    for (term,) in (among.find([one.term]) for one in blind):
        if term.instrument is not None and not (tracked and (isinstance(term, WatchTerm) or term.instrument.filmed)):
            found.setdefault(term.instrument.id, (term.instrument.what, []))[1].append(term.name)
    return tuple({"do": "measure", "instrument": name, "what": what, "shows": terms}
                 for name, (what, terms) in list(found.items())[:FEW])


def measure_terms(terms: Sequence[Term], tracked: bool = False) -> tuple[dict[str, Any], ...]:
    """Return the measurements that settle which of these terms it is; none for flights that are already filmed."""
    instruments = [term.instrument for term in terms]
    wanted = {one.id: one.what for one in instruments if one is not None and not (tracked and one.filmed)}
    return tuple({"do": "measure", "instrument": name, "what": what} for name, what in list(wanted.items())[:FEW])


def _about_unknown(step: Step) -> tuple[dict[str, Any], ...]:
    """An unexplained effect is looked for beside the covariate that it goes with."""
    place = step.place
    name = None if place is None else name_of(place.test, place.column)
    if name is None or name in IN_FLIGHT:
        if step.fitted.model.data.filmed:
            return _of_filmed(step)
        return ({"do": "measure", "record": "tracks", "what": "the flight with a camera from the side (tracks.csv)"},)
    return ({"do": "measure", "covariate": name, "what": f"what else changes with {name}, which it goes with"},)


def _of_filmed(step: Step) -> tuple[dict[str, Any], ...]:
    """What settles the nearest name, if it is not seen on film anyway; else the wind, where there can be one."""
    (term,) = step.fitted.model.catalogue.find([step.naming.leader.partition(".")[0]])
    if term.instrument is not None and not term.instrument.filmed:
        return ({"do": "measure", "instrument": term.instrument.id, "what": term.instrument.what},)
    site = step.fitted.model.data.rig.site
    if site and site.indoor:
        return ()
    return ({"do": "measure", "instrument": "anemometer", "what": "the wind with an anemometer"},)


def _sides(dataset: Dataset) -> tuple[dict[str, Any], ...]:
    """A shot without a side tells half of what it could."""
    outcome, side = dataset.shots.text("outcome"), dataset.shots.text("side")
    target = dataset.rig.target
    up, hit = target is not None and target.faces_up, "hit" if target and target.hit_or_miss else "two"
    blind = {word: sum(one == said and not where for one, where in zip(outcome, side, strict=True))
             for word, said in (("miss", "miss"), (hit, "two")) if said == "miss" or not up}
    if sum(blind.values()) <= 0.5 * sum(map(bool, outcome)):
        return ()
    words = " and each ".join(f"{word} ({count} lack it)" for word, count in blind.items() if count)
    return ({"do": "measure", "record": "side",
             "what": f"where each {words} comes down, short, long, left or right (column side)" if up else
             f"on which side of the centre, low or high, each {words} passes (column side)"},)


def parting_shot(dataset: Dataset, step: Step, pair: tuple[str, str]) -> tuple[int, dict[str, Any]] | None:
    """Return the recorded configuration where the two terms, each fitted, forecast the most different heights, and its
    row of the evidence; None if SHOTS of them would not show the difference."""
    evidence = step.fitted.scores
    plane = evidence.plane
    if plane is None or any(name not in step.naming.refits for name in pair):
        return None
    changes = (np.tile(moved_by(evidence, step.naming.refits[name]), (len(evidence.rows), 1)) for name in pair)
    one, other = (evidence.heights(change)[1] for change in changes)
    apart = np.abs(one - other) / plane.spread_m
    if apart.max() * SHOTS**0.5 < 1.0:          # standard errors of the mean of SHOTS heights
        return None
    row = int(plane.rows[int(apart.argmax())])
    shot = int(evidence.rows[row])
    numbers = {name: dataset.shots.number(name)[shot] for name in ("distance_m", "hood_deg", "motor_ratio")}
    if not np.isfinite(list(numbers.values())).all():
        return None
    free_rad_s = dataset.rig.launcher.free_speed_rad_s
    rpm = CONVERTED["rad_s"]["rpm"]
    motor = {"motor_rpm": round(float(numbers["motor_ratio"]) * free_rad_s / rpm)} if free_rad_s else {}
    return row, {"do": "shoot", **{name: round(float(value), 3) for name, value in numbers.items()}, **motor,
                 "shots": SHOTS, "separates": [name.partition(".")[0] for name in pair]}


def moved_by(evidence: ScoreTable, one: LauncherFit) -> Float[Array, " P"]:
    """Return the change [P] of the evidence's columns that corresponds to a refit of one name.

    A name that is a fitted number itself (one that has changed since the belief) stands in that number's place: it is
    then a move from where the number was fitted, not from where it was believed.
    """
    (name,) = one.names
    shared = range(evidence.first_shared, len(evidence.columns))
    rest = [k for k in shared if evidence.columns[k].name != name]
    change = np.zeros(len(evidence.columns))
    change[rest] = one.scores.point[1:] - evidence.point[rest]
    if len(rest) == len(shared):
        change[evidence.index(name)] = one.amplitude[0]
    for k in set(shared) - set(rest):
        change[k] = one.scores.point[0] - evidence.point[k]
    return change
