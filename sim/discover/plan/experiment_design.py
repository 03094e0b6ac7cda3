"""Which shots, or which measurement, would tell the remaining names apart, and how likely they are to.

Every configuration that has been shot is one that can be shot again: safe, within reach, and its information is known
at the level of these very data. So is the same place and hood with the wheels a little slower or faster, as far as they
have turned at all: drivers aim at the middle, and outcomes tell most at its edge. Shots are chosen one block after
another by what they add to the separation of every two names (Fedorov's exchange without going back; the criterion of
Box and Hill 1967, in its linear form).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.special import softmax

from truearc.sim.discover.select.name_effects import Step
from truearc.sim.discover.select.term_ranking import efficient, nats_for
from truearc.sim.discover.settings import CONFIGURATIONS, PLANNED_SHOTS
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.term_fields import Instrument

NEVER = 1e-300                        # of a name that is out of the question, so that it has a logarithm
DRAWS = 4000
PACES = (1.0, 0.94, 0.97, 1.03, 1.06)             # of the wheels, times the recorded one
KEPT = 300                            # of the candidates, the best by themselves, that further blocks are chosen from
SURE = 0.95                           # probability from which a name stands alone
LEAST_PROBABILITY = 1e-6             # of a name: the logarithm of none has no end
MOST_NAMES = 8
MOST_RANDOM = 64                      # times the present shots, up to which random ones are counted

Option = tuple[int, float]            # row of the evidence's shots, pace
Information = Float[Array, "P P"]


@dataclass(frozen=True)
class Block:
    """Shots of one configuration: `row` of the evidence's shots, its wheels `pace` times as fast."""

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
    """K names: columns of the evidence, amplitudes, sizes, probabilities, and what refits know beyond one step."""

    evidence: ScoreTable
    columns: Int[Array, " K"]
    amplitude: Float[Array, " K"]
    usual: Float[Array, " K"]
    probability: Float[Array, " K"]
    offset: Float[Array, " K"]        # nats


def make_design(step: Step, shots: int = PLANNED_SHOTS, configurations: int = CONFIGURATIONS, seed: int = 0) -> Design:
    """Blocks of equal numbers of shots, most telling first. ValueError where fewer than two names compete."""
    if not can_design(step):
        raise ValueError("fewer than two names compete")
    names = _competing(step)
    contest = _contest(step, names)
    block = max(shots // configurations, 1)
    there = at_paces(step.fitted)

    def information_of(option: Option) -> Information:
        return there[option[1]].told_by([option[0]])

    chosen = choose_blocks(contest, block, within_reach(step.fitted, there), configurations, information_of)
    more = block * np.sum([information_of(option) for option in chosen], axis=0)
    told_by = _measurements(contest, names, seed, step.fitted.layout.chain.catalogue)
    measurements = sorted(told_by, key=lambda one: -one.probability)
    return Design(names, contest.probability, tuple(Block(row, block, pace) for row, pace in chosen),
                  float((contest.probability * (contest.probability >= SURE)).sum()),
                  chance_of_name(contest, more, seed), _random_equal(contest, more), tuple(measurements))


def can_design(step: Step) -> bool:
    """Whether there are two names or more to tell apart."""
    return not step.unknown and len(_competing(step)) > 1


def _competing(step: Step) -> tuple[str, ...]:
    """Of the set the names that were truly refitted, whose amplitudes are known."""
    return tuple(name for name in step.chosen if name in step.naming.refits)[:MOST_NAMES]


def _contest(step: Step, names: tuple[str, ...]) -> Contest:
    evidence, naming = step.fitted.evidence, step.naming
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
    """Delta [K, K]: how far name k, at its best, is from data that j makes, as a chi-squared; 0 on the diagonal."""
    left = efficient(contest.evidence, contest.columns, more)[1]
    own = np.maximum(np.diag(left), 1e-300)
    return contest.amplitude[:, None]**2 * np.maximum(own[:, None] - left**2 / own[None, :], 0.0)


def worth(contest: Contest, more: Information | float) -> float:
    """Mean log separation of pairs, each as likely as its two names; what a design is chosen by."""
    weight = np.outer(contest.probability, contest.probability) * (1.0 - np.eye(len(contest.columns)))
    return float((weight * np.log1p(separation(contest, more))).sum() / weight.sum())


def at_paces(fitted: BaselineFit) -> dict[float, ScoreTable]:
    """{pace: expected evidence of all shots so}; the recorded one alone where tracks or measured exits tell how fast
    each ball was."""
    intake, there = fitted.intake, {1.0: fitted.evidence}
    if intake.samples is not None or np.isfinite(intake.exits).any() or not np.asarray(intake.lanes.rolled).any():
        return there
    rolling = intake.lanes.rolling
    for pace in PACES[1:]:
        faster = rolling._replace(speed_m_s=pace * np.asarray(rolling.speed_m_s),
                                  spin_rev_s=pace * np.asarray(rolling.spin_rev_s))
        lanes = intake.lanes._replace(rolling=faster)
        there[pace] = linearise(replace(intake, lanes=lanes), fitted.layout, fitted.spot)[0]
    return there


def within_reach(fitted: BaselineFit, paces: Iterable[float]) -> list[tuple[int, float]]:
    """(row, pace) of every configuration whose wheels turn no slower and no faster than they have been seen to."""
    lanes = fitted.intake.lanes
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
    """Probability that the right name will hold SURE of the probability, were `more` information there.

    Truths are drawn as likely as they are now, each at its fitted amplitude; scores to come are normal.
    """
    rng = np.random.default_rng(seed)
    score, left = efficient(contest.evidence, contest.columns, 0.0)
    after = efficient(contest.evidence, contest.columns, more)[1]
    gained = after - left
    values, vectors = np.linalg.eigh(gained)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    truth = rng.choice(len(contest.columns), DRAWS, p=contest.probability)
    come = rng.normal(size=(DRAWS, len(values))) @ root.T + (gained[:, truth] * contest.amplitude[truth]).T
    nats = np.stack([nats_for(score[k] + come[:, k], float(after[k, k]), contest.usual[k])
                     for k in range(len(contest.columns))], axis=1)
    return _stands_alone(nats + contest.offset, truth)


def _stands_alone(nats: Float[Array, "draws K"], truth: Int[Array, " draws"]) -> float:
    chance = softmax(nats, axis=1)
    return float(np.mean(chance[np.arange(len(truth)), truth] >= SURE))


def _random_equal(contest: Contest, more: Information) -> int | None:
    """Shots drawn like the present ones that are worth as much as `more`."""
    wanted, present = worth(contest, more), contest.evidence.information
    shots = len(contest.evidence.rows)
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
    nats = np.tile(np.log(np.maximum(contest.probability, NEVER)), (DRAWS, 1))
    for k, sd in mine.items():
        amplitude = contest.amplitude[k]
        seen = np.where(truth == k, amplitude, 0.0) + sd * rng.normal(size=DRAWS)
        nats[:, k] += (seen**2 - (seen - amplitude)**2) / (2.0 * sd**2)
    return _stands_alone(nats, truth)
