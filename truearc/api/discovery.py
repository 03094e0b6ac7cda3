"""Find where recordings and simulation disagree, and which physics explains it."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from msgspec import json, structs

from truearc.api.finding_report import FindingReport
from truearc.api.terms import check_kind, names_of
from truearc.errors import InputError, about, save_whole
from truearc.hw.real.clock import wall_clock
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.load import hash_dataset
from truearc.sim.discover import investigate as engine
from truearc.sim.discover.adopt import make_belief
from truearc.sim.discover.finding import FALSE_ALARM, FindingRecord, check_chances
from truearc.sim.discover.investigate import with_worth
from truearc.sim.discover.report.finding_text import console_lines
from truearc.sim.discover.report.pages import make_report, plot_residuals
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.layout import Measurement, check_believed, column_of
from truearc.sim.infer.plausibility.check import check_plausible
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.physics.term import Term
from truearc.sim.progress import Progress
from truearc.sim.report import Origin

IN_PYTHON = "made in Python"          # in place of a command line


@dataclass(frozen=True, eq=False)
class Finding(FindingReport):
    """What discovery answers about a dataset.

    `name`: of the dataset. `investigation`: everything that the report is drawn from. It can be pickled.
    """

    name: str
    investigation: engine.Investigation

    @property
    def record(self) -> FindingRecord:
        """Every figure of the answer, as the JSON schema truearc.finding/1 has it."""
        return self.investigation.finding

    def to_html(self, path: str | Path, *, made_at: str | None = None, command: str = IN_PYTHON) -> None:
        """Write the whole report as one HTML file; OSError where it cannot be written.

        made_at, command: date (None: now) and command line for its head, beside the version and the hash of the data.
        """
        origin = Origin(wall_clock() if made_at is None else made_at, command)
        save_whole(path, make_report(self.name, self.investigation, origin).encode())

    def plot_residuals(self) -> Figure:
        """Draw real shots less simulation, against what the first effect goes with, before and after putting it in.

        Raises:
            InputError: the data carry no test, or nothing that was recorded varies.
        """
        figure = plot_residuals(self.investigation)
        if figure is None:
            raise InputError(f"{self.name}: there are no residuals to plot")
        return figure

    def adopt(self) -> Belief:
        """Return what is believed with the finding put in: fitted coefficients, named effects, their covariance.

        Several terms that cannot be told apart are averaged. What forecasts hold-out shots worse is not adopted;
        `provenance` of the belief says what was and why.

        Raises:
            InputError: the data carry no test, so nothing was fitted; or a coefficient, or an error of the tracker,
                stopped at the end of its range, or tracks and outcomes contradict each other, and there is no belief
                from before.
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
        return replace(belief, provenance={"dataset": self.name, **accepted, **provenance,
                                           "range": self.investigation.ranges,
                                           "rig": self.investigation.launcher})

    def lines(self) -> list[str]:
        """Return the report: the verdict in a sentence, and a few lines below it."""
        return console_lines(self.record, self.investigation.catalogue)


def discover(dataset: Dataset, *, belief: Belief | None = None, believe: Iterable[str | Term] | None = None,
             terms: Iterable[Term] | None = None, since: Dataset | None = None,
             measured: Mapping[str, tuple[float, float]] | None = None, seed: int = 0,
             false_alarm: float = FALSE_ALARM, accept: Collection[str] = (),
             progress: Progress = lambda done, note: None) -> Finding:
    """Test whether a dataset disagrees with the simulation, say where, and rank the terms that explain it.

    Args:
        dataset: Shots with outcomes, heights or tracks.
        belief: Coefficients of this very rig from an earlier session: its terms, with their uncertainty, are the
            baseline model, and whether one has changed is tested, too.
        believe: Instead of a belief, the terms of the baseline model; None: [believe] of the rig. Gravity is always
            there. Their coefficients are fitted.
        terms: Candidate terms, such as [*catalogue(), HoodFlex()]; None: those of the belief, or of the catalogue.
        since: The dataset that `belief` was adopted from: misfit present there, too, is not evidence of change.
        measured: {term: (value, standard deviation)} of amplitudes measured without a shot, in the term's unit.
        seed: Of everything drawn at random; the same data and seed give the same finding.
        false_alarm: Probability of a finding where nothing is missing, 0.002 to 1.
        accept: Names of plausibility checks (truearc.sim.infer.plausibility) whose objections are accepted; recorded.
        progress: Called with the share done, 0 to 1, and a note.

    Code is compiled in each process; set JAX_COMPILATION_CACHE_DIR to keep it on disk.

    Raises:
        InputError: implausible data, an unknown term, contradicting arguments, too few shots, or outcomes without a
            target.
    """
    check_chances(false_alarm, seed)
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
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
    found = engine.discover(dataset, names, false_alarm, seed, progress, belief, since,
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
