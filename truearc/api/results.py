"""Results that can be read without loading a simulation: tables, saved findings and recordings."""

import csv
import html
import io
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from msgspec import UnsetType

from truearc.robot.config.schema import Config
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import Trial, load_header, load_session_config, load_trials
from truearc.robot.types import Tick
from truearc.sim.discover.finding import FindingRecord, Interval, Named, Story, load_record, make_json
from truearc.sim.printed import Printed, make_text

EFFECT_COLUMNS = ("term", "probability", "value", "low90", "high90", "unit", "stage")


@dataclass(frozen=True)
class Table(Printed):
    """Rows under named columns.

    `columns`: column names, which end with the unit. `rows`: one tuple per row, in the order of the columns; None is a
    missing value.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> list[Any]:
        """Return the values of one column; ValueError for a name that the table does not have."""
        index = self.columns.index(name)
        return [row[index] for row in self.rows]

    def to_dict(self) -> dict[str, list[Any]]:
        """Return {column: values}, which pandas, polars and `truearc.dataset` accept."""
        return {name: self.column(name) for name in self.columns}

    def to_csv(self) -> str:
        """Return the table as CSV text with a header. Floats read back exactly; a missing value is empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([self.columns, *([_cell(cell) for cell in row] for row in self.rows)])
        return out.getvalue()

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame; ModuleNotFoundError if pandas is not installed."""
        import pandas  # an option of the user's own: nothing here needs it
        return pandas.DataFrame(self.to_dict(), columns=list(self.columns))

    def lines(self) -> list[str]:
        """Return the table as aligned text, starting with its header."""
        return make_text(self.columns, [tuple(map(_text, row)) for row in self.rows])

    def _repr_html_(self) -> str:
        from truearc.sim.report import table
        return table(self.columns, self.rows)


def _cell(cell: Any) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell).lower()
    return repr(cell) if isinstance(cell, float) else str(cell)


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


class Tabular(Printed):
    """A result with a table."""

    @abstractmethod
    def table(self) -> Table:
        """Return the result's numbers, row by row."""

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame; ModuleNotFoundError if pandas is not installed."""
        return self.table().to_pandas()

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>{self.table()._repr_html_()}"


@dataclass(frozen=True)
class Effect:
    """Candidate term for an effect that the simulation lacks.

    `probability`: posterior probability of this term. `value`, `sd`, `interval90`: its amplitude, in `unit`. `stage`:
    sensing, launch, flight or arrival. `believed`: amplitude in the tested belief, and `change` since, as an interval
    with its `value` and `sd`; None without one.
    """

    term: str
    probability: float
    value: float
    sd: float
    interval90: tuple[float, float]
    unit: str
    stage: str
    sentence: str
    parameters: dict[str, Interval]
    believed: float | None = None
    change: Interval | None = None


class FindingReport(Tabular):
    """The figures of a finding, and its report."""

    @property
    @abstractmethod
    def record(self) -> FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""

    @property
    def verdict(self) -> str:
        """named (one term), set (several that cannot be told apart), unknown (no term explains it) or none."""
        return self.record.verdict

    @property
    def sentence(self) -> str:
        """The story as one text: what changed, where, what it is worth, how sure; not what to do next."""
        return self.record.sentence

    @property
    def story(self) -> Story:
        """The story in parts: change, where, worth, sure, next; also and limits are tuples of sentences."""
        return self.record.told

    @property
    def change(self) -> str:
        """What changed or is missing, with its size and 90 % interval; or that nothing was found."""
        return self.story.change

    @property
    def next(self) -> str:
        """The one thing to do next; "" if there is none. `record.next` has all steps."""
        return self.story.next

    @property
    def p_value(self) -> float | None:
        """Family-wise p-value of the largest test; None if the data allow no test."""
        return self.record.mismatch.p_value

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Candidate terms, most probable first; empty if nothing was found."""
        return tuple(map(_effect, self.record.what))

    @property
    def best(self) -> Effect | None:
        """The most probable term; None for the verdicts unknown and none."""
        return self._members()[0] if self.verdict in ("named", "set") else None

    @property
    def alternatives(self) -> tuple[Effect, ...]:
        """The other terms that these data cannot distinguish from the best one, most probable first."""
        return self._members()[1:] if self.record.set else ()

    @property
    def also(self) -> tuple[Effect, ...]:
        """The most probable term of each further effect; `record.also` has all their terms, and effects that no term
        explains."""
        return tuple(_effect(one.what[0]) for one in self.record.also if one.set and one.what)

    def _members(self) -> tuple[Effect, ...]:
        """The effects that the verdict names, most probable first; one left out of a set may be more probable."""
        names = self.record.set
        return tuple(one for one in self.effects if names is None or one.term in names)

    def table(self) -> Table:
        """Return a row per candidate term: probability, amplitude with its 90 % interval in `unit`, stage."""
        return Table(EFFECT_COLUMNS, tuple((one.term, one.probability, one.value, *one.interval90, one.unit, one.stage)
                                    for one in self.effects))

    def to_json(self) -> str:
        """Return the finding as JSON (schema truearc.finding/1), as `truearc discover --json` writes it."""
        return make_json(self.record).decode()

    def _repr_html_(self) -> str:
        from truearc.sim.report import render  # loads Matplotlib
        table = self.table()._repr_html_() if self.effects else ""
        return render("cell.html", told=self.story, table=table, lines="\n".join(self.lines()))


@dataclass(frozen=True)
class SavedFinding(FindingReport):
    """A finding read from its file: its figures and its report. The file contains neither the shots nor the fit.

    Third-party terms are printed by name.
    """

    saved: FindingRecord

    @property
    def record(self) -> FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""
        return self.saved

    def lines(self) -> list[str]:
        """Return the report, as for a new finding."""
        from truearc.sim.discover.report.story import console_lines  # loads SciPy and JAX; reading needs neither
        return console_lines(self.saved)


def load_finding(path: str | Path) -> SavedFinding:
    """Read the JSON file of a finding from this or an earlier version; it prints like the original.

    Raises:
        InputError: `path` cannot be read or is not a truearc.finding/1; names the key.
    """
    return SavedFinding(load_record(path))


def _effect(one: Named) -> Effect:
    size = next(iter(one.parameters.values()))
    return Effect(one.term, one.probability, size.value, size.sd, (size.low90, size.high90), size.unit, one.stage,
                  one.sentence, one.parameters, one.believed,
                  None if isinstance(one.change, UnsetType) else one.change)


class Recording(Printed):
    """A recorded session, an iterable of its ticks.

        for tick in Recording("sessions/mon"):
            tick.verdict.fire, tick.verdict.reasons

    A tick holds inputs, estimate, aim, verdict and command in SI units; `t_ns` is the robot's own clock in ns. After an
    iteration, `cut_short` states where a truncated recording ends; None if it is complete.

    Raises:
        InputError: the folder is not a recording, or (while iterating) a row cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.header = load_header(self.path)
        self.cut_short: str | None = None

    def __iter__(self) -> Iterator[Tick]:
        reader = TickReader(self.path)
        for tick, _ in reader:
            yield tick
        self.cut_short = reader.cut_short

    @cached_property
    def config(self) -> Config:
        """The configuration of the session; its `rig` is the rig."""
        return load_session_config(self.path)

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Every marked trial in order, with its outcome and its shot; the shot is None if a gate held."""
        return tuple(load_trials(self.path))

    def lines(self) -> list[str]:
        """Return the origin of the recording, and the number of trials with each outcome."""
        outcomes = [trial.outcome.outcome for trial in self.trials]
        counts = ", ".join(f"{outcomes.count(kind)} {kind}" for kind in dict.fromkeys(outcomes))
        return [f"{self.path}: {len(outcomes)} trials ({counts or 'none'})",
                f"truearc {self.header.truearc}, gate policy {self.header.policy}, started "
                f"{self.header.started or 'on an emulated clock'}"]
