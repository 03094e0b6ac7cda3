"""A Term, which is a hypothesis about the physics: its name, stage, numbers, wording, instrument and contribution.

The stages of a shot are: sensor readings -> SensingTerm -> true values -> LaunchTerm -> exit state of the ball ->
AirTerm, FlightTerm -> flight -> ArrivalTerm -> outcome; a WatchTerm describes a tracker that observes the flight. Hooks
receive effective values, which are the parameters as Term.at_shot returns them, either scalars or one value per lane.

A term is self-contained: no other module keeps a table keyed by the names of terms. A catalogue checks each term for
completeness when it is added.

A vector is three separate arrays: x toward the target, y left and z up.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import RECORDED, Circumstances

# Keeps the derivative of a length finite at zero; far below any speed that a double could be added to.
TINY = 1e-200


class Vec(NamedTuple):
    """Three arrays; a component that is the Python float 0.0 is absent, and stays absent through the operations below.

    A flight in the vertical plane thereby costs two dimensions while every law is written once, for three.
    """

    x: Any
    y: Any
    z: Any


def absent(value: Any) -> bool:
    """Return whether a component is the literal zero (an array is never absent, whatever it contains)."""
    return isinstance(value, float) and value == 0.0


def plus(a: Any, b: Any) -> Any:
    """a + b of components."""
    if absent(a):
        return b
    return a if absent(b) else a + b


def times(a: Any, b: Any) -> Any:
    """a * b of components."""
    return 0.0 if absent(a) or absent(b) else a * b


def add(a: Vec, b: Vec) -> Vec:
    return Vec(plus(a.x, b.x), plus(a.y, b.y), plus(a.z, b.z))


def total(vectors: Iterable[Vec]) -> Vec:
    return reduce(add, vectors, Vec(0.0, 0.0, 0.0))


def scale(factor: Any, a: Vec) -> Vec:
    return Vec(times(factor, a.x), times(factor, a.y), times(factor, a.z))


def dot(a: Vec, b: Vec) -> Any:
    return plus(plus(times(a.x, b.x), times(a.y, b.y)), times(a.z, b.z))


def cross(a: Vec, b: Vec) -> Vec:
    """a x b, right-handed."""
    return Vec(_minus(times(a.y, b.z), times(a.z, b.y)),
               _minus(times(a.z, b.x), times(a.x, b.z)),
               _minus(times(a.x, b.y), times(a.y, b.x)))


def length(a: Vec) -> Any:
    """|a|, with a finite derivative at zero."""
    return jnp.sqrt(dot(a, a) + TINY)


def axes(velocity: Vec) -> tuple[Vec, Vec, Vec]:
    """Return unit vectors along the velocity, across it and up, and to the left; across ones fade as it becomes
    vertical."""
    flat = velocity.x**2 + velocity.y**2
    speed = jnp.sqrt(flat + velocity.z**2 + 1e-12)
    along = Vec(velocity.x / speed, velocity.y / speed, velocity.z / speed)
    level = jnp.sqrt(along.x**2 + along.y**2 + 1e-6)
    left = Vec(-along.y / level, along.x / level, 0.0 * level)
    up = Vec(-along.z * left.y, along.z * left.x, along.x * left.y - along.y * left.x)
    return along, up, left


def _minus(a: Any, b: Any) -> Any:
    return plus(a, times(-1.0, b))


# Scales on which beliefs are about normal: positive parameters by their logarithm, shares lost by what is left.
LINEAR, LOG, LEFT = "linear", "log", "left"
SCALES = (LINEAR, LOG, LEFT)

Shown = tuple[float, str]             # factor from the parameter's unit, unit as text with its space
SHARE: Shown = (100.0, " %")
ANGLE: Shown = (1.0, "°")
LENGTH: Shown = (100.0, " cm")
SPEED: Shown = (1.0, " m/s")
NUMBER: Shown = (1.0, "")
SECONDS: Shown = (1.0, " s")


@dataclass(frozen=True)
class Prior:
    """Weak prior of a parameter, normal on one of SCALES, with its reason as text.

    `centre` is a value of the parameter itself; `sd` is on the scale (on "log": the log of a factor).
    """

    scale: str
    centre: float
    sd: float
    reason: str


@dataclass(frozen=True)
class Parameter:
    """One number of a term, which fits search from `low` to `high`.

    Attributes:
        unit: A product of m, kg, s, rad, rev, deg with powers, such as "1", "1/s" or "kg m/s2"; a share is "1".
        default: Value if a coefficients file does not mention it.
        source: Source of the range.
        prior: Prior of a likelihood fit; None: known, and not fitted.
        meaning: The number in a few words, with the meaning of a positive sign.
        by_ball: Standard deviation between balls, as a share of the number; 0: equal for all balls.
        fit_each_ball: Whether each ball gets its own number if balls are distinguished.
        percent: Whether reports of a fit show it in per cent.
        below: What a value below `low` means, and what to make sure of before it is believed.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    source: str
    prior: Prior | None = None
    meaning: str = ""
    by_ball: float = 0.0
    fit_each_ball: bool = False
    percent: bool = False
    below: str = "which physics seldom has"


def amplitude(name: str, unit: str, low: float, high: float, *, sd: float, meaning: str, source: str, reason: str,
              scale: str = "linear", centre: float = 0.0, **more: Any) -> tuple[Parameter]:
    """Return the parameters of a term that has only its amplitude, which is 0 by default.

    Args:
        low, high: Range of a search; `source` says where it comes from.
        sd: Of the prior about `centre` on `scale`; `reason` says why.
        more: Further fields of Parameter.
    """
    return (Parameter(name, unit, low, high, 0.0, source, Prior(scale, centre, sd, reason), meaning, **more),)


class Instrument(NamedTuple):
    """What to measure, and with what, to settle a term without a shot.

    id: Snake case, the same for every term that one measurement settles; findings, plans and claims name it by this.
    what: The same as text for people.
    sd: one standard deviation of what a team's tools give of the amplitude, in its unit: assumed, not measured. None:
    no such figure is assumed, so no plan counts on the measurement.
    filmed: By filming the ball; not proposed where its flights were tracked.
    """

    id: str
    what: str
    sd: float | None
    filmed: bool = False


class Phrase(NamedTuple):
    """`more`, `less`: what a positive and a negative amplitude mean; {} takes the size.

    The amplitude times `factor` is in `unit`; `per`: what the size is stated for. rate: the amplitude is a rate, and
    the size its inverse, a time constant, in `unit`.
    """

    more: str
    less: str
    factor: float
    unit: str
    per: str = ""
    rate: bool = False


def either_way(text: str, scale: Shown = NUMBER, per: str = "", rate: bool = False) -> Phrase:
    """Return a phrase whose two directions differ where `text` has alternatives: "the air is {} <denser|thinner>".

    Args:
        text: Takes the size in place of {}.
        scale: Factor and unit in which the size is shown.
        per: That for which the size is stated.
        rate: The amplitude is a rate, shown as its time constant.
    """
    more, less = (re.sub(r"<(.*?)\|(.*?)>", rf"\{side}", text) for side in (1, 2))
    return Phrase(more, less, *scale, per, rate)


def to_scale(scale: str, value: Any) -> Any:
    """Convert numbers or numpy arrays; linear: unchanged; log: logarithm; left: -log(1 - value), of a lost share."""
    if scale == LOG:
        return np.log(value)
    return -np.log1p(-value) if scale == LEFT else value


def from_scale(scale: str, number: Any) -> Any:
    """Invert to_scale, also for JAX arrays."""
    if scale == LOG:
        return jnp.exp(number)
    return -jnp.expm1(-number) if scale == LEFT else number


def fits_scale(scale: str, value: float) -> bool:
    """Return whether a value has a finite place on the scale."""
    return value > 0.0 if scale == LOG else value < 1.0 or scale != LEFT


class Exit(NamedTuple):
    """The ball as it leaves; numpy or JAX arrays of one shape."""

    speed_m_s: Any
    elevation_rad: Any                # above horizontal
    spin_rev_s: Any                   # backspin positive
    above_m: Any = 0.0                # of the rig's release height

    def take(self, rows: Any) -> "Exit":
        """Return those lanes; a number shared by all lanes stays unchanged."""
        return Exit(*(part if np.ndim(part) == 0 else part[rows] for part in self))


__all__ = [
    "ANGLE", "DIRECTIONS", "KINDS", "LENGTH", "NUMBER", "SECONDS", "SHARE", "SPEED", "STAGES", "AirShareTerm",
    "AirTerm", "ArrivalTerm", "BallState", "Circumstances", "DistanceTerm", "Exit", "FlightTerm", "ForceShareTerm",
    "Forces", "HoodTerm", "InFlight", "Instrument", "LaunchTerm", "Number", "Opening", "Parameter", "Phrase", "Prior",
    "Rig", "SensingTerm", "SpeedTerm", "Term", "Values", "Vec", "WatchTerm", "WindTerm", "amplitude", "complete",
    "either_way", "wind_speed",
]

STAGES = ("sensing", "launch", "flight", "arrival")
AXES = {"along": "x", "vertical": "z", "lateral": "y"}
DIRECTIONS = tuple(AXES)
NOT_OF_AIR = ("gravity",)             # among the forces before those that are shares of the air's

Number = Any                          # a number, or an array with one per lane
Values = Mapping[str, Any]            # of one term: {parameter: value}
Forces = Mapping[str, Vec]            # {term: acceleration in m/s2}


class BallState(NamedTuple):
    """The ball in flight, launcher frame (x toward the target, y left, z up; origin on the floor below the exit)."""

    position_m: Vec
    velocity_m_s: Vec
    spin_rev_s: Vec                   # right-handed; backspin is about -y
    time_s: Any = 0.0                 # since release


class Opening(NamedTuple):
    """The opening that a ball has to pass at the target; in m, as in rig.toml [target].

    The halves are of an upright opening's height; of one that faces up they are the ring's radius and half the length
    toward the launcher. bounce: share of the speed into a backboard with which the ball comes back.
    """

    centre_m: Any
    three_half_m: Any
    two_half_m: Any
    bounce: Any = 0.6                 # chosen: as of foam balls off plywood; a basketball's off glass is 0.7 to 0.8


class Term(ABC):
    """A hypothesis. `parameters[0]` is its amplitude; at zero the term is absent regardless of the others.

    Instances have no state: a subclass declares only class data, and two instances of one class are equal.

    Attributes:
        name: By default the class name in snake_case.
        stage: One of STAGES, set by the base class.
        order: Position among the terms of its stage, by ascending number, with the reason.
        parameters: The amplitude first.
        direction: Shift of a typical shot by a positive amplitude: along, up across, or left of the flight.
        sentence: Sentence of a report that states the effect.
        phrase: The same with the size of the effect.
        topspin_phrase: The same for balls with topspin, if topspin reverses the direction.
        instrument: Measurement that decides it without shots; None if it is `always` active.
        label: Name in running text; by default the name with spaces.
        follows: Field of Circumstances that multiplies the amplitude.
        record: Data of shots required to show it; "" if every dataset is sufficient. By default the requirement of the
            circumstance that it follows.
        relative: Tested only if an earlier session reported the changed quantity.
        always: Active in every simulation, with known parameters.
        unseen: Reason why no number of shots can show it; "" if enough shots can.
        positive: Prior probability that the amplitude is above 0, if nature prefers one sign.
        law_sd: For a law of physics, whose amplitude is 1 if the simulation lacks it: standard deviation of the
            amplitude; None: any size is possible.
        indoor_sd: Standard deviation of the amplitude in a closed hall, if different.
        calibration_sd: For a tracker calibration fitted with every track: standard deviation of the amplitude's prior;
            None: the amplitude is tested like any other.
        of_backboard: Tested only of targets with a backboard.
        compared: Whether a tested tracker calibration is compared with an earlier session's, like fitted ones.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    order: ClassVar[tuple[float, str]]
    parameters: ClassVar[tuple[Parameter, ...]]
    direction: ClassVar[str]
    sentence: ClassVar[str]
    phrase: ClassVar[Phrase]
    topspin_phrase: ClassVar[Phrase | None] = None
    instrument: ClassVar[Instrument | None]
    label: ClassVar[str]
    follows: ClassVar[str | None] = None
    record: ClassVar[str] = ""
    relative: ClassVar[bool] = False
    always: ClassVar[bool] = False
    unseen: ClassVar[str] = ""
    positive: ClassVar[float] = 0.5
    law_sd: ClassVar[float | None] = None
    indoor_sd: ClassVar[float | None] = None
    calibration_sd: ClassVar[float | None] = None
    of_backboard: ClassVar[bool] = False
    compared: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "name" not in cls.__dict__:
            cls.name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()
        if "label" not in cls.__dict__:
            cls.label = cls.name.replace("_", " ")
        cls.record = cls.record or RECORDED.get(cls.follows or "", "")

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)

    def __hash__(self) -> int:
        return hash(type(self))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    @property
    def amplitude(self) -> Parameter:
        """The first parameter, which is zero if the term is absent."""
        return self.parameters[0]

    def at_shot(self, values: Values, circumstances: Circumstances) -> Values:
        """Return the values in the circumstances of shots: the amplitude times what it follows. Shapes broadcast."""
        if self.follows is None:
            return values
        amplitude = self.amplitude.name
        return {**values, amplitude: values[amplitude] * getattr(circumstances, self.follows)}


class SensingTerm(Term):
    """A hypothesis about errors of the robot's sensors."""

    stage = "sensing"

    @abstractmethod
    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        """Return the true launch by the wheels and distance in m; differentiable.

        exit, distance_m: values of the sensors, corrected by the preceding sensing terms of the catalogue.
        """


class WatchTerm(Term):
    """A hypothesis about a tracker that observes the flight."""

    stage = "sensing"
    record = "tracks of the ball"

    @abstractmethod
    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        """Return the tracked position of the ball in m, launcher frame, at time_s of the tracker's clock since release.

        position_m, velocity_m_s: true state of the ball, time_s after release; differentiable.
        """


class LaunchTerm(Term):
    """A hypothesis about the launch of a ball by the wheels."""

    stage = "launch"

    @abstractmethod
    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        """Return the launch as changed by this term; differentiable in values and launch.

        exit: launch from the wheels' surfaces and the preceding launch terms of the catalogue.
        """


class InFlight(Term):
    """A hypothesis about the flight."""

    stage = "flight"


class FlightTerm(InFlight):
    """A hypothesis about forces during flight."""

    @abstractmethod
    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        """Return its acceleration in m/s2 (lanes broadcast), launcher frame; differentiable in values and state.

        ball: state relative to the air. forces: {term: acceleration} of the preceding active terms of the catalogue.
        """


class AirTerm(InFlight):
    """A hypothesis about the air around the ball, or the spin that remains in it."""

    @abstractmethod
    def meet(self, rig: Rig, values: Values, ball: BallState) -> BallState:
        """Return the ball relative to the air: its velocity through the air and remaining spin; differentiable."""


class ArrivalTerm(Term):
    """A hypothesis about the target."""

    stage = "arrival"
    record = "outcomes"

    @abstractmethod
    def arrive(self, values: Values, opening: Opening) -> Opening:
        """Return the true opening; differentiable."""


KINDS = (SensingTerm, WatchTerm, LaunchTerm, AirTerm, FlightTerm, ArrivalTerm)

# Kinds of terms that change one thing: a subclass adds its declarations and at most one line of physics.


class HoodTerm(SensingTerm):
    """The true elevation is the measured one plus the amplitude, an angle in degrees."""

    direction = "vertical"

    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        angle_deg = values[self.amplitude.name]
        return exit._replace(elevation_rad=exit.elevation_rad + math.radians(1.0) * angle_deg), distance_m


class DistanceTerm(SensingTerm):
    """The true distance differs from the measured one."""

    direction = "along"

    @abstractmethod
    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        """Return the true distance in m; amount: the amplitude."""

    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit, self.distance_m(distance_m, values[self.amplitude.name])


class SpeedTerm(LaunchTerm):
    """The exit speed changes by a share, the amplitude: lost, or gained where `sign` is 1."""

    direction = "along"
    sign: ClassVar[float] = -1.0

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        factor = 1.0 + self.sign * values[self.amplitude.name]
        return exit._replace(speed_m_s=exit.speed_m_s * factor)


class WindTerm(AirTerm):
    """The air moves in its `direction` at the amplitude, a speed in m/s."""

    instrument = Instrument("anemometer", "the wind with an anemometer", 0.2)
    indoor_sd = 0.2                   # a hall's draught

    def meet(self, rig: Rig, values: Values, ball: BallState) -> BallState:
        axis, through = AXES[self.direction], ball.velocity_m_s
        relative = plus(getattr(through, axis), times(-1.0, values[self.amplitude.name]))
        return ball._replace(velocity_m_s=through._replace(**{axis: relative}))


class ForceShareTerm(FlightTerm):
    """The force of the term called `of` grows by a share of itself; no change if that term is not active."""

    of: ClassVar[str]

    def share(self, rig: Rig, values: Values, ball: BallState) -> Number:
        """Return the share by which it grows, by default the amplitude; differentiable in values and state."""
        return values[self.amplitude.name]

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return scale(self.share(rig, values, ball), forces[self.of]) if self.of in forces else Vec(0.0, 0.0, 0.0)


class AirShareTerm(FlightTerm):
    """The forces of the moving air grow by a share of themselves, the amplitude."""

    direction = "along"

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        share = values[self.amplitude.name]
        return total(scale(share, force) for name, force in forces.items() if name not in NOT_OF_AIR)


def wind_speed(meaning: str) -> tuple[Parameter]:
    """Return the parameter of a wind along one axis."""
    return amplitude("speed_m_s", "m/s", -10.0, 10.0, sd=0.8, meaning=meaning,
                     source="halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 m/s",
                     reason="a hall's draught to a light breeze; more would be felt")


def complete(term: Term, values: Values | None) -> dict[str, Any]:
    """Return all parameters of a term, with defaults where `values` has none."""
    return {p.name: (values or {}).get(p.name, p.default) for p in term.parameters}
