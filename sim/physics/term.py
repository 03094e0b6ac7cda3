"""What one hypothesis about the physics is: a name, a stage, parameters, and what it contributes.

Along the way of a shot: what the sensors say -> SensingTerm -> what is true -> LaunchTerm -> the ball as it leaves ->
AirTerm, FlightTerm -> its flight -> ArrivalTerm -> the outcome; a WatchTerm is about a tracker that sees the flight.
Values handed to hooks are effective: parameters as Term.at_shot leaves them, numbers or one a lane.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.vector import Vec

STAGES = ("sensing", "launch", "flight", "arrival")


@dataclass(frozen=True)
class Prior:
    """What is believed before any shot: normal on one of truearc.sim.physics.scales, weak, with its reason in words.

    `centre` is a value of the parameter itself, `sd` is on the scale (on "log": the log of a factor).
    """

    scale: str
    centre: float
    sd: float
    reason: str


@dataclass(frozen=True)
class Parameter:
    """One number of a term, looked for from `low` to `high`.

    `unit` is a product of m, kg, s, rad, rev, deg with powers, such as "1", "1/s" or "kg m/s2"; a share is "1".
    `default` is the value that a coefficients file that does not mention it means.
    `prior` is what a likelihood fit believes beforehand; None: known, and not fitted.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    source: str
    prior: Prior | None = None


class BallState(NamedTuple):
    """The ball in flight, launcher frame (x toward the target, y left, z up; origin on the floor below the exit)."""

    position_m: Vec
    velocity_m_s: Vec
    spin_rev_s: Vec                   # right-handed; backspin is about -y
    time_s: Any = 0.0                 # since release


class Opening(NamedTuple):
    """What a ball has to pass at the target plane; heights in m, as in rig.toml [target]."""

    centre_m: Any
    three_half_m: Any
    two_half_m: Any


@dataclass(frozen=True)
class Term(ABC):
    """A hypothesis. `parameters[0]` is its amplitude: at zero the term is absent, whatever the others say.

    `symmetry`: "any" = turns with the ball's state about every axis; "vertical" = about z only; "none".
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    symmetry: ClassVar[str]
    sentence: ClassVar[str]           # how a report says that this is at work
    follows: ClassVar[str | None] = None    # the field of Circumstances that the amplitude is multiplied by
    relative: ClassVar[bool] = False  # asked about only where an earlier session told what it changes

    def at_shot(self, values: Mapping[str, Any], circumstances: Circumstances) -> dict[str, Any]:
        """Values under the circumstances of shots: the amplitude times what it follows. Shapes broadcast."""
        if self.follows is None:
            return dict(values)
        amplitude = self.parameters[0].name
        return {**values, amplitude: values[amplitude] * getattr(circumstances, self.follows)}


@dataclass(frozen=True)
class SensingTerm(Term):
    """A hypothesis about what the robot's sensors make of a configuration."""

    stage: ClassVar[str] = "sensing"

    @abstractmethod
    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        """(launch by the wheels, distance in m) as they are in truth; differentiable.

        exit, distance_m: as the sensors, and the sensing terms before this one in the catalogue, have them.
        """


@dataclass(frozen=True)
class WatchTerm(Term):
    """A hypothesis about a tracker that watches the flight."""

    stage: ClassVar[str] = "sensing"

    @abstractmethod
    def watch(self, values: Mapping[str, Any], position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        """Where the tracker says the ball is at time_s of its own clock since release, in m, launcher frame.

        position_m, velocity_m_s: the ball in truth, time_s after release; differentiable.
        """


@dataclass(frozen=True)
class LaunchTerm(Term):
    """A hypothesis about how the wheels send off a ball."""

    stage: ClassVar[str] = "launch"

    @abstractmethod
    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        """The launch as this term changes it; differentiable in values and launch.

        exit: as the wheels' surfaces and the launch terms before this one in the catalogue have it.
        """


@dataclass(frozen=True)
class FlightTerm(Term):
    """A hypothesis about forces in the air."""

    stage: ClassVar[str] = "flight"

    @abstractmethod
    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        """Its acceleration in m/s2 (lanes broadcast), launcher frame; differentiable in values and state.

        ball: as the air sees it. forces: {term: acceleration} of the terms at work before it in the catalogue.
        """


@dataclass(frozen=True)
class AirTerm(Term):
    """A hypothesis about what air the ball meets, or what is left of its spin when it does."""

    stage: ClassVar[str] = "flight"

    @abstractmethod
    def meet(self, facts: Rig, values: Mapping[str, Any], ball: BallState) -> BallState:
        """The ball as the air sees it: its velocity through the air, the spin that it has left; differentiable."""


InFlight = FlightTerm | AirTerm


@dataclass(frozen=True)
class ArrivalTerm(Term):
    """A hypothesis about the target."""

    stage: ClassVar[str] = "arrival"

    @abstractmethod
    def arrive(self, values: Mapping[str, Any], opening: Opening) -> Opening:
        """The opening as it is in truth; differentiable."""


def complete(term: Term, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """All parameters of a term, defaults where `values` says nothing."""
    return {p.name: (values or {}).get(p.name, p.default) for p in term.parameters}
