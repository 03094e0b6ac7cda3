"""Find the physics that the simulation lacks, predict what shots could show, and plan the next shots."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, overload

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec import json, structs

from truearc.api.arguments import check_kind, names_of
from truearc.api.results import FindingReport, Table, Tabular
from truearc.api.systems import SystemFinding, SystemIdentifiability, discover_system, foresee_system
from truearc.errors import InputError, about, save_whole
from truearc.hw.real.clock import wall_clock
from truearc.robot.config.rig_spec import Rig
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import hash_dataset
from truearc.sim.discover import finding as settings
from truearc.sim.discover import investigate as engine
from truearc.sim.discover.identifiability import Sight, foresee, foresee_dataset, is_planned
from truearc.sim.discover.investigate import Investigation, make_belief, with_worth
from truearc.sim.discover.next_steps import can_design, make_design
from truearc.sim.discover.report import pages
from truearc.sim.discover.report.story import console_lines
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.layout import Measurement, check_believed, column_of
from truearc.sim.infer.track_forecast import known_of
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.physics.term import Term
from truearc.sim.printed import Progress, show_progress
from truearc.sim.report import Origin
from truearc.sim.systems.score_table import System
from truearc.sim.systems.system import Runs

IN_PYTHON = "made in Python"          # in place of a command line
TERM_COLUMNS = ("term", "stage", "unit", "usual", "smallest", "power", "shots_needed", "share_left", "like",
                "correlation", "why_not")
UNPROVEN = ("Trials with telemetry have not shown that shots planned so tell names apart better than shots at random: "
            "a measurement is surer.")
SHOT_COLUMNS = ("shots", "like", "distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg", "pace")


@dataclass(frozen=True, eq=False)
class Finding(FindingReport):
    """Result of discovery on a dataset.

    `name`: name of the dataset. `investigation`: everything that the report shows. It can be pickled.
    """

    name: str
    investigation: Investigation

    @property
    def record(self) -> settings.FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""
        return self.investigation.finding

    def to_html(self, path: str | Path, *, made_at: str | None = None, command: str = IN_PYTHON,
                truth: Mapping[str, float] | None = None) -> None:
        """Write the whole report as one HTML file; OSError where it cannot be written.

        made_at, command: date (None: now) and command line for its head, beside the version and the hash of the data.
        truth: true amplitudes by term, where they are known, to show beside those found.
        """
        origin = Origin(wall_clock() if made_at is None else made_at, command)
        save_whole(path, pages.make_report(self.name, self.investigation, origin, truth).encode())

    def plot_residuals(self) -> Figure:
        """Plot residuals against the covariate of the first effect, before and after including the effect.

        Raises:
            InputError: the data allow no test, or no recorded covariate varies.
        """
        figure = pages.plot_residuals(self.investigation)
        if figure is None:
            raise InputError(f"{self.name}: there are no residuals to plot")
        return figure

    def adopt(self) -> Belief:
        """Return a belief that includes the finding: fitted coefficients, named effects, their covariance.

        Terms that cannot be distinguished are averaged. An effect that makes forecasts of hold-out shots worse is not
        adopted; the `provenance` of the belief states what was adopted and why.

        Raises:
            InputError: the data allow no test, so nothing was fitted; or, without an earlier belief, a coefficient or a
                tracker error is at the end of its range, or tracks and outcomes contradict each other.
        """
        with about(self.name, ValueError):
            belief, provenance = make_belief(self.investigation, self.investigation.choice)
        if "at_limit" in provenance and self.investigation.belief is None:
            why, stopped = provenance.get("refused", ""), ", ".join(provenance["at_limit"])
            raise InputError(f"{self.name}: nothing is adopted: {stopped} stopped at the end of its range"
                             + (f"; {why}" if why and stopped not in why else "")
                             + "; believe other terms, or look for an error in the data")
        if "unfit" in provenance and self.investigation.belief is None:
            raise InputError(f"{self.name}: nothing is adopted: {provenance['unfit']}")
        accepted = {"accepted": list(self.record.data.accepted)} if self.record.data.accepted else {}
        dataset = self.investigation.dataset
        assert dataset is not None
        return replace(belief, provenance={"dataset": self.name, **accepted, **provenance, **known_of(dataset, belief)})

    def lines(self) -> list[str]:
        """Return the report: a sentence with the verdict, followed by a few lines."""
        return console_lines(self.record, self.investigation.catalogue)


@overload
def discover(dataset: Dataset, *, belief: Belief | None = ..., believe: Iterable[str | Term] | None = ...,
             terms: Iterable[Term] | None = ..., since: Dataset | None = ...,
             measured: Mapping[str, tuple[float, float]] | None = ..., seed: int = ..., false_alarm: float = ...,
             accept: Collection[str] = ..., progress: Progress | None = ...) -> Finding: ...


@overload
def discover(dataset: System, runs: Runs, *, seed: int = ..., false_alarm: float = ...,
             progress: Progress | None = ...) -> SystemFinding: ...


def discover(dataset: Dataset | System, runs: Runs | None = None, *, belief: Belief | None = None,
             believe: Iterable[str | Term] | None = None, terms: Iterable[Term] | None = None,
             since: Dataset | None = None, measured: Mapping[str, tuple[float, float]] | None = None, seed: int = 0,
             false_alarm: float = settings.FALSE_ALARM, accept: Collection[str] = (),
             progress: Progress | None = None) -> Finding | SystemFinding:
    """Test whether a dataset disagrees with the simulation, locate the mismatch, and rank the terms that explain it.

    Args:
        dataset: Shots with outcomes, heights or tracks; or a System.
        runs: Of a System its recordings; only seed, false_alarm and progress apply with them.
        belief: Coefficients of the same rig from an earlier session. Its terms, with their uncertainty, are the
            baseline model and are also tested for changes.
        believe: Instead of a belief, the terms of the baseline model, whose coefficients are fitted; None: [believe] of
            the rig. Gravity is always included.
        terms: Candidate terms, such as [*catalogue(), HoodFlex()]; None: those of the belief, or of the catalogue.
        since: The dataset that `belief` was adopted from. Misfit that is also present there is not evidence of change.
        measured: {term: (value, standard deviation)} of amplitudes measured without shots, in the term's unit.
        seed: Seed of all random draws; the same data and seed give the same finding.
        false_alarm: Probability of a finding if nothing is missing, 0.002 to 1.
        accept: Names of plausibility checks (truearc.sim.check) whose objections are accepted; recorded.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Code is compiled in each process; set JAX_COMPILATION_CACHE_DIR to keep it on disk.

    Raises:
        InputError: implausible data, an unknown term, contradicting arguments, too few shots, or outcomes without a
            target.
    """
    settings.check_chances(false_alarm, seed)
    if isinstance(dataset, System):
        return discover_system(dataset, runs, seed, false_alarm, progress or show_progress("discover"))
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    if runs is not None:
        raise InputError("runs: go with a System, not with a dataset of shots")
    among = belief.catalogue if terms is None and belief is not None else as_catalogue(terms)
    if belief is not None and believe is not None:
        raise InputError("belief and believe exclude each other: the belief has its own terms")
    if since is not None:
        _check_since(since, belief, dataset)
    names = names_of(believe, "believe", among)
    check_believed(names or (), among)
    dataset = check_plausible(dataset, accept)
    if belief is not None and (other := belief.other_rig(dataset.rig)):
        dataset = replace(dataset, accepted=(*dataset.accepted, f"the belief was {other}"))
    since = None if since is None else check_plausible(since, accept)
    found = engine.discover(dataset, names, false_alarm, seed, progress or show_progress("discover"), belief, since,
                            _measured(measured or {}, among), among)
    hashed = structs.replace(found.finding.data, sha256=hash_dataset(dataset))
    found = replace(found, finding=structs.replace(found.finding, data=hashed))
    return Finding(dataset.name, with_worth(found))


def _check_since(since: Dataset, belief: Belief | None, later: Dataset) -> None:
    """InputError unless `since` goes with a belief and was recorded with the same ball and launcher as `later`."""
    if belief is None:
        raise InputError("since goes with belief, which was adopted from that dataset")
    def said(value: object) -> str:
        return "not stated" if value is None else json.encode(value).decode().replace('"', "")

    parts = [(f"{part}.{name}", value, getattr(getattr(later.rig, part), name)) for part in ("ball", "launcher")
             for name, value in structs.asdict(getattr(since.rig, part)).items()]
    differ = [f"rig.toml: {key}: {said(value)} there, {said(other)} in {later.name}" for key, value, other in parts
              if value != other]
    if differ:
        raise InputError(f"since: {since.name}: was recorded with another rig: {'; '.join(differ)}; correct the "
                         "rig.toml that is wrong, or begin again from the later dataset, without since")


def _measured(measured: Mapping[str, tuple[float, float]], among: Catalogue) -> dict[str, Measurement]:
    for term, (value, sd) in measured.items():
        if not np.isfinite([value, sd]).all() or sd <= 0.0:
            raise InputError(f"measured: {term}: a finite value and a standard deviation above 0 are needed")
    return {column_of(term, among): Measurement(float(value), float(sd)) for term, (value, sd) in measured.items()}


@dataclass(frozen=True)
class Identifiability(Tabular):
    """Detectability of each term with shots of a kind. `name`: of the rig or dataset; `sight`: all figures; `sha256`:
    hash of the dataset's or rig's content."""

    name: str
    sight: Sight
    catalogue: Catalogue
    sha256: str = ""

    def table(self) -> Table:
        """Return a row per term, the most easily detected first.

        usual, smallest: usual and smallest detectable amplitude, in `unit`. power: probability of detecting the usual
        size. shots_needed: shots for power 0.8; None: no number is enough, for the reason in `why_not`. share_left:
        share of its information that the fitted numbers leave. like, correlation: the most similar other term.
        """
        return Table(TERM_COLUMNS, tuple(
            (one.term, one.stage, one.unit, one.usual, one.smallest, one.power, one.shots_needed, one.share_left,
             one.like, one.correlation, one.why) for one in self.sight.terms))

    def to_json(self) -> str:
        """Return the result as JSON (schema truearc.identifiability/1)."""
        return settings.make_json(self.sight).decode()

    def to_html(self, path: str | Path, *, made_at: str | None = None, command: str = IN_PYTHON) -> None:
        """Write the report as one HTML file; OSError where it cannot be written.

        made_at, command: date (None: now) and command line for its head, beside the version and the hash of the data.
        """
        origin = Origin(wall_clock() if made_at is None else made_at, command, self.sha256)
        save_whole(path, pages.make_sight_page(self.name, self.sight, self.catalogue, origin).encode())

    def lines(self) -> list[str]:
        """Return the report: the number of detectable terms, and a line per term."""
        return pages.sight_lines(self.sight, self.catalogue)


@overload
def identifiability(rig_or_dataset: Rig | Dataset, *, level: str | None = ..., shots: int | None = ...,
                    believe: Iterable[str | Term] | None = ..., terms: Iterable[Term] | None = ...,
                    sides: bool = ..., seed: int | None = ..., name: str | None = ..., accept: Collection[str] = ...,
                    progress: Progress | None = ...) -> Identifiability: ...


@overload
def identifiability(rig_or_dataset: System, runs: Runs) -> SystemIdentifiability: ...


def identifiability(rig_or_dataset: Rig | Dataset | System, runs: Runs | None = None, *, level: str | None = None,
                    shots: int | None = None, believe: Iterable[str | Term] | None = None,
                    terms: Iterable[Term] | None = None, sides: bool = False, seed: int | None = None,
                    name: str | None = None, accept: Collection[str] = (),
                    progress: Progress | None = None) -> Identifiability | SystemIdentifiability:
    """Compute which terms shots could reveal, before any result is known.

    Args:
        rig_or_dataset: A rig, for which a season of shots is planned, or a dataset with or without results; or a
            System.
        runs: Of a System, its inputs and conditions, with or without outputs; no other argument applies with them.
        level: Rig only: recorded data, "L0" outcomes (the default), "L1" also telemetry, "L2" also tracks.
        shots: Rig only: number of shots in the season; None: 300.
        believe: Terms of the baseline model, whose coefficients are fitted; None: [believe] of the rig.
        terms: Candidate terms; None: the catalogue.
        sides: Whether every miss is recorded as high or low.
        seed: Seed of the planned season, or of the heights of shots without results; None: 0.
        name: Name in the report; None: the dataset's name, or "rig".
        accept: Names of plausibility checks whose objections are accepted.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Raises:
        InputError: an implausible rig or dataset, an unknown level or term, too few shots, a target that is missing or
            out of reach, level or shots given with a dataset, or sides or seed given with a dataset that has results.
    """
    if isinstance(rig_or_dataset, System):
        return foresee_system(rig_or_dataset, runs)
    progress = progress or show_progress("identifiability")
    check_kind("rig_or_dataset", rig_or_dataset, (Rig, Dataset), "load_rig(...) or truearc.load_dataset(...)")
    rig = rig_or_dataset.rig if isinstance(rig_or_dataset, Dataset) else rig_or_dataset
    data = rig_or_dataset if isinstance(rig_or_dataset, Dataset) else Dataset("", rig, Shots((), {}, {}))
    check_plausible(data, accept)
    among = as_catalogue(terms)
    believed = names_of(rig.believe.terms if believe is None else believe,
                        "rig.toml: believe.terms" if believe is None else "believe", among) or ()
    if isinstance(rig_or_dataset, Dataset):
        if level is not None or shots is not None:
            raise InputError("level, shots: a dataset's own shots are looked at")
        if not is_planned(rig_or_dataset) and (sides or seed is not None):
            option = "sides (--sides)" if sides else "seed (--seed)"
            raise InputError(f"{option}: applies to planned shots only; these have results")
        sight = foresee_dataset(rig_or_dataset, believed, sides, seed or 0, progress, among)
        return Identifiability(name or rig_or_dataset.name, sight, among, hash_dataset(data))
    sight = foresee(rig, believed, settings.LEVEL if level is None else level,
                    settings.SEASON_SHOTS if shots is None else shots, sides, seed or 0, progress, among)
    return Identifiability(name or "rig", sight, among, hash_dataset(data))


@dataclass(frozen=True)
class ShotDesign(Tabular):
    """Shots that would best separate the remaining candidate terms.

    `sentence`, `verdict`: those of the finding. `plan`: plain values as in schema truearc.design/1; empty if there are
    no two terms to separate. `level`: level of the shots, L0, L1 or L2.
    """

    sentence: str
    verdict: str
    plan: dict[str, Any]
    catalogue: Catalogue
    level: str = "L0"

    @property
    def probability_before(self) -> float | None:
        """Probability that the right term alone has 95 % with the present shots; None without terms to separate."""
        return self.plan.get("probability_before")

    @property
    def probability_after(self) -> float | None:
        """The same probability after the planned shots."""
        return self.plan.get("probability_after")

    def table(self) -> Table:
        """Return a row per configuration: number of shots, and settings as in shots.csv. `like`: shot_id of the
        repeated shot; `pace`: its wheel speed relative to that shot, None: the same."""
        shoot = [one for one in self.plan.get("next", ()) if one["do"] == "shoot"]
        return Table(SHOT_COLUMNS, tuple(tuple(one.get(name) for name in SHOT_COLUMNS) for one in shoot))

    def to_json(self) -> str:
        """Return the plan as JSON (schema truearc.design/1)."""
        table = {"schema": pages.SCHEMA, "verdict": self.verdict, "next": [], **self.plan}
        return (msgspec.json.format(msgspec.json.encode(table), indent=1) + b"\n").decode()

    def lines(self) -> list[str]:
        """Return the report: the finding's sentence, then the shots, or a note that there is nothing to separate."""
        told = ["There are no names to tell apart by shots."]
        if "names" in self.plan:
            told = pages.design_lines(self.plan, self.catalogue)
            told += [UNPROVEN] if self.level == "L1" else []
        elif self.plan:
            told = [f"Measure {one['what']}: it would show {', '.join(one['shows'])}." for one in self.plan["next"]]
        return [self.sentence, *told]


def design_shots(dataset: Dataset, found: Finding, *, shots: int = settings.PLANNED_SHOTS,
                 configurations: int = settings.CONFIGURATIONS, seed: int = 0) -> ShotDesign:
    """Choose the feasible shots that best separate a finding's candidate terms.

    Args:
        dataset: The shots of the finding.
        found: Result of `discover` with that dataset.
        shots: Number of shots to plan.
        configurations: Number of configurations to distribute them over.
        seed: Seed of the simulated outcomes.

    Raises:
        InputError: an argument of the wrong type, or fewer shots than configurations.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    check_kind("found", found, Finding, "discover(...)")
    if not 1 <= configurations <= shots:
        raise InputError(f"shots {shots}, configurations {configurations}: at least one shot each")
    steps, record, among = found.investigation.steps, found.record, found.investigation.catalogue
    plan: dict[str, Any] = {}
    if steps and can_design(steps[0]):
        made = make_design(steps[0], shots, configurations, seed)
        plan = pages.design_table(made, dataset.in_order(), steps[0], among)
    elif record.verdict == "none" and record.next:
        plan = {"next": [dict(step) for step in record.next]}
    return ShotDesign(record.told.change, record.verdict, plan, among, record.data.level)
