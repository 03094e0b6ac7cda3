"""What one hypothesis about the physics is: a name, a stage, parameters, and what it contributes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from robot.facts import Facts
from sim.physics.vector import Vec

STAGES = ("sensing", "launch", "flight", "arrival")


@dataclass(frozen=True)
class Parameter:
    """One number of a term; the prior is uniform from `low` to `high`.

    `unit` is a product of m, kg, s, rad, rev with powers, such as "1", "1/s" or "kg m/s2".
    `default` is the value that a coefficients file that does not mention it means.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    source: str


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


def complete(term: Term, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """All parameters of a term, defaults where `values` says nothing."""
    return {p.name: (values or {}).get(p.name, p.default) for p in term.parameters}
