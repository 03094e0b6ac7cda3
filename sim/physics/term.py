"""What one hypothesis about the physics is: a name, a stage, parameters, and what it contributes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from robot.facts import Facts
from sim.physics.launch import Exit
from sim.physics.vector import Vec

STAGES = ("sensing", "launch", "flight", "arrival")


@dataclass(frozen=True)
class Prior:
    """What is believed before any shot: normal on one of sim.physics.scales, weak, with its reason in words.

    `centre` is a value of the parameter itself, `sd` is on the scale (on "log": the log of a factor).
    """

    scale: str
    centre: float
    sd: float
    reason: str


@dataclass(frozen=True)
class Parameter:
    """One number of a term, looked for from `low` to `high`.

    `unit` is a product of m, kg, s, rad, rev with powers, such as "1", "1/s" or "kg m/s2".
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


@dataclass(frozen=True)
class FlightTerm(Term):
    """A hypothesis about forces in the air."""

    stage: ClassVar[str] = "flight"

    @abstractmethod
    def acceleration(self, facts: Facts, values: Mapping[str, Any], ball: BallState) -> Vec:
        """Its acceleration in m/s2 (lanes broadcast), launcher frame; differentiable in values and state."""


@dataclass(frozen=True)
class LaunchTerm(Term):
    """A hypothesis about how the wheels send off a ball."""

    stage: ClassVar[str] = "launch"

    @abstractmethod
    def leave(self, facts: Facts, values: Mapping[str, Any], exit: Exit) -> Exit:
        """The launch as this term changes it; differentiable in values and launch.

        exit: as the wheels' surfaces and the launch terms before this one in the catalogue have it.
        """


def complete(term: Term, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """All parameters of a term, defaults where `values` says nothing."""
    return {p.name: (values or {}).get(p.name, p.default) for p in term.parameters}
