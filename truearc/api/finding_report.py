"""Figures and report of a finding: of one just made, and of one read from a file."""

import html
from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path

from truearc.api.table import Table
from truearc.sim.discover.finding import FindingRecord, Interval, Named, load_record, make_json
from truearc.sim.printed import Printed

COLUMNS = ("term", "probability", "value", "low90", "high90", "unit", "stage")


@dataclass(frozen=True)
class Effect:
    """One candidate term for what the simulation lacks.

    `probability`: that this term is it. `value`, `sd`, `interval90`: its amplitude, in `unit`. `stage`: sensing,
    launch, flight or arrival. `believed`: what the amplitude was thought to be, where a belief was tested; else None.
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


class FindingReport(Printed):
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
        """The verdict for a reader: what is missing, how large, and what it is worth on hold-out shots."""
        return self.record.sentence

    @property
    def p_value(self) -> float | None:
        """Of the largest of all tests, adjusted for their number; None where the data carry no test."""
        return self.record.mismatch.p_value

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Candidate terms, most probable first; empty where nothing was found."""
        return tuple(map(_effect, self.record.what))

    @property
    def best(self) -> Effect | None:
        """The most probable term; None for the verdicts unknown and none."""
        return self._members()[0] if self.verdict in ("named", "set") else None

    @property
    def alternatives(self) -> tuple[Effect, ...]:
        """The other terms that these data cannot tell from the best one, most probable first."""
        return self._members()[1:] if self.record.set else ()

    @property
    def also(self) -> tuple[Effect, ...]:
        """The most probable term of each further effect that was found beside the best one; `record.also` has all, and
        those that no term explains."""
        return tuple(_effect(one.what[0]) for one in self.record.also if one.set and one.what)

    def _members(self) -> tuple[Effect, ...]:
        """The effects that the verdict names, most probable first; one left out of a set may be more probable."""
        names = self.record.set
        return tuple(one for one in self.effects if names is None or one.term in names)

    def table(self) -> Table:
        """Return a row per candidate term: probability, amplitude with its 90 % interval in `unit`, stage."""
        return Table(COLUMNS, tuple((one.term, one.probability, one.value, *one.interval90, one.unit, one.stage)
                                    for one in self.effects))

    def to_json(self) -> str:
        """Return the answer as JSON (schema truearc.finding/1), as `truearc discover --json` writes it."""
        return make_json(self.record).decode()

    def _repr_html_(self) -> str:
        head, *rest = map(html.escape, self.lines())
        return (f"<p><b>{self.verdict}</b>: {head}</p>{self.table()._repr_html_() if self.effects else ''}"
                f"<pre>{chr(10).join(rest)}</pre>")


@dataclass(frozen=True)
class SavedFinding(FindingReport):
    """A finding as read from its file: its figures and its report. The shots are not in the file, nor what was fitted.

    Terms of third parties print under their names.
    """

    saved: FindingRecord

    @property
    def record(self) -> FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""
        return self.saved

    def lines(self) -> list[str]:
        """Return the report, as of a finding just made."""
        from truearc.sim.discover.report.finding_text import console_lines  # loads SciPy and JAX; reading needs neither
        return console_lines(self.saved)


def load_finding(path: str | Path) -> SavedFinding:
    """Read the JSON file of a finding that this version or an earlier one wrote; it prints as the finding did.

    Raises:
        InputError: `path` cannot be read, or is not a truearc.finding/1; with the key.
    """
    return SavedFinding(load_record(path))


def _effect(one: Named) -> Effect:
    size = next(iter(one.parameters.values()))
    return Effect(one.term, one.probability, size.value, size.sd, (size.low90, size.high90), size.unit, one.stage,
                  one.sentence, one.parameters, one.believed)
