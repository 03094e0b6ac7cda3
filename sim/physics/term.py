"""One hypothesis about the physics: its name, place, numbers, wording, instrument, and what it contributes.

Along the way of a shot: what the sensors say -> SensingTerm -> what is true -> LaunchTerm -> the ball as it leaves ->
AirTerm, FlightTerm -> its flight -> ArrivalTerm -> the outcome; a WatchTerm is about a tracker that sees the flight.
Values handed to hooks are effective: parameters as Term.at_shot leaves them, numbers or one per lane.

A term is complete by itself: no other module keeps a table by the names of terms. truearc.sim.physics.term_check checks
that nothing is missing when a term enters a catalogue.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.conditions import RECORDED, Circumstances
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term_fields import (
    ANGLE,
    LENGTH,
    NUMBER,
    SECONDS,
    SHARE,
    SPEED,
    Instrument,
    Parameter,
    Phrase,
    Prior,
    amplitude,
    either_way,
)
from truearc.sim.physics.vector import Vec, plus, scale, times, total

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
    """The opening that a ball has to pass at the target plane; heights in m, as in rig.toml [target]."""

    centre_m: Any
    three_half_m: Any
    two_half_m: Any


class Term(ABC):
    """A hypothesis. `parameters[0]` is its amplitude: at zero the term is absent, whatever the others say.

    Instances carry no state: all that a subclass declares is class data, and two instances of one class are equal.

    Attributes:
        name: Of the class in snake_case, unless the class gives another.
        stage: One of STAGES; the base class of the kind gives it.
        order: When it acts among the terms of its stage: by this number, ascending, and why there.
        parameters: The amplitude first.
        direction: Along, up across, or left of the flight: where a positive amplitude moves a typical shot.
        sentence: How a report says that this is at work.
        phrase: The same with its size.
        topspin_phrase: The same of balls with topspin, where that turns its direction round.
        instrument: What settles it without a shot; None where it is `always` at work.
        label: Its name in running text; by itself the name with spaces.
        follows: The field of Circumstances that the amplitude is multiplied by.
        record: What has to be recorded of shots so that they can show it; "" where every dataset will do. By itself
            what the circumstance needs that it follows.
        relative: Tested only where an earlier session reported what it changes.
        always: At work in every simulation, its parameters known.
        unseen: Why no number of shots counts as showing it; "" where enough of them do.
        positive: Probability, before any shot, that the amplitude is above 0, where nature prefers a side.
        law_sd: Of a law of physics, whose amplitude is 1 wherever the simulation lacks it: one standard deviation of
            how far it may be off; None: any size is possible.
        indoor_sd: One standard deviation of the amplitude in a closed hall, where that makes a difference.
        calibration_sd: Of a tracker's calibration that is fitted with every track: one standard deviation of the
            amplitude's prior there; None: the amplitude is tested like any other.
        compared: Of a tracker's calibration that is tested, and compared with an earlier session's like what is fitted.
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
        """The first parameter, by which the term is found."""
        return self.parameters[0]

    def at_shot(self, values: Values, circumstances: Circumstances) -> Values:
        """Values under the circumstances of shots: the amplitude times what it follows. Shapes broadcast."""
        if self.follows is None:
            return values
        amplitude = self.amplitude.name
        return {**values, amplitude: values[amplitude] * getattr(circumstances, self.follows)}


class SensingTerm(Term):
    """A hypothesis about what the robot's sensors make of a configuration."""

    stage = "sensing"

    @abstractmethod
    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        """(launch by the wheels, distance in m) as they are in truth; differentiable.

        exit, distance_m: as the sensors, and the sensing terms before this one in the catalogue, have them.
        """


class WatchTerm(Term):
    """A hypothesis about a tracker that watches the flight."""

    stage = "sensing"
    record = "tracks of the ball"

    @abstractmethod
    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        """Where the tracker says the ball is at time_s of its own clock since release, in m, launcher frame.

        position_m, velocity_m_s: the ball in truth, time_s after release; differentiable.
        """


class LaunchTerm(Term):
    """A hypothesis about how the wheels send off a ball."""

    stage = "launch"

    @abstractmethod
    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        """The launch as this term changes it; differentiable in values and launch.

        exit: as the wheels' surfaces and the launch terms before this one in the catalogue have it.
        """


class InFlight(Term):
    """A hypothesis about the flight."""

    stage = "flight"


class FlightTerm(InFlight):
    """A hypothesis about forces in the air."""

    @abstractmethod
    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        """Its acceleration in m/s2 (lanes broadcast), launcher frame; differentiable in values and state.

        ball: as the air sees it. forces: {term: acceleration} of the terms at work before it in the catalogue.
        """


class AirTerm(InFlight):
    """A hypothesis about what air the ball meets, or what is left of its spin when it does."""

    @abstractmethod
    def meet(self, rig: Rig, values: Values, ball: BallState) -> BallState:
        """The ball as the air sees it: its velocity through the air, the spin that it has left; differentiable."""


class ArrivalTerm(Term):
    """A hypothesis about the target."""

    stage = "arrival"
    record = "outcomes"

    @abstractmethod
    def arrive(self, values: Values, opening: Opening) -> Opening:
        """The opening as it is in truth; differentiable."""


KINDS = (SensingTerm, WatchTerm, LaunchTerm, AirTerm, FlightTerm, ArrivalTerm)

# Kinds of terms that change one thing: a subclass adds its declarations and at most one line of physics.


class HoodTerm(SensingTerm):
    """The true elevation is the measured one plus the amplitude, an angle in degrees."""

    direction = "vertical"

    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        angle_deg = values[self.amplitude.name]
        return exit._replace(elevation_rad=exit.elevation_rad + math.radians(1.0) * angle_deg), distance_m


class DistanceTerm(SensingTerm):
    """The true distance is another than the measured one."""

    direction = "along"

    @abstractmethod
    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        """The true distance in m; amount: the amplitude."""

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
    """The force of the term called `of` grows by a share of itself; without that term at work there is no change."""

    of: ClassVar[str]

    def share(self, rig: Rig, values: Values, ball: BallState) -> Number:
        """The share by which it grows, the amplitude by itself; differentiable in values and state."""
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
    """The parameter of a wind along one axis."""
    return amplitude("speed_m_s", "m/s", -10.0, 10.0, sd=0.8, meaning=meaning,
                     source="halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 m/s",
                     reason="a hall's draught to a light breeze; more would be felt")


def complete(term: Term, values: Values | None) -> dict[str, Any]:
    """All parameters of a term, defaults where `values` has none."""
    return {p.name: (values or {}).get(p.name, p.default) for p in term.parameters}
