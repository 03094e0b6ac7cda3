"""Plan shots: what data of a kind could show, and which shots would tell remaining candidate terms apart."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from truearc.api.discovery import IN_PYTHON, Finding
from truearc.api.table import Table
from truearc.api.terms import check_kind, names_of
from truearc.errors import InputError, save_whole
from truearc.hw.real.clock import wall_clock
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.load import hash_dataset
from truearc.sim.discover.finding import CONFIGURATIONS, LEVEL, PLANNED_SHOTS, SEASON_SHOTS, make_json
from truearc.sim.discover.plan.identifiability import Sight, foresee, foresee_dataset, is_planned
from truearc.sim.discover.plan.next_steps import can_design, make_design
from truearc.sim.discover.report.pages import SCHEMA, design_lines, design_table, make_sight_page, sight_lines
from truearc.sim.infer.plausibility.check import check_plausible
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.physics.term import Term
from truearc.sim.printed import Printed
from truearc.sim.progress import Progress
from truearc.sim.report import Origin

TERM_COLUMNS = ("term", "stage", "unit", "usual", "smallest", "power", "shots_needed", "share_left", "like",
                "correlation", "why_not")
UNPROVEN = ("Trials with telemetry have not shown that shots planned so tell names apart better than shots at random: "
            "a measurement is surer.")
SHOT_COLUMNS = ("shots", "like", "distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg", "pace")


@dataclass(frozen=True)
class Identifiability(Printed):
    """What shots of a kind could show of each term. `name`: of rig or dataset; `sight`: every figure; `sha256`: of the
    dataset's content, or the rig's."""

    name: str
    sight: Sight
    catalogue: Catalogue
    sha256: str = ""

    def table(self) -> Table:
        """Return a row per term, most easily seen first.

        usual, smallest: its usual amplitude and the smallest seen with these shots, in `unit`. power: probability of
        seeing it at its usual size. shots_needed: for that with power 0.8; None: no number of shots, `why_not` says
        why. share_left: of its information after the fitted numbers. like, correlation: the most similar other term.
        """
        return Table(TERM_COLUMNS, tuple(
            (one.term, one.stage, one.unit, one.usual, one.smallest, one.power, one.shots_needed, one.share_left,
             one.like, one.correlation, one.why) for one in self.sight.terms))

    def to_json(self) -> str:
        """Return the answer as JSON (schema truearc.identifiability/1)."""
        return make_json(self.sight).decode()

    def to_html(self, path: str | Path, *, made_at: str | None = None, command: str = IN_PYTHON) -> None:
        """Write the report as one HTML file; OSError where it cannot be written.

        made_at, command: date (None: now) and command line for its head, beside the version and the hash of the data.
        """
        origin = Origin(wall_clock() if made_at is None else made_at, command, self.sha256)
        save_whole(path, make_sight_page(self.name, self.sight, self.catalogue, origin).encode())

    def lines(self) -> list[str]:
        """Return the report: how many terms would be seen, and a line per term."""
        return sight_lines(self.sight, self.catalogue)


def identifiability(rig_or_dataset: Rig | Dataset, *, level: str | None = None, shots: int | None = None,
                    believe: Iterable[str | Term] | None = None, terms: Iterable[Term] | None = None,
                    sides: bool = False, seed: int | None = None, name: str | None = None,
                    accept: Collection[str] = (),
                    progress: Progress = lambda done, note: None) -> Identifiability:
    """Work out which terms shots could show, before any result is known.

    Args:
        rig_or_dataset: A rig: a season of shots is planned for it. A dataset: its own shots, with or without results.
        level: Rig only: what is recorded: "L0" outcomes (the default), "L1" telemetry too, "L2" tracks too.
        shots: Rig only: shots of the season, 300 when None.
        believe: Terms whose coefficients are fitted anyway; None: [believe] of the rig.
        terms: Candidate terms; None: the catalogue.
        sides: High or low is noted of every miss.
        seed: Of the planned season, or of where shots without results pass; 0 when None.
        name: Of it in the report; None: the dataset's name, or "rig".
        accept: Names of plausibility checks whose objections are accepted.
        progress: Called with the share done, 0 to 1, and a note.

    Raises:
        InputError: an implausible rig or dataset, an unknown level or term, too few shots, a target that is missing or
            out of reach, level or shots given with a dataset, or sides or seed with one that has results.
    """
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
    sight = foresee(rig, believed, LEVEL if level is None else level, SEASON_SHOTS if shots is None else shots, sides,
                    seed or 0, progress, among)
    return Identifiability(name or "rig", sight, among, hash_dataset(data))


@dataclass(frozen=True)
class ShotDesign(Printed):
    """Shots that would best tell the remaining candidate terms apart.

    `sentence`, `verdict`: of the finding. `plan`: plain values as in schema truearc.design/1; empty where there are no
    two terms to tell apart. `level`: of the shots, L0, L1 or L2.
    """

    sentence: str
    verdict: str
    plan: dict[str, Any]
    catalogue: Catalogue
    level: str = "L0"

    @property
    def probability_before(self) -> float | None:
        """That the right term stands alone (95 %) with the present shots; None without terms to tell apart."""
        return self.plan.get("probability_before")

    @property
    def probability_after(self) -> float | None:
        """The same, once the planned shots have been made."""
        return self.plan.get("probability_after")

    def table(self) -> Table:
        """Return a row per configuration: shots to make, and settings as in shots.csv; `like`: the shot_id that it
        repeats, `pace`: its wheels' speed over that shot's, None: the same."""
        shoot = [one for one in self.plan.get("next", ()) if one["do"] == "shoot"]
        return Table(SHOT_COLUMNS, tuple(tuple(one.get(name) for name in SHOT_COLUMNS) for one in shoot))

    def to_json(self) -> str:
        """Return the plan as JSON (schema truearc.design/1)."""
        table = {"schema": SCHEMA, "verdict": self.verdict, "next": [], **self.plan}
        return (msgspec.json.format(msgspec.json.encode(table), indent=1) + b"\n").decode()

    def lines(self) -> list[str]:
        """Return the report: the finding's sentence, then the shots, or that there is nothing to tell apart."""
        told = ["There are no names to tell apart by shots."]
        if "names" in self.plan:
            told = design_lines(self.plan, self.catalogue)
            told += [UNPROVEN] if self.level == "L1" else []
        elif self.plan:
            told = [f"Measure {one['what']}: it would show {', '.join(one['shows'])}." for one in self.plan["next"]]
        return [self.sentence, *told]


def design_shots(dataset: Dataset, found: Finding, *, shots: int = PLANNED_SHOTS,
                 configurations: int = CONFIGURATIONS, seed: int = 0) -> ShotDesign:
    """Choose the shots, of those that the robot can take, that best tell a finding's candidate terms apart.

    Args:
        dataset: The shots of the finding.
        found: Result of `discover` with that dataset.
        shots: How many to plan.
        configurations: That they are shared out to.
        seed: Of the simulated outcomes.

    Raises:
        InputError: an argument of another type, or fewer shots than configurations.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    check_kind("found", found, Finding, "discover(...)")
    if not 1 <= configurations <= shots:
        raise InputError(f"shots {shots}, configurations {configurations}: at least one shot each")
    steps, record, among = found.investigation.steps, found.record, found.investigation.catalogue
    plan: dict[str, Any] = {}
    if steps and can_design(steps[0]):
        plan = design_table(make_design(steps[0], shots, configurations, seed), dataset.in_order(), steps[0], among)
    elif record.verdict == "none" and record.next:
        plan = {"next": [dict(step) for step in record.next]}
    return ShotDesign(record.sentence, record.verdict, plan, among, record.data.level)
