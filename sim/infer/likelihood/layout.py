"""The layout of the fitted and tested columns for one dataset and belief, with their priors.

Columns are free changes, terms and shared parameters. Priors come from the catalogue, where they are wide, from the
posterior of an earlier session, or from measurements made without shots, by tape measure, scale or inclinometer:

    {"target_height.rise_m": Measurement(0.04, 0.01)}
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import block_diag

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Tracker
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import BALL_SPEED, SCATTER, Belief, Curve, scale_of
from truearc.sim.infer.likelihood import noise
from truearc.sim.infer.likelihood.data import Intake
from truearc.sim.infer.likelihood.forward_model import Chain, Prediction
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.physics import catalogue as known_terms
from truearc.sim.physics.catalogue import CURVE, NAMELESS, Catalogue
from truearc.sim.physics.term import DIRECTIONS, LEFT, LOG, STAGES, Parameter, Term, WatchTerm, complete


class Measurement(NamedTuple):
    """A measurement in the unit of the term's amplitude; 0: no such effect."""

    value: float
    sd: float


Measured = Mapping[str, Measurement]  # by the column "term.parameter"


@dataclass(frozen=True)
class Groups:
    """Things that shots share a few at a time and that differ at random, such as balls: each its own small effects.

    label [n] numbers each shot's thing, below `count`; inputs, scale [B]: the chain's inputs that an effect moves, and
    by how much a unit of it does; names [B]: as of `Belief.balls`.
    """

    label: Int[Array, " n"]
    count: int
    inputs: Int[Array, " B"]
    scale: Float[Array, " B"]
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """Which columns of the evidence are which inputs of the chain.

    columns: free, terms, then shared. source [P]: for each column its input of the chain (slot, deviate or push), or
    -1 for a scatter, -2 for a group's effect (those come last, effect by effect, group by group). scatters: columns of
    the logs of SCATTERS, in that order, -1 where not fitted. precision [p, p], centre [p]: the shared columns' prior.
    changes: as of truearc.sim.infer.model.Columns. usual [slots]: the chain's parameters by default. measured: external
    measurements of candidate terms. see: flies the chain in place of see_slopes. steady: the spread of heights at the
    plane is taken not to change with the inputs.
    """

    chain: Chain
    columns: tuple[Column, ...]
    source: Int[Array, " P"]
    scatters: tuple[int, ...]
    precision: Float[Array, "p p"]
    centre: Float[Array, " p"]
    edges_s: Float[Array, " edges"]
    usual: Float[Array, " slots"]
    groups: Groups | None = None
    measured: Measured = field(default_factory=dict)
    see: Callable[..., tuple[Prediction, Prediction]] | None = None
    steady: bool = False
    changes: Mapping[str, float] = field(default_factory=dict)

    @property
    def inputs(self) -> Int[Array, " inputs"]:
        """The chain's inputs that are flown, those of groups last."""
        own = self.source[self.source >= 0]
        return own if self.groups is None else np.concatenate([own, self.groups.inputs])

    @property
    def first_shared(self) -> int:
        return len(self.columns) - len(self.precision)

    @property
    def believed(self) -> dict[str, float]:
        """{shared column: centre of its prior}."""
        names = (column.name for column in self.columns[self.first_shared:])
        return dict(zip(names, self.centre.tolist(), strict=True))

    @property
    def in_slot(self) -> Bool[Array, " P"]:
        """Which columns are parameters of terms."""
        return (self.source >= 0) & (self.source < len(self.chain.slots))

    @property
    def grouped(self) -> int:
        """Number of columns that are effects of groups."""
        return int((self.source == -2).sum())


@dataclass(frozen=True)
class Point:
    """Where the chain is linearised: `values` [slots], log scatters [S], each shot's deviates [n, D], and the effects
    of groups [Q], to which all is taken to be linear."""

    values: Float[Array, " slots"]
    log_scatter: Float[Array, " S"]
    deviates: Float[Array, "n D"]
    effects: Float[Array, " Q"]

    @staticmethod
    def still(layout: Layout, shots: int, values: Float[Array, " slots"],
              log_scatter: Float[Array, " S"]) -> "Point":
        """Return the point of `shots` without deviations."""
        return Point(values, log_scatter, np.zeros((shots, layout.chain.deviates)), np.zeros(layout.grouped))


def column_of(term: str, among: Catalogue | None = None) -> str:
    """Return the column of a term's amplitude, its first parameter. InputError for an unknown term."""
    (found,) = known_terms.find_terms([term], among)
    return f"{term}.{found.parameters[0].name}"


class MeasuredPrior(NamedTuple):
    centre: float
    precision: float


def prior_of(measured: Measured, column: str, usual: float) -> MeasuredPrior:
    """Return the prior of a term's amplitude of that usual size, after its measurement."""
    if column not in measured:
        return MeasuredPrior(0.0, usual**-2.0)
    value, sd = measured[column]
    precision = usual**-2.0 + sd**-2.0
    return MeasuredPrior(value * sd**-2.0 / precision, precision)


def read_measured(words: Sequence[str], option: str, among: Catalogue | None = None) -> Measured:
    """Parse TERM=VALUE,SD words; InputError names the option and what is wrong."""
    found = {}
    for word in words:
        term, _, numbers = word.partition("=")
        try:
            value, sd = map(float, numbers.split(","))
        except ValueError as error:
            raise InputError(f"{option} {word}: not TERM=VALUE,SD, such as target_height=0.04,0.01") from error
        if not np.isfinite([value, sd]).all() or sd <= 0.0:
            raise InputError(f"{option} {word}: a finite value and a standard deviation above 0 are needed")
        try:
            found[column_of(term, among)] = Measurement(value, sd)
        except InputError as error:
            raise InputError(f"{option} {word}: {error}") from error
    return found


BANDS = 6                             # of the flight's time, with tracks; chosen: sixths of a second of a long flight
LONGEST_STEP_S, MOST_DOUBLINGS = 0.02, 4          # of Runge-Kutta in a track
# Derived: a third, and rounding
MOST_GROUPED = 0.34                   # groups per shot: with fewer than three shots each nothing would be left to test
# Chosen: clusters fewer than that make tests unreliable (Cameron, Gelbach and Miller 2008)
MANY = 10.0                           # groups, counted by size, from which each has random effects

OTHERS = "others"                     # balls of a later session that are not told apart

# Keys of rig.toml's [tracker] that state how wrong it may be.
STATED = {"track_scale": "scale_sd", "track_tilt": "tilt_sd_deg", "track_clock": "clock_sd"}

# Deviations of single launches that may go with anything, and what each amounts to where it is at work.
# Derived: as of exit_efficiency, of hood_offset, and of distance_scale at 6 m.
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
# Derived: three tenths of the 5 m/s2 of drag on a foam ball of 7 inches at 10 m/s
PUSH_USUAL = 1.5                      # m/s2, as of a wrong drag law or a breeze of 1 m/s


def groups_of(shots: Shots, rows: Int[Array, " n"]) -> tuple[str, Int[Array, " n"], int] | None:
    """Return (what, label [n] of these rows, how many): balls if there are at least ten, else sessions if there are.

    The number is (sum of sizes)^2 / sum of squares, so that one large and many tiny groups do not count as many. Many
    groups differ at random, which is not a finding; with fewer, a difference between them is one, since its cause could
    be known.
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
            later: Layout | None = None) -> Layout:
    """Lay out every column that the data could inform; InputError for an unknown believed term.

    among: the catalogue whose terms are tested, and which the believed ones are of;
    truearc.sim.physics.catalogue.catalogue() when not given. belief: of this very rig, from an earlier session;
    whether a number in it has changed since is tested like any term.

    groups: (what, label [n] of the intake's shots, how many) of things with random effects, such as balls. later: of a
    session after the one that the belief was made from, which is laid out here: with the same bands of the flight, as
    free to have other balls, so that both absorb alike what the belief leaves, and as uncertain as without the belief,
    which must not be counted twice.
    """
    catalogue = known_terms.as_catalogue(among).of(intake.rig)
    check_believed((name for name in believed if belief is None or name not in belief.coefficients), catalogue)
    slots = tuple((term.name, p.name) for term in catalogue for p in term.parameters)
    usual = np.array([float(p.default) for term in catalogue for p in term.parameters])
    tracked, filmed = intake.samples is not None, intake.filmed
    chain = Chain(intake.stripped, catalogue.names, slots, BANDS if tracked else 0, _substeps(intake),
                  bool(len(intake.marked)), tracked, bool(np.asarray(intake.lanes.free).any()), catalogue)
    edges = _edges(intake) if later is None else later.edges_s
    first_push, width = len(slots) + chain.deviates, chain.pushes // len(DIRECTIONS)
    aside = filmed or intake.seen.axes > 1
    found = [(column, len(slots) + number) for number, column in (*FREE, *([AZIMUTH] if aside else []))]
    found += [(column, first_push + number) for number, column in _pushes(chain, width, edges)]
    sideless = intake.scatter is not None and intake.scatter.sigma_m[1] >= noise.UNMEASURED_M       # y tells nothing
    if sideless:
        found = [(column, place) for column, place in found if column.direction != "lateral"]
    trackers = calibrated(catalogue) if filmed else [one for one in catalogue if isinstance(one, WatchTerm)]
    known = {*believed, *catalogue.always, *(term.name for term in trackers if tracked)}
    asked = [term for term in catalogue if term.name not in known and (belief is not None or not term.relative)
             and not (sideless and isinstance(term, WatchTerm) and term.direction == "lateral")]
    found += [(Column(f"{term.name}.{term.amplitude.name}", "term", term.stage, term.direction, term.amplitude.unit,
                      usual_of(term, intake.rig), follows=term.follows or ""),
               slots.index((term.name, term.amplitude.name))) for term in asked]
    shared = _shared(intake, believed, slots, catalogue)
    found += _changed(shared, belief)
    scatters = tuple(_scatter_place(intake, len(found) + len(shared), k) for k in range(len(noise.SCATTERS)))
    names = [name for name, place in zip(noise.SCATTERS, scatters, strict=True) if place >= 0]
    prior = [(mean, sd) for _, _, mean, sd in shared]
    prior += [(np.log(noise.SCATTER_PRIOR[name][0]), np.log(noise.SCATTER_PRIOR[name][1])) for name in names]
    found += [(column, place) for column, place, *_ in shared]
    found += [(Column(name, "shared", "launch", "along", "1", 1.0), -1) for name in names]
    effects: Groups | None
    if groups is not None:
        what, effects = groups[0], _groups(groups, believed, slots, catalogue, {} if belief is None else belief.balls)
    else:
        what, effects = OTHERS, None if belief is None else _other_balls(intake, belief, slots, catalogue)
    if effects is not None:
        found += [(Column(f"{what} {number}", "group", "launch", "along", "1", 1.0, told=what == OTHERS), -2)
                  for _ in effects.inputs for number in range(effects.count)]
        prior += [(0.0, 1.0)] * (effects.count * len(effects.inputs))
    centre, sd = np.array(prior, dtype=float).reshape(-1, 2).T
    columns, source = zip(*found, strict=True)
    layout = Layout(chain, columns, np.array(source, dtype=int), scatters, np.diag(sd**-2.0), centre, edges,
                             usual, effects)
    return layout if belief is None else inform(bent(layout, belief), belief, sure=later is None)


def _groups(groups: tuple[str, Int[Array, " n"], int], believed: tuple[str, ...], slots: tuple[tuple[str, str], ...],
            catalogue: Catalogue, known: Mapping[str, float]) -> Groups:
    """Speed, and believed numbers that each ball has its own of (Parameter.fit_each_ball); known: how much balls
    differ in them by an earlier session."""
    _, label, count = groups
    spread = {BALL_SPEED: (len(slots), noise.BALL_SPEED)}
    for term in catalogue.find(believed):
        for one in term.parameters:
            if one.fit_each_ball:
                spread[f"{term.name}.{one.name}"] = (slots.index((term.name, one.name)),
                                                     one.by_ball * (one.prior.centre if one.prior else 1.0))
    return Groups(label, count, np.array([place for place, _ in spread.values()]),
                  np.array([known.get(name, usual) for name, (_, usual) in spread.items()]), tuple(spread))


def _other_balls(intake: Intake, belief: Belief, slots: tuple[tuple[str, str], ...], catalogue: Catalogue) -> Groups:
    """By how much the mean of a session's balls may differ from that of the belief's: less than one of them does."""
    inputs, scale = (_as_shots_differ(belief, slots) if intake.samples is None else
                     _as_balls_differ(belief, slots, catalogue))
    return Groups(np.zeros(len(intake.rows), dtype=int), 1, np.array(inputs, dtype=int),
                  np.array(scale) / np.sqrt(noise.OTHER_BALLS))


def _as_balls_differ(belief: Belief, slots: tuple[tuple[str, str], ...],
                     catalogue: Catalogue) -> tuple[list[int], list[float]]:
    """In speed, elevation, and the believed numbers that go with a ball; tracks would see each."""
    of_a_ball = [(term, one) for stage in reversed(STAGES) for term in catalogue if term.stage == stage
                 for one in term.parameters if one.by_ball]
    mine = {(term.name, one.name): one.by_ball * abs(belief.value(f"{term.name}.{one.name}"))
            for term, one in of_a_ball if belief.has(f"{term.name}.{one.name}")}
    return ([len(slots), len(slots) + 1, *(slots.index(slot) for slot in mine)],
            [noise.BALL_SPEED, noise.OTHER_RAD, *mine.values()])


def _as_shots_differ(belief: Belief, slots: tuple[tuple[str, str], ...]) -> tuple[list[int], list[float]]:
    """In speed and elevation, by no more than launches do from shot to shot: outcomes show no more of a ball."""
    spread = belief.scatter.get("speed", 0.0), np.radians(belief.scatter.get("elevation_deg", 0.0))
    return [len(slots), len(slots) + 1], [float(np.sqrt(noise.BALLS_PART) * value) for value in spread]


def usual_of(term: Term, rig: Rig) -> float:
    """Return one standard deviation of a term's amplitude, in its own unit, if the effect is present."""
    prior = term.parameters[0].prior
    if term.indoor_sd is not None and rig.site and rig.site.indoor:
        return term.indoor_sd
    if prior is None:
        return 1.0
    if prior.scale == "linear":
        return max(abs(prior.centre), prior.sd)
    return prior.centre if prior.scale == "log" else max(prior.centre, prior.sd)


def weak_prior(parameter: Parameter) -> tuple[float, float]:
    """Return (centre, standard deviation) in the parameter's own unit: its prior, WEAKER times as wide."""
    prior = parameter.prior
    if prior is None:
        return parameter.default, 0.2 * (parameter.high - parameter.low)       # chosen: the range is five deviations
    spread = {"linear": 1.0, "log": prior.centre, "left": 1.0 - prior.centre}[prior.scale]
    return prior.centre, noise.WEAKER * spread * prior.sd


def check_believed(believed: Iterable[str], among: Catalogue | None = None) -> None:
    """Raise InputError for an unknown term, and for one that represents an unexplained effect."""
    for term in known_terms.find_terms(believed, among):
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
    """Return terms of a tracker's calibration, which is never certain enough to name physics: always fitted."""
    return tuple(term for term in catalogue if term.calibration_sd is not None)


def calibration_sd(term: Term, tracker: Tracker) -> float:
    """Return one standard deviation of a tracker's error, from rig.toml or as usual for such a tracker."""
    stated: float | None = getattr(tracker, STATED.get(term.name, ""), None)
    return stated or (term.calibration_sd or 0.0) * (noise.CALIBRATED if tracker.calibrated else 1.0)


def is_tracker(column: Column, among: Catalogue) -> bool:
    """Return whether the column is an error of the tracker alone: no shot depends on it."""
    return isinstance(among.get(column.term), WatchTerm)


def _changed(shared: list[tuple[Column, int, float, float]], belief: Belief | None) -> list[tuple[Column, int]]:
    """(column, slot) of the changes since the belief; they have the names of what they are changes of."""
    found = [(column, place, may_have_moved(belief, column.name)) for column, place, *_ in shared]
    return [(replace(column, kind="term", usual=usual), place) for column, place, usual in found if usual is not None]


def _scatter_place(intake: Intake, first: int, number: int) -> int:
    """The column of a scatter, or -1 where nothing could tell it."""
    there = np.append(intake.scattered != 0.0, np.full((len(intake.rows), 1), intake.filmed), axis=1)
    wanted = [bool(there[:, k].any()) and (one != "scatter.azimuth_rad" or intake.filmed or intake.seen.axes > 1)
              for k, one in enumerate(noise.SCATTERS)]
    return first + sum(wanted[:number]) if wanted[number] else -1


def _pushes(chain: Chain, width: int, edges: Float[Array, " edges"]) -> list[tuple[int, Column]]:
    """Throughout the flight, in each band of its time, and with the speed: `width` of each direction; outcomes see no
    sideways push."""
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
    times = (intake.samples.time_s + np.asarray(intake.lanes.lead_s)[intake.tracked][:, None])[intake.samples.real]
    return np.asarray(np.quantile(times, np.arange(1, BANDS) / BANDS))


def _substeps(intake: Intake) -> int:
    """Runge-Kutta steps between samples, a power of two, since each number is compiled."""
    if intake.samples is None:
        return 1
    wanted = np.diff(intake.samples.time_s, axis=1).max(initial=0.0) / LONGEST_STEP_S
    return int(2 ** np.clip(np.ceil(np.log2(max(wanted, 1.0))), 0, MOST_DOUBLINGS))


# Names of scatters here -> in a belief; the others are of sensors, not of the launch.
SCATTER_NAMES = {"scatter.speed": "speed", "scatter.elevation_rad": "elevation_deg"}
# Bounds a belief's precision
SUREST = 1e-4                         # of the catalogue's deviation: a belief may have some combination as exact
# Chosen: repairs and other balls move one rig's numbers by less than rigs differ; a tenth of the variance
MOVES = 0.3                           # of a parameter's prior deviation, by which one and the same rig may have changed


def believed_name(name: str) -> str:
    """Return the column's name in a belief."""
    return f"{SCATTER}.{SCATTER_NAMES[name]}" if name in SCATTER_NAMES else name


def own_value(belief: Belief, name: str) -> float:
    """Return the belief's value of a column that it knows, in the column's unit (scatters: the logarithm)."""
    value = belief.value(believed_name(name))
    if name not in SCATTER_NAMES:
        return value
    return float(np.log(np.radians(value) if name.endswith("_rad") else value))


def own_slope(name: str, value: float, among: Catalogue) -> float:
    """Return d(column) / d(number on its scale), on which beliefs have their covariance; `value` in the column's
    unit."""
    if name in SCATTER_NAMES:
        return 1.0                    # columns of scatters are logarithms already
    return {LOG: value, LEFT: 1.0 - value}.get(scale_of(name, among), 1.0)


def inform(layout: Layout, belief: Belief, sure: bool = True) -> Layout:
    """Return the layout, whose priors are independent, with the belief's better knowledge.

    A coefficient that the belief states without uncertainty keeps its width and takes the belief's value; so do all
    unless `sure`.
    """
    first = layout.first_shared
    columns = [replace(column, told=column.told or believed_name(column.name) in belief.names)
               for column in layout.columns[first:]]
    centre, covariance = layout.centre.copy(), np.diag(1.0 / np.diag(layout.precision))
    usual = np.sqrt(np.diag(covariance))
    for k, column in enumerate(columns):
        if belief.has(believed_name(column.name)):
            centre[k] = own_value(belief, column.name)
    if not sure:
        return replace(layout, centre=centre)
    known = [k for k, column in enumerate(columns) if believed_name(column.name) in belief.names]
    number = [belief.names.index(believed_name(columns[k].name)) for k in known]
    slope = np.array([own_slope(columns[k].name, centre[k], belief.catalogue) for k in known])
    covariance[np.ix_(known, known)] = belief.covariance[np.ix_(number, number)] * np.outer(slope, slope)
    covariance += np.diag((SUREST * usual)**2)
    return replace(layout, columns=(*layout.columns[:first], *columns), centre=centre,
                   precision=np.linalg.inv(covariance))


def may_have_moved(belief: Belief | None, name: str) -> float | None:
    """Return the usual change of a parameter that the belief knows, in its own unit; None if it does not know it."""
    if belief is None or name in SCATTER_NAMES or name not in belief.names:
        return None
    prior = known_terms.find_parameter(name, belief.catalogue).prior
    if prior is None:
        return None
    return MOVES * prior.sd * {LOG: prior.centre, LEFT: 1.0 - prior.centre}.get(prior.scale, 1.0)


def widened(precision: Float[Array, "p p"], by: Iterable[tuple[int, float]]) -> Float[Array, "p p"]:
    """Return the prior's precision after numbers [(place, standard deviation)] may have changed (Sherman and
    Morrison)."""
    for place, sd in by:
        row = precision[place]
        precision = precision - np.outer(row, row) * sd**2 / (1.0 + sd**2 * row[place])
    return precision


def bent(layout: Layout, belief: Belief) -> Layout:
    """Return the layout with the belief's unexplained effects, and the points of their curves among the shared
    columns."""
    for name, curve in belief.curves.items():
        layout = with_curve(layout, name, belief.coefficients[name], curve)
    return layout


def with_curve(layout: Layout, name: str, values: Mapping[str, float], curve: Curve) -> Layout:
    """Return the layout with the nameless term `name`, its parameters fixed, and the curve's points, at their present
    values, before the shared columns."""
    chain, term = layout.chain, known_terms.find_nameless(name)
    whole = complete(term, values)
    old, first = len(chain.slots), layout.first_shared
    slots = (*((name, key) for key in whole), *((CURVE, f"{name}.{key}") for key in curve.keys))
    points = old + len(whole) + np.arange(len(curve.fitted))
    columns = [Column(f"{CURVE}.{name}.{key}", "shared", term.stage, "along", term.amplitude.unit, term.usual)
               for key in curve.fitted]
    more = len(columns)
    source = _shifted(layout.source, old, len(slots))
    groups = layout.groups
    return replace(
        layout, chain=replace(chain, terms=(*chain.terms, name), slots=(*chain.slots, *slots)),
        columns=(*layout.columns[:first], *columns, *layout.columns[first:]),
        source=np.concatenate([source[:first], points, source[first:]]),
        scatters=tuple(place + more if place >= first else place for place in layout.scatters),
        precision=block_diag(np.diag(np.full(more, term.usual**-2.0)), layout.precision),
        centre=np.concatenate([[curve.point(key) for key in curve.fitted], layout.centre]),
        usual=np.concatenate([layout.usual, list(whole.values()), curve.points]),
        groups=groups and replace(groups, inputs=_shifted(groups.inputs, old, len(slots))))


def _shifted(inputs: Int[np.ndarray, " k"], first: int, by: int) -> Int[np.ndarray, " k"]:
    """Numbers of the chain's inputs once `by` slots have come after the `first` ones."""
    return np.where(inputs >= first, inputs + by, inputs)


def only_shared(layout: Layout, more: Iterable[str] = ()) -> Layout:
    """The layout without free columns and terms, except the named ones, which become shared with their usual size
    as a prior. One that is a change of a shared number widens that one's prior instead, and puts it in front."""
    first = layout.first_shared
    asked = {column.name: k for k, column in enumerate(layout.columns[:first]) if column.name in set(more)}
    shared = {column.name: k for k, column in enumerate(layout.columns) if k >= first}
    changed = [shared[name] for name in asked if name in shared]
    named = [k for name, k in asked.items() if name not in shared]
    rest = [k for k in range(first, len(layout.columns)) if k not in changed]
    kept = [*named, *changed, *rest]
    place = {column: number for number, column in enumerate(kept)}
    changes = {layout.columns[k].name: layout.columns[asked[layout.columns[k].name]].usual for k in changed}
    known = widened(layout.precision, [(k - first, sd) for k, sd in zip(changed, changes.values(), strict=True)])
    order = np.array([*changed, *rest], dtype=int) - first
    own = [prior_of(layout.measured, layout.columns[k].name, layout.columns[k].usual) for k in named]
    precision = block_diag(np.diag([one.precision for one in own]), known[np.ix_(order, order)])
    return Layout(lean_chain(layout, kept), tuple(layout.columns[k] for k in kept), layout.source[kept],
                  tuple(place.get(column, -1) for column in layout.scatters), precision,
                  np.concatenate([[one.centre for one in own], layout.centre[order]]), layout.edges_s, layout.usual,
                  layout.groups, layout.measured, layout.see, layout.steady, {**layout.changes, **changes})


def promoted(layout: Layout, names: tuple[str, ...]) -> Layout:
    """Return the layout with these columns moved from the tested to the shared ones."""
    kept = [k for k in range(layout.first_shared) if layout.columns[k].name not in names]
    inner = only_shared(layout, names)
    shift = len(kept)
    return replace(inner, chain=layout.chain, columns=(*(layout.columns[k] for k in kept), *inner.columns),
                   source=np.concatenate([layout.source[kept], inner.source]),
                   scatters=tuple(place + shift if place >= 0 else -1 for place in inner.scatters))


def lean_chain(layout: Layout, kept: list[int]) -> Chain:
    """Return the chain with the fewest terms in the air that these columns need, from two choices, so that compiled
    code is shared."""
    chain = layout.chain
    airborne = {term.name for term in known_terms.flight_terms(chain.terms, chain.catalogue)}
    known = {column.term for column in layout.columns[layout.first_shared:]}
    known |= {*chain.catalogue.always, *(term.name for term in NAMELESS)}
    if {layout.columns[k].term for k in kept} & airborne - known:
        return chain
    return replace(chain, terms=tuple(name for name in chain.terms if name not in airborne or name in known))
