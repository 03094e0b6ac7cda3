"""Fit, test and correct any simulator: the answers about a System and its Runs."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from truearc.api.results import FindingReport, Table, Tabular
from truearc.errors import InputError, save_whole
from truearc.hw.real.clock import wall_clock
from truearc.sim.discover import finding as settings
from truearc.sim.discover.identifiability import Sight
from truearc.sim.printed import Progress
from truearc.sim.report import Origin
from truearc.sim.systems import discovery, report
from truearc.sim.systems.discovery import Intervals, SystemFitted, SystemInvestigation
from truearc.sim.systems.score_table import System, SystemModel
from truearc.sim.systems.system import Runs

IN_PYTHON = "made in Python"          # in place of a command line
FIT_COLUMNS = ("parameter", "value", "low90", "high90")
SIGHT_COLUMNS = ("candidate", "unit", "usual", "smallest", "power", "like", "correlation", "why_not")


@dataclass(frozen=True, eq=False)
class SystemFit(Tabular):
    """Most probable parameters of a system, with 90 % intervals. `fitted`: the optimum with its curvature."""

    fitted: SystemFitted

    @property
    def converged(self) -> bool:
        """Whether the search for the most probable parameters converged."""
        return self.fitted.settled

    @cached_property
    def system(self) -> System:
        """The system with the fitted parameters and their uncertainty as its beliefs."""
        system = discovery.system_of(self.fitted)
        assert isinstance(system, System)
        return system

    @cached_property
    def intervals(self) -> Intervals:
        """The parameters and the noise, and errors of forecasts of runs left out."""
        return Intervals.of(self.fitted)

    def table(self) -> Table:
        """Return a row per parameter and noise: value and ends of its 90 % interval."""
        return Table(FIT_COLUMNS, self.intervals.rows)

    def lines(self) -> list[str]:
        """Return the report: parameters, those that the runs cannot separate, forecasts of runs left out."""
        return report.fit_lines(self.intervals)


@dataclass(frozen=True, eq=False)
class SystemFinding(FindingReport):
    """Result of discovery on a system. `investigation`: everything that the report shows."""

    investigation: SystemInvestigation

    @property
    def record(self) -> settings.FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""
        return self.investigation.finding

    def to_html(self, path: str | Path, *, made_at: str | None = None, command: str = IN_PYTHON) -> None:
        """Write the whole report as one HTML file; OSError where it cannot be written.

        made_at, command: date (None: now) and command line for its head.
        """
        origin = Origin(wall_clock() if made_at is None else made_at, command)
        save_whole(path, report.page("Is the simulator complete?", self.investigation, origin).encode())

    def adopt(self) -> System:
        """Return the system with fitted parameters and with the missing part in it, which can be simulated.

        Names that the runs cannot tell apart share the effect as likely as they are; an unexplained one is a curve. A
        part with which runs left out are forecast worse is left out.

        Raises:
            InputError: the runs carry no test, so nothing was fitted.
        """
        system = self.investigation.adopt()
        assert isinstance(system, System)
        return system

    def lines(self) -> list[str]:
        """Return the report: a sentence with the verdict, followed by a few lines."""
        return report.lines(self.investigation)


@dataclass(frozen=True, eq=False)
class SystemIdentifiability(Tabular):
    """Which candidates runs could show. `sight`: all figures."""

    sight: Sight
    model: SystemModel

    def table(self) -> Table:
        """Return a row per candidate, the most easily seen first; None: no number of runs shows it."""
        return Table(SIGHT_COLUMNS, tuple((one.term, one.unit, one.usual, one.smallest, one.power, one.like,
                                           one.correlation, one.why) for one in self.sight.terms))

    def to_json(self) -> str:
        """Return the result as JSON (schema truearc.identifiability/1)."""
        return settings.make_json(self.sight).decode()

    def lines(self) -> list[str]:
        """Return the report: a line per candidate that could be seen, then those that never could."""
        return report.sight_lines(self.sight, self.model)


def runs_of(runs: Runs | None, what: str) -> Runs:
    """Return the runs.

    Raises:
        InputError: there are none.
    """
    if not isinstance(runs, Runs):
        raise InputError(f"{what}: got {type(runs).__name__} for the runs of a System; expected truearc.Runs(...)")
    return runs


def fit_system(system: System, runs: Runs | None, progress: Progress) -> SystemFit:
    """Fit a system to runs."""
    return SystemFit(discovery.fit_system(system, runs_of(runs, "fit"), progress))


def discover_system(system: System, runs: Runs | None, seed: int, false_alarm: float,
                    progress: Progress) -> SystemFinding:
    """Test a system's structure with runs."""
    settings.check_chances(false_alarm, seed)
    return SystemFinding(discovery.investigate(system, runs_of(runs, "discover"), report.sentence, false_alarm, seed,
                                               progress))


def foresee_system(system: System, runs: Runs | None) -> SystemIdentifiability:
    """Compute which candidates runs with these inputs could show."""
    return SystemIdentifiability(*discovery.foresee(system, runs_of(runs, "identifiability")))
