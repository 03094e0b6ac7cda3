"""The interface between a fit and a simulation. Any system that implements it can be fitted and tested.

A column is a number that is either fitted ("shared") or only tested, such as a term's amplitude; p of the P columns are
shared. A point is the linearization point of a simulation; it belongs to the model and is opaque to other code.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, Self, TypeVar, runtime_checkable

from truearc.sim.infer.likelihood.score_table import Centre, Change, Column, Precision, ScoreTable, Which


@runtime_checkable
class Columns(Protocol):
    """Columns of a model, the shared ones last, and the normal prior of these: centre [p], precision [p, p].

    changes: shared numbers, by name, that were believed and may have changed since, with the standard deviation of the
    change, which the precision includes.
    """

    @property
    def columns(self) -> tuple[Column, ...]: ...
    @property
    def first_shared(self) -> int: ...
    @property
    def centre(self) -> Centre: ...
    @property
    def precision(self) -> Precision: ...
    @property
    def changes(self) -> Mapping[str, float]: ...


@runtime_checkable
class Shape(Protocol):
    """A number of a term that is fitted besides the term's amplitude, but is not a column."""

    def put(self, point: Any, place: float) -> Any:
        """Return the point with the number `place` standard deviations from its prior's centre, within its range."""


@runtime_checkable
class Model(Protocol):
    """A simulation with its data."""

    @property
    def layout(self) -> Columns:
        """The columns that are fitted and tested."""
    @property
    def sampled(self) -> bool:
        """Whether shots are series of samples, whose own unknowns must settle during the fit."""
    @property
    def has_one_top(self) -> bool:
        """Whether the likelihood has a single optimum, apart from those where a fit is lost."""

    def fly(self, point: Any) -> Any:
        """Return the prediction at a point and its slopes, from which `linearise` starts for nearby points."""
    def linearise(self, point: Any, flown: Any = None) -> tuple[ScoreTable, Any]:
        """Return the scores at a point, and the point with each shot's own unknowns at their most likely values."""
    def forecast(self, point: Any) -> ScoreTable:
        """Return the scores as if only a shot's result had been measured: from its settings alone."""
    def about(self, point: Any) -> Any:
        """Return a point that has been moved with the shots' own unknowns put right where slopes depend on them."""
    def moved(self, point: Any, change: Change) -> Any:
        """Return a point after its columns change by `change` [P], none of them beyond its limit."""
    def leads_out(self, point: Any, step: Change) -> Which:
        """Return the columns [P] at a limit that the step [P] would lead beyond."""
    def is_lost(self, point: Any) -> bool:
        """Return whether a fit that stopped there explains nothing: its slopes carry little information."""
    def starts(self) -> Sequence[Any]:
        """Return the points to climb from, the likeliest first."""
    def easier(self) -> Iterable[Self]:
        """Return easier models to climb first, one after another."""
    def afar(self, change: Change) -> tuple[Any, Iterable[Self]]:
        """Return the start of a climb after a lost fit, with or without `change`, and the models to climb first."""
    def shapes(self, names: tuple[str, ...]) -> Sequence[Shape]:
        """Return the shapes of the terms of these columns."""
    def shared_only(self, names: Iterable[str] = ()) -> Self:
        """Return the model of the shared columns alone, the named ones among them, first."""
    def sharing(self, names: tuple[str, ...]) -> Self:
        """Return the model with these columns among the shared ones, all others tested as before."""


@runtime_checkable
class Tested(Model, Protocol):
    """A model whose tested columns can be named: what discovery asks of it beside the fit."""

    def range_of(self, name: str) -> tuple[float, float]:
        """Return the ends of an amplitude's range; for a believed number, those of the number."""
    def law_of(self, name: str) -> tuple[float | None, float]:
        """Return (standard deviation of the amplitude about 1 if a law of physics gives its size, else None;
        probability that it is above 0)."""
    def is_natural(self, name: str, amplitude: float) -> bool:
        """Return whether the amplitude is within 99.9 % of its prior if that is log-normal; else True."""
    def label_of(self, name: str) -> str:
        """Return the name in running text."""
    def describe(self, name: str) -> tuple[str, str] | None:
        """Return (meaning, unit) of a column; None if it has no meaning of its own."""
    def stopped(self, scores: ScoreTable) -> dict[str, float]:
        """Return fitted numbers that stopped at the end of their range, by name."""
    def strange(self, scores: ScoreTable, beside: Iterable[str], trackers: bool) -> dict[str, float]:
        """Return the fitted numbers far outside their prior, by name, except those `beside`."""
    def exchanged(self, name: str, best: Any, point: Any, start: Any) -> Any:
        """Return the point of a fit with another name in `best`, without that name's effect, which is as at `start`."""
    def carrying(self, point: Any, lost: bool, part: "Shapes") -> "Carrying[Self] | None":
        """Return the model with an unexplained change among the shared columns; None if it cannot represent one."""


@runtime_checkable
class Shapes(Protocol):
    """An unexplained change: numbers times shapes over the shots [n, q], each with a standard deviation [q]."""

    @property
    def columns(self) -> Any: ...
    @property
    def shapes(self) -> Any: ...
    @property
    def sd(self) -> Any: ...


AnyModel = TypeVar("AnyModel", bound=Model)


@dataclass(frozen=True)
class Carrying(Generic[AnyModel]):
    """A model of the shared columns that carries an unexplained change, and the points to climb from."""

    model: AnyModel
    starts: Sequence[Any]
