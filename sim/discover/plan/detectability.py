"""Effects that data of a kind can show, whatever their values: expected Fisher information of every term.

Of a term's information only that part counts which the fitted coefficients, scatters and random effects leave: the
efficient information I_ee - I_en I_nn^-1 I_ne. Its score is normal with that variance, and moved by size times
information. An effect is seen where its score is larger than the largest of all terms' scores is by chance, at the
share of the false alarms that discovery gives to terms: this threshold is simulated. Information grows with the shots.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from msgspec import Struct
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from scipy.special import ndtr, ndtri

from truearc.sim.discover.detect.test_battery import ALLOWANCE, TERMS
from truearc.sim.discover.settings import FALSE_ALARM
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable

SCHEMA = "truearc.identifiability/1"
FOUR_IN_FIVE = float(ndtri(0.8))      # standard deviations beyond the threshold, for a power of 0.8
DRAWS, SEED = 4000, 0                 # of scores by chance
ALIKE = 0.95                          # correlation of efficient slopes from which two terms are one to these data
LEAST_SHARE = 1e-4                    # of its own information, with all coefficients free, that a term needs to be seen
BUSY = 1e-12
NOTHING = 1e-9                        # information on a term at its usual size that no number of shots makes up for
ABSORBS = 0.1                         # of the largest coefficient's part, from which one is named, too
UNTOUCHED, TAKEN = "untouched", "taken up"      # values of truearc.identifiability/1


class TermIdentifiability(Struct, frozen=True):
    """One term. `usual`, `smallest` in `unit`; `power` of seeing it at its usual size with these shots.

    share_left: of its information, after the fitted numbers. shots_needed: to see it at its usual size, None where no
    number will do; then `why` is UNTOUCHED (nothing in the data depends on it) or TAKEN (the numbers that `taken_by`
    lists absorb it). like: the most similar other term with its correlation. also: known otherwise.
    """

    term: str                         # name in docs/reference/terms.md
    stage: str                        # sensing | launch | flight | arrival
    unit: str                         # of `usual` and `smallest`
    usual: float                      # usual size of the effect
    information: float                # 1 / variance of its amplitude, all else fitted
    share_left: float                 # of its information, after the fitted numbers
    shots_needed: int | None          # to see it at its usual size; null: no number will do
    smallest: float | None            # size seen four times in five with these shots
    power: float                      # probability of seeing it at its usual size
    why: str | None                   # null, or why no number of shots will do
    taken_by: tuple[str, ...]         # fitted numbers that absorb it
    like: str | None                  # most similar other term
    correlation: float                # with that one


class Fittable(Struct, frozen=True):
    """A number that is fitted anyway: its standard deviation before and after these shots."""

    name: str                         # term.parameter
    unit: str                         # of `before` and `after`
    before: float                     # standard deviation before these shots
    after: float                      # standard deviation after them


class Sight(Struct, frozen=True):
    """What `shots` of this kind could show. classes: terms that these data cannot tell apart (more than one each)."""

    shots: int                        # number of shots
    level: str                        # L0 outcomes | L1 with telemetry | L2 with tracks
    believed: tuple[str, ...]         # terms whose coefficients are fitted anyway
    terms: tuple[TermIdentifiability, ...] # most easily seen first
    classes: tuple[tuple[str, ...], ...] # terms that these data cannot tell apart, two or more each
    fitted: tuple[Fittable, ...]      # the numbers of `believed`
    schema: str = SCHEMA              # truearc.identifiability/1


def sight_of(evidence: ScoreTable, level: str, believed: tuple[str, ...], threshold: float | None = None) -> Sight:
    """Of every candidate term, most easily seen first; believed ones are among the fitted numbers.

    threshold: the |score| that a term needs, in standard deviations; None: as discovery would have it, simulated.
    """
    columns = np.array([k for k, column in enumerate(evidence.columns) if column.kind == "term"], dtype=int)
    own, left, free, parts = _efficient(evidence, columns)
    usual = np.array([evidence.columns[k].usual for k in columns])
    own = np.where(own * usual**2 > NOTHING, own, 0.0)
    visible = (own > BUSY) & (np.diag(free) > LEAST_SHARE * own)
    size = np.sqrt(np.maximum(np.diag(left), BUSY))
    alike = np.where(np.outer(visible, visible), left / np.outer(size, size), 0.0)
    names = [evidence.columns[k].term for k in columns]
    shots = len(evidence.rows)
    threshold = chance_threshold(alike[np.ix_(visible, visible)]) if threshold is None else threshold
    terms = [_seen(evidence.columns[k], float(own[i]), float(left[i, i]), threshold if visible[i] else np.inf, shots,
                   _takers(evidence, parts[i]), _most_alike(names, alike, i)) for i, k in enumerate(columns)]
    ordered = sorted(terms, key=lambda seen: (seen.shots_needed is None, seen.shots_needed or 0, seen.term))
    return Sight(shots, level, believed, tuple(ordered), _classes(names, alike, visible), _fittable(evidence))


def _efficient(evidence: ScoreTable, columns: Int[Array, " K"]) -> tuple[
        Float[Array, " K"], Float[Array, "K K"], Float[Array, "K K"], Float[Array, "K p"]]:
    """(own information [K], left [K, K], left where priors of coefficients do not help [K, K], parts [K, p]).

    parts: of each term's score, in its own standard deviations, what each shared column absorbs by itself.
    """
    shared = evidence.shared
    info = evidence.information
    inner, cross = info[shared, shared], info[columns][:, shared]
    square = info[np.ix_(columns, columns)]
    grouped = np.array([column.kind == "group" for column in evidence.columns[shared]], dtype=bool)
    lift = np.linalg.solve(inner + evidence.precision, cross.T)
    bare = np.linalg.pinv(inner + np.where(grouped[:, None] & grouped, evidence.precision, 0.0), 1e-12, hermitian=True)
    parts = np.abs(lift.T) * np.sqrt(np.maximum(np.diag(inner), 0.0))
    return np.diag(square).copy(), square - cross @ lift, square - cross @ bare @ cross.T, parts


def chance_threshold(correlation: Float[Array, "K K"]) -> float:
    """Limit, in standard deviations, that the largest of K scores so correlated passes in the terms' share of alarms.
    """
    size, turn = np.linalg.eigh(correlation)
    root = (turn * np.sqrt(np.maximum(size, 0.0))) @ turn.T
    drawn = np.random.default_rng(SEED).normal(size=(DRAWS, len(size))) @ root
    return float(np.quantile(np.abs(drawn).max(axis=1, initial=0.0), 1.0 - FALSE_ALARM * ALLOWANCE[TERMS]))


def _seen(column: Column, own: float, left: float, threshold: float, shots: int, takers: tuple[str, ...],
          like: tuple[str | None, float]) -> TermIdentifiability:
    visible = np.isfinite(threshold)
    information = left if visible else 0.0
    signal = np.sqrt(information) * column.usual
    power = float(ndtr(signal - threshold) + ndtr(-signal - threshold)) if visible else 0.0
    why = None if visible else UNTOUCHED if own <= BUSY else TAKEN
    needed = max(int(np.ceil(shots * ((threshold + FOUR_IN_FIVE) / signal)**2)), 1) if visible else None
    smallest = float((threshold + FOUR_IN_FIVE) / np.sqrt(information)) if visible else None
    return TermIdentifiability(column.term, column.stage, column.unit, column.usual, information,
                               left / own if own > BUSY else 0.0, needed, smallest, power, why,
                               takers if why == TAKEN else (), *like)


def _takers(evidence: ScoreTable, parts: Float[Array, " p"]) -> tuple[str, ...]:
    """Fitted numbers that absorb a term's information, largest part first."""
    order = [k for k in np.argsort(-parts) if parts[k] > max(ABSORBS * parts.max(initial=0.0), BUSY)]
    found = [evidence.columns[evidence.first_shared + k] for k in order]
    return tuple(dict.fromkeys(f"each {column.name.partition(' ')[0]}'s random effect" if column.kind == "group" else
                               column.name for column in found))


def _most_alike(names: list[str], alike: Float[Array, "K K"], index: int) -> tuple[str | None, float]:
    others = np.abs(alike[index]) * (np.arange(len(names)) != index)
    best = int(others.argmax()) if len(names) > 1 else 0
    return (names[best], float(alike[index, best])) if len(names) > 1 and others[best] > 0.0 else (None, 0.0)


def _classes(names: list[str], alike: Float[Array, "K K"],
             visible: Bool[Array, " K"]) -> tuple[tuple[str, ...], ...]:
    """Groups in which every two are more alike than ALIKE (complete linkage)."""
    kept = np.flatnonzero(visible)
    if len(kept) < 2:
        return ()
    distance = 1.0 - np.clip(np.abs(alike[np.ix_(kept, kept)]), 0.0, 1.0)
    np.fill_diagonal(distance, 0.0)
    number = fcluster(linkage(squareform(distance, checks=False), "complete"), 1.0 - ALIKE, "distance")
    groups = [tuple(names[k] for k in kept[number == one]) for one in dict.fromkeys(number.tolist())]
    return tuple(group for group in groups if len(group) > 1)


def _fittable(evidence: ScoreTable) -> tuple[Fittable, ...]:
    shared = evidence.shared
    before, after = (np.diag(np.linalg.inv(precision)) for precision in (
        evidence.precision, evidence.information[shared, shared] + evidence.precision))
    rows = zip(evidence.columns[shared], before, after, strict=True)
    return tuple(Fittable(column.name, column.unit, float(np.sqrt(known)), float(np.sqrt(variance)))
                 for column, known, variance in rows if column.kind == "shared")
