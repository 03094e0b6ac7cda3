"""The columns that are tested, for one dataset and belief: free changes, terms, and shared parameters."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Tracker
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.belief_prior import bent, inform, may_have_moved
from truearc.sim.infer.likelihood.forward_model import Chain
from truearc.sim.infer.likelihood.linearization import Groups, ParameterLayout
from truearc.sim.infer.likelihood.noise import (
    BALL_SPEED,
    BALLS_PART,
    CALIBRATED,
    OTHER_BALLS,
    OTHER_RAD,
    SCATTER_PRIOR,
    SCATTERS,
    UNMEASURED_M,
    WEAKER,
)
from truearc.sim.infer.likelihood.prepared_data import Intake
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, find_terms
from truearc.sim.physics.nonparametric import NAMELESS
from truearc.sim.physics.term import DIRECTIONS, STAGES, Parameter, Term, WatchTerm

BANDS = 6                             # of the flight's time, with tracks
LONGEST_STEP_S, MOST_DOUBLINGS = 0.02, 4          # of Runge-Kutta in a track
MOST_GROUPED = 0.34                   # groups per shot: with fewer than three shots each nothing would be left to test
MANY = 10.0                           # groups, counted by size, from which each has random effects

OTHERS = "others"                     # balls of a later session that are not told apart

# Keys of rig.toml's [tracker] that state how wrong it may be.
STATED = {"track_scale": "scale_sd", "track_tilt": "tilt_sd_deg", "track_clock": "clock_sd"}

# Deviations of single launches that may go with anything, and what each amounts to where it is at work.
FREE = (
    (0, Column("launch speed", "free", "launch", "along", "1", 0.2,
               ("the ball leaves faster", "the ball leaves slower"))),
    (1, Column("launch elevation", "free", "launch", "vertical", "rad", 0.0175,
               ("the ball leaves steeper", "the ball leaves flatter"))),
    (4, Column("distance", "free", "sensing", "along", "m", 0.12,
               ("the target is farther", "the target is nearer"))),
)
AZIMUTH = (2, Column("launch azimuth", "free", "launch", "lateral", "rad", 0.0175,
                     ("the ball leaves to the left", "the ball leaves to the right")))
PUSH_WORDS = {"along": ("the ball is driven along its flight", "the ball is held back along its flight"),
              "vertical": ("the ball is lifted across its flight", "the ball is pressed down across its flight"),
              "lateral": ("the ball is pushed to its left", "the ball is pushed to its right")}
PUSH_USUAL = 1.5                      # m/s2, as of a wrong drag law or a breeze of 1 m/s


def groups_of(shots: Shots, rows: Int[Array, " n"]) -> tuple[str, Int[Array, " n"], int] | None:
    """(what, label [n] of these rows, how many): balls when there are at least ten, else sessions when there are.

    Counted as (sum of sizes)^2 / sum of squares, so that a big group and its crumbs are not many. Many groups differ at
    random, and that is not a finding; with fewer a difference between them counts as one, since it could be known.
    """
    for name in ("ball_id", "session"):
        texts = np.array(shots.text(name))[rows]
        if not any(texts):
            continue
        levels, label, sizes = np.unique(texts, return_inverse=True, return_counts=True)
        if sizes.sum()**2 / (sizes**2).sum() >= MANY and len(levels) <= MOST_GROUPED * len(rows):
            return name, label, len(levels)
    return None


def lay_out(intake: Intake, believed: tuple[str, ...], groups: tuple[str, Int[Array, " n"], int] | None = None,
            among: Catalogue | None = None, belief: Belief | None = None,
            later: ParameterLayout | None = None) -> ParameterLayout:
    """Every column that the data could speak of; InputError for a believed term that there is none of.

    among: the catalogue whose terms are tested, and which the believed ones are of;
    truearc.sim.physics.catalogue.catalogue() when not given. belief: of this very rig, from an earlier session;
    whether a number in it has changed since is tested like any term.

    groups: (what, label [n] of the intake's shots, how many) of things with random effects, such as balls. later: of a
    session after the one that the belief was made from, which is laid out here: with the same bands of the flight, as
    free to have other balls, so that both absorb alike what the belief leaves, and as uncertain as without the belief,
    which must not be counted twice.
    """
    catalogue = as_catalogue(among)
    check_believed((name for name in believed if belief is None or name not in belief.coefficients), catalogue)
    slots = tuple((term.name, p.name) for term in catalogue for p in term.parameters)
    usual = np.array([float(p.default) for term in catalogue for p in term.parameters])
    tracked = intake.samples is not None
    chain = Chain(intake.stripped, catalogue.names, slots, BANDS if tracked else 0, _substeps(intake),
                  bool(len(intake.marked)), tracked, bool(np.asarray(intake.lanes.free).any()), catalogue)
    edges = _edges(intake) if later is None else later.edges_s
    first_push = len(slots) + chain.deviates
    found = [(column, len(slots) + number) for number, column in (*FREE, *([AZIMUTH] if intake.filmed else []))]
    found += [(column, first_push + number) for number, column in _pushes(chain, edges)]
    sideless = intake.scatter is not None and intake.scatter.sigma_m[1] >= UNMEASURED_M       # y tells nothing
    if sideless:
        found = [(column, place) for column, place in found if column.direction != "lateral"]
    trackers = calibrated(catalogue) if intake.filmed else [one for one in catalogue if isinstance(one, WatchTerm)]
    known = {*believed, *catalogue.always, *(term.name for term in trackers if tracked)}
    asked = [term for term in catalogue if term.name not in known and (belief is not None or not term.relative)
             and not (sideless and isinstance(term, WatchTerm) and term.direction == "lateral")]
    found += [(Column(f"{term.name}.{term.amplitude.name}", "term", term.stage, term.direction, term.amplitude.unit,
                      usual_of(term, intake.rig), follows=term.follows or ""),
               slots.index((term.name, term.amplitude.name))) for term in asked]
    shared = _shared(intake, believed, slots, catalogue)
    found += _changed(shared, belief)
    scatters = tuple(_scatter_place(intake, len(found) + len(shared), k) for k in range(len(SCATTERS)))
    names = [name for name, place in zip(SCATTERS, scatters, strict=True) if place >= 0]
    prior = [(mean, sd) for _, _, mean, sd in shared]
    prior += [(np.log(SCATTER_PRIOR[name][0]), np.log(SCATTER_PRIOR[name][1])) for name in names]
    found += [(column, place) for column, place, *_ in shared]
    found += [(Column(name, "shared", "launch", "along", "1", 1.0), -1) for name in names]
    effects: Groups | None
    if groups is not None:
        what, effects = groups[0], _groups(groups, believed, slots, catalogue)
    else:
        what, effects = OTHERS, None if belief is None else _other_balls(intake, belief, slots, catalogue)
    if effects is not None:
        found += [(Column(f"{what} {number}", "group", "launch", "along", "1", 1.0, told=what == OTHERS), -2)
                  for _ in effects.inputs for number in range(effects.count)]
        prior += [(0.0, 1.0)] * (effects.count * len(effects.inputs))
    centre, sd = np.array(prior, dtype=float).reshape(-1, 2).T
    columns, source = zip(*found, strict=True)
    layout = ParameterLayout(chain, columns, np.array(source, dtype=int), scatters, np.diag(sd**-2.0), centre, edges,
                             usual, effects)
    return layout if belief is None else inform(bent(layout, belief), belief, sure=later is None)


def _groups(groups: tuple[str, Int[Array, " n"], int], believed: tuple[str, ...], slots: tuple[tuple[str, str], ...],
            catalogue: Catalogue) -> Groups:
    """Speed, and believed numbers that each ball has its own of (Parameter.fit_each_ball)."""
    _, label, count = groups
    inputs, scale = [len(slots)], [BALL_SPEED]
    for term in catalogue.find(believed):
        for one in term.parameters:
            if one.fit_each_ball:
                inputs.append(slots.index((term.name, one.name)))
                scale.append(one.by_ball * (one.prior.centre if one.prior else 1.0))
    return Groups(label, count, np.array(inputs), np.array(scale))


def _other_balls(intake: Intake, belief: Belief, slots: tuple[tuple[str, str], ...], catalogue: Catalogue) -> Groups:
    """By how much the mean of a session's balls may differ from that of the belief's: less than one of them does."""
    inputs, scale = (_as_shots_differ(belief, slots) if intake.samples is None else
                     _as_balls_differ(belief, slots, catalogue))
    return Groups(np.zeros(len(intake.rows), dtype=int), 1, np.array(inputs, dtype=int),
                  np.array(scale) / np.sqrt(OTHER_BALLS))


def _as_balls_differ(belief: Belief, slots: tuple[tuple[str, str], ...],
                     catalogue: Catalogue) -> tuple[list[int], list[float]]:
    """In speed, elevation, and the believed numbers that go with a ball; tracks would see each."""
    of_a_ball = [(term, one) for stage in reversed(STAGES) for term in catalogue if term.stage == stage
                 for one in term.parameters if one.by_ball]
    mine = {(term.name, one.name): one.by_ball * abs(belief.value(f"{term.name}.{one.name}"))
            for term, one in of_a_ball if belief.has(f"{term.name}.{one.name}")}
    return ([len(slots), len(slots) + 1, *(slots.index(slot) for slot in mine)],
            [BALL_SPEED, OTHER_RAD, *mine.values()])


def _as_shots_differ(belief: Belief, slots: tuple[tuple[str, str], ...]) -> tuple[list[int], list[float]]:
    """In speed and elevation, by no more than launches do from shot to shot: outcomes show no more of a ball."""
    spread = belief.scatter.get("speed", 0.0), np.radians(belief.scatter.get("elevation_deg", 0.0))
    return [len(slots), len(slots) + 1], [float(np.sqrt(BALLS_PART) * value) for value in spread]


def usual_of(term: Term, rig: Rig) -> float:
    """One standard deviation of a term's amplitude, in its own unit, where it is at work at all."""
    prior = term.parameters[0].prior
    if term.indoor_sd is not None and rig.site and rig.site.indoor:
        return term.indoor_sd
    if prior is None:
        return 1.0
    if prior.scale == "linear":
        return max(abs(prior.centre), prior.sd)
    return prior.centre if prior.scale == "log" else max(prior.centre, prior.sd)


def weak_prior(parameter: Parameter) -> tuple[float, float]:
    """(centre, standard deviation) in the parameter's own unit: its prior, WEAKER times as wide."""
    prior = parameter.prior
    if prior is None:
        return parameter.default, 0.2 * (parameter.high - parameter.low)
    spread = {"linear": 1.0, "log": prior.centre, "left": 1.0 - prior.centre}[prior.scale]
    return prior.centre, WEAKER * spread * prior.sd


def check_believed(believed: Iterable[str], among: Catalogue | None = None) -> None:
    """InputError for a term that there is none of, and for one that stands for an unexplained effect."""
    for term in find_terms(believed, among):
        if term in NAMELESS:
            raise InputError(f"{term.name} stands for an unexplained effect; discovery starts from effects "
                           "that have names")


def _shared(intake: Intake, believed: tuple[str, ...],
            slots: tuple[tuple[str, str], ...], catalogue: Catalogue) -> list[tuple[Column, int, float, float]]:
    """(column, slot, mean, sd) of the believed terms' parameters and of the tracker's calibration."""
    found = []
    for term in catalogue.find(believed):
        for parameter in term.parameters if not term.always and term not in NAMELESS else ():
            centre, sd = weak_prior(parameter)
            column = Column(f"{term.name}.{parameter.name}", "shared", term.stage, "along", parameter.unit, sd)
            found.append((column, slots.index((term.name, parameter.name)), centre, sd))
    for term in calibrated(catalogue) if intake.filmed else ():
        if term.name not in believed:
            one, sd = term.amplitude, calibration_sd(term, intake.rig.tracker or Tracker())
            column = Column(f"{term.name}.{one.name}", "shared", "sensing", "along", one.unit, sd)
            found.append((column, slots.index((term.name, one.name)), 0.0, sd))
    return found


def calibrated(catalogue: Catalogue) -> tuple[Term, ...]:
    """Terms about a tracker's calibration, which is never so certain that it could name physics: fitted always."""
    return tuple(term for term in catalogue if term.calibration_sd is not None)


def calibration_sd(term: Term, tracker: Tracker) -> float:
    """One standard deviation of a tracker's error, as rig.toml states it, or as is usual of such a tracker."""
    stated: float | None = getattr(tracker, STATED.get(term.name, ""), None)
    return stated or (term.calibration_sd or 0.0) * (CALIBRATED if tracker.calibrated else 1.0)


def is_tracker(column: Column, among: Catalogue) -> bool:
    """Whether the column is a number of a tracker's errors, which are its own: no shot depends on them."""
    return isinstance(among.get(column.term), WatchTerm)


def _changed(shared: list[tuple[Column, int, float, float]], belief: Belief | None) -> list[tuple[Column, int]]:
    """(column, slot) of the changes since the belief; they have the names of what they are changes of."""
    found = [(column, place, may_have_moved(belief, column.name)) for column, place, *_ in shared]
    return [(replace(column, kind="term", usual=usual), place) for column, place, usual in found if usual is not None]


def _scatter_place(intake: Intake, first: int, number: int) -> int:
    """The column of a scatter, or -1 where nothing could tell it."""
    there = np.append(intake.scattered != 0.0, np.full((len(intake.rows), 1), intake.filmed), axis=1)
    wanted = [bool(there[:, k].any()) and (one != "scatter.azimuth_rad" or intake.filmed)
              for k, one in enumerate(SCATTERS)]
    return first + sum(wanted[:number]) if wanted[number] else -1


def _pushes(chain: Chain, edges: Float[Array, " edges"]) -> list[tuple[int, Column]]:
    """Throughout the flight, in each band of its time, and with the speed; outcomes see no sideways push."""
    width = chain.pushes // len(DIRECTIONS)
    found = []
    for number, direction in enumerate(DIRECTIONS):
        if direction == "lateral" and not chain.track:
            continue
        words, start = PUSH_WORDS[direction], number * width
        found.append((start, Column(f"push {direction}", "free", "flight", direction, "m/s2", PUSH_USUAL, words)))
        if not chain.bands:
            continue
        bounds = [0.0, *edges.tolist(), float("inf")]
        for band in range(chain.bands):
            span = (bounds[band], bounds[band + 1])
            found.append((start + 1 + band, Column(f"push {direction} from {span[0]:.2f} s", "free", "flight",
                                                   direction, "m/s2", PUSH_USUAL, words, "time_in_flight_s", span)))
        found.append((start + 1 + chain.bands, Column(f"push {direction} in proportion to speed", "free", "flight",
                                                      direction, "m/s2", PUSH_USUAL, words, "speed_in_flight_m_s")))
    return found


def _edges(intake: Intake) -> Float[Array, " edges"]:
    if intake.samples is None:
        return np.zeros(0)
    lead_s = np.asarray(intake.lanes.lead_s)[intake.tracked]
    times = (intake.samples.time_s + lead_s[:, None])[intake.samples.real]
    edges_s: Array = np.quantile(times, np.arange(1, BANDS) / BANDS)
    return edges_s


def _substeps(intake: Intake) -> int:
    """Runge-Kutta steps between samples, a power of two, since each number is compiled."""
    if intake.samples is None:
        return 1
    wanted = np.diff(intake.samples.time_s, axis=1).max(initial=0.0) / LONGEST_STEP_S
    return int(2 ** np.clip(np.ceil(np.log2(max(wanted, 1.0))), 0, MOST_DOUBLINGS))
