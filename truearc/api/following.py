"""Monitor the shots fired since a belief was formed, and propose another belief if something has changed."""

import hashlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from msgspec import UNSET, UnsetType, structs

from truearc.api.arguments import check_kind
from truearc.api.discovery import Finding, discover
from truearc.api.forecasting import AimTable, aim
from truearc.api.results import Table, Tabular
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.targets import SIDES_UP
from truearc.sim.aim.make_table import AimRow
from truearc.sim.aim.solve import chances_of
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover import finding as settings
from truearc.sim.discover.detect.always_valid import ChangeTest
from truearc.sim.discover.investigate import follow_shots
from truearc.sim.discover.report.finding_text import either, plain, say_name
from truearc.sim.infer.belief import Belief
from truearc.sim.printed import Printed, Progress

FEWEST_SINCE = 15                     # shots since the change, by which it can be named
FEWEST_SIDED = 5                      # of these, whose side of the centre is known; else no direction is
EVERY_FINDING = 0.99                  # false alarm of the discovery after an alarm: that something changed is known
ALONG = (*SIDES_UP, *SIDES_UP.values())              # sides that tell in which direction to correct
COLUMNS = ("shot", "e_value", "alarm")


@dataclass(frozen=True, eq=False)
class Following(Tabular):
    """The marked shots since a belief, in order, and the test for a change.

    dataset: the shots; belief: the tested belief; test: e-values after each shot; false_alarm: probability of an alarm
    in an endless session without changes, tested after every shot; accept: plausibility checks whose objections are
    accepted.
    """

    dataset: Dataset
    belief: Belief
    test: ChangeTest
    false_alarm: float
    seed: int = 0
    accept: Collection[str] = ()

    @property
    def e_values(self) -> tuple[float, ...]:
        """E-value after each shot: how much more probable the outcomes are if something changed."""
        return tuple(map(float, self.test.e_value))

    @property
    def alarm(self) -> int | None:
        """Number of the shot with the alarm, from 1; None without an alarm."""
        place = self.test.alarm(self.false_alarm)
        return None if place is None else place + 1

    @cached_property
    def since(self) -> int | None:
        """Number of the most likely first shot after the change, from 1; None without an alarm."""
        return None if self.alarm is None else self.test.since(len(self.test.rows) - 1)[0] + 1

    def shot(self, number: int) -> str:
        """Return the shot_id of a followed shot, counted from 1."""
        return str(self.dataset.shots.shot_id[int(self.test.rows[number - 1])])

    @property
    def can_be_named(self) -> bool:
        """Whether there was an alarm and enough shots have followed the change to identify it."""
        return self.since is not None and len(self.test.rows) - self.since + 1 >= FEWEST_SINCE

    def find(self, progress: Progress | None = None) -> Finding:
        """Run discovery on the shots since the change.

        Raises:
            InputError: there was no alarm, too few shots have followed it, or an error of `discover`.
        """
        if self.since is None:
            raise InputError(f"{self.dataset.name}: no alarm, so there is nothing to find")
        if not self.can_be_named:
            raise InputError(f"{self.dataset.name}: {len(self.test.rows) - self.since + 1} shots since the change; "
                             f"{FEWEST_SINCE} at least are needed to say what it is")
        later = self.dataset.take([int(row) for row in self.test.rows[self.since - 1:]])
        return discover(later, belief=self.belief, seed=self.seed, false_alarm=EVERY_FINDING,
                        accept=self.accept, progress=progress)

    def table(self) -> Table:
        """Return a row per shot: its shot_id, the e-value after it, and whether that is an alarm."""
        return Table(COLUMNS, tuple((self.shot(k + 1), e_value, e_value >= 1.0 / self.false_alarm)
                                    for k, e_value in enumerate(self.e_values)))

    def lines(self) -> list[str]:
        """Return the e-value and alarm after the last shot as text."""
        e_value = self.test.e_value
        head = (f"{len(e_value)} shots: e-value {e_value[-1]:.3g}, largest {e_value.max():.3g}; alarm from "
                f"{1.0 / self.false_alarm:g} on")
        if self.alarm is None:
            return [f"{head}: no change"]
        since = self.since or 1
        return [head, f"change: alarm at shot {self.alarm} ({self.shot(self.alarm)}), likeliest since shot {since} "
                      f"({self.shot(since)})"]


def follow(dataset: Dataset, belief: Belief, *, false_alarm: float = settings.FALSE_ALARM, seed: int = 0,
           accept: Collection[str] = ()) -> Following:
    """Test the shots since a belief for a change, with a result that is valid after every shot.

    Call it again as the dataset grows: the probability of an alarm is at most `false_alarm` in any number of calls if
    the belief describes the launcher.

    Args:
        dataset: Shots with outcomes or heights, of the belief's rig.
        belief: Coefficients, scatter and covariance, from an earlier session.
        false_alarm: Probability of an alarm if nothing changes.
        seed: Seed of the draws from the belief.
        accept: Names of plausibility checks whose objections are accepted.

    Raises:
        InputError: implausible data; no shot has an outcome or a height with its distance and launch; or outcomes
            without a target.
    """
    settings.check_chances(false_alarm, seed)
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    check_kind("belief", belief, Belief, "load_belief(...)")
    dataset = check_plausible(dataset, accept).in_order()
    return Following(dataset, belief, follow_shots(dataset, belief, seed), false_alarm, seed, accept)


@dataclass(frozen=True, eq=False)
class Proposed(Printed):
    """Proposed belief: the change, the set points under both beliefs, and the content of the file."""

    proposal: settings.AimProposal
    belief: Belief
    before: AimTable
    after: AimTable

    def to_json(self) -> str:
        """Return the proposal as JSON (schema truearc.proposal/1)."""
        return settings.make_json(self.proposal).decode()

    def lines(self) -> list[str]:
        """Return the proposal in one line."""
        return [self.proposal.sentence]


def propose(following: Following, finding: Finding, rig: Rig, files: tuple[settings.BeliefFile, str],
            distances_m: Iterable[float] | None = None,
            progress: Progress | None = None) -> Proposed:
    """Make a proposal from the finding on the shots since the change.

    files: the file of the present belief, and the name for the file of the proposed one.

    Raises:
        InputError: no effect is worth adopting, with the reason, or an error of `aim`.
    """
    belief = finding.adopt()
    if why := _refused(following, finding, belief):
        raise InputError(f"nothing is proposed: {why}")
    places = list(distances_m) if distances_m is not None else _places(following.dataset)
    before, after = (aim(one, rig, distances_m=places, hood_deg=_hood(following.belief), progress=progress)
                     for one in (following.belief, belief))
    rows = tuple(_change(rig, belief, place, before, after) for place in places)
    adopted = _adopted(belief)
    effects = tuple(settings.ProposedEffect(one.term, one.probability, one.value, *one.interval90, one.unit,
                                            one.sentence, one.change or UNSET)
                    for one in finding.effects if one.term in adopted)
    alarm, since = following.alarm or 1, following.since or 1
    name = files[1]
    made = settings.AimProposal("", None, _say(finding, since, rows, following), effects, following.shot(since), since,
                    following.shot(alarm), len(following.test.rows), float(following.test.e_value.max()),
                    following.false_alarm, files[0], settings.BeliefFile(name, ""), rows)
    return Proposed(made, belief, before, after)


def _refused(following: Following, finding: Finding, belief: Belief) -> str:
    """Why what was found is not offered to the driver; "" where it is."""
    if not belief.provenance.get("adopted"):
        return str(belief.provenance.get("refused", "no effect was found by which the shots are forecast better"))
    rows = following.test.rows[(following.since or 1) - 1:]
    later = following.dataset.take([int(row) for row in rows])
    known = np.isin(later.shots.text("side"), ALONG) | np.isfinite(later.shots.number("miss_height_m"))
    if later.tracks is not None:
        known[later.tracks.shot] = True
    sided, target = int(known.sum()), following.dataset.rig.target
    buttons = "" if target is not None and target.faces_up else "two-low, two-high, "
    if sided < FEWEST_SIDED:
        return (f"of {len(rows)} shots since the change {sided} say on which side of the centre they passed; "
                f"{FEWEST_SIDED} at least are needed to correct in the right direction (column side; buttons "
                f"{buttons}miss-low, miss-high)")
    worth = finding.record.adoption
    if not isinstance(worth, UnsetType) and worth.low90 <= 0.0:
        return (f"aimed by it, hold-out shots would gain {worth.gain:+.2f} points (90 %: {worth.low90:+.2f} to "
                f"{worth.high90:+.2f}), which may be nothing")
    return ""


def sealed(proposed: Proposed, content: bytes, made_at: str | None = None) -> Proposed:
    """Return the proposal with its id (the hash of the belief's file, whose bytes are `content`) and ISO time."""
    after = settings.BeliefFile(proposed.proposal.after.file, hashlib.sha256(content).hexdigest())
    return replace(proposed, proposal=settings.with_id(structs.replace(proposed.proposal, after=after, t=made_at)))


def _adopted(belief: Belief) -> set[str]:
    adopted = belief.provenance.get("adopted", [])
    return {str(name).partition(" ")[0] for name in adopted if isinstance(adopted, list)}


def _places(dataset: Dataset) -> list[float]:
    """Distances by quarters of a metre that the shots cover."""
    distance_m = dataset.shots.number("distance_m")
    low, high = np.floor(np.nanmin(distance_m) * 4.0), np.ceil(np.nanmax(distance_m) * 4.0)
    return [float(one) for one in np.arange(max(low, 1.0), high + 1.0) / 4.0]


def _hood(belief: Belief) -> tuple[float, float] | None:
    known = belief.provenance.get("range", {})
    found = known.get("hood_deg") if isinstance(known, dict) else None
    return None if found is None else (float(found[0]), float(found[1]))


def _row(table: AimTable, distance_m: float) -> AimRow | None:
    return next((one for one in table.rows if abs(one.distance_m - distance_m) < 1e-9), None)


def _change(rig: Rig, belief: Belief, distance_m: float, before: AimTable, after: AimTable) -> settings.SetPointChange:
    old, new = _row(before, distance_m), _row(after, distance_m)
    kept = None
    if old is not None:
        kept = float(chances_of(rig, belief, *(np.array([one]) for one in (
            distance_m, old.hood_deg, old.motor_ratio))).points[0])
    return settings.SetPointChange(distance_m, old and old.hood_deg, new and new.hood_deg, old and old.motor_rad_s,
                          new and new.motor_rad_s, new and new.points, kept)


def _say(finding: Finding, since: int, rows: tuple[settings.SetPointChange, ...], following: Following) -> str:
    """One line for the driver: what, since when, and what the aim does about it."""
    known = [row for row in rows if row.motor_before_rad_s is not None and row.motor_after_rad_s is not None]
    middle = float(np.nanmedian(following.dataset.shots.number("distance_m")))
    aimed = ""
    if known:
        row = min(known, key=lambda one: abs(one.distance_m - middle))
        hood = (row.hood_after_deg or 0.0) - (row.hood_before_deg or 0.0)
        turn = f" and hood {hood:+.1f} deg" if abs(hood) >= 0.05 else ""
        faster = (row.motor_after_rad_s or 0.0) - (row.motor_before_rad_s or 0.0)
        aimed = f"; aim at {row.distance_m:g} m: {faster:+.0f} rad/s{turn}"
    worth = finding.record.adoption
    points = "" if isinstance(worth, UnsetType) else (
        f"; hold-out shots, aimed: {worth.aimed_before:.2f} -> {worth.aimed_after:.2f} points")
    return f"{_what(finding, following)} since shot {since}{aimed}{points}; accept?"


def _what(finding: Finding, following: Following) -> str:
    """The likeliest effect with its size, and what else it may be."""
    record, among = finding.record, following.belief.catalogue
    if finding.best is None:
        return "an effect that no term explains"
    said = say_name(record.what[0], among, record.data.topspin)
    others = [plain(one.term, among) for one in finding.alternatives[:2]]
    return f"{said}{', or ' + either(others) + ',' if others else ''}"
