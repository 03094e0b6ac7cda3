"""Forecast shots with a belief or a gate, and find the set points that score the most points under a belief."""

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from truearc.api.arguments import check_kind
from truearc.api.results import Table, Tabular
from truearc.errors import InputError, naming, whole_file
from truearc.model_export.verify import HEADER as RATING_COLUMNS
from truearc.model_export.verify import rate_shots
from truearc.robot.aim_file import check_rig, load_aim
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.config.units import CONVERTED
from truearc.robot.gate import load_gate
from truearc.sim.aim.make_table import (
    RPM,
    TEAMS,
    AimCheck,
    AimRow,
    aim_bytes,
    check_aim_file,
    cpp_text,
    draw_aim,
    java_text,
    make_rows,
)
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, circumstances_of
from truearc.sim.infer.belief import Belief, along
from truearc.sim.infer.landing_forecast import forecast_landings
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.infer.track_forecast import forecast_flights
from truearc.sim.physics.simulate import forecast
from truearc.sim.printed import Progress, make_text, show_progress
from truearc.sim.statistics import Z90

ROUNDING = 1e-6                       # of a fitted range: a converted unit is not outside it
TRACK_COLUMNS = ("shot_id", "t_s", "x_m", "y_m", "z_m", "x_band_m", "y_band_m", "z_band_m")
NOT_REACHED = "does not reach the target: it meets the floor or turns back first"
SCHEMA = "truearc.aim_table/1"
HEADER = ("m", "hood deg", "motor rpm", "P(two)", "P(three)", "points", "-10 cm", "-1 deg", "-50 rpm")
HITS = ("m", "hood deg", "motor rpm", "P(hit)", "10 cm off", "1 deg off", "50 rpm off")
RINGED = (*HEADER[:3], "P(hit)", "P(ring)", *HEADER[5:])            # of an opening that faces up, and has a ring
STEP_M = 0.25                         # between distances, where none are given
DISTANCES_M = (2.0, 7.0)              # their range where the belief does not say to what it was fitted
HOOD_DEG = (20.0, 70.0)               # likewise
FARTHEST_M = 100.0


def predict(dataset: Dataset, belief: Belief | None = None, *, gate: str | Path | None = None,
            tracks: float | None = None, accept: Collection[str] = (),
            progress: Progress | None = None) -> Table:
    """Forecast each shot of a dataset with a belief or an exported gate.

    Args:
        dataset: Shots with distance_m [m], hood_deg [deg] and motor_ratio [1] (or wheel speeds, for a belief).
        belief: Coefficients for the forecasts.
        gate: ONNX file of a gate, instead of a belief.
        tracks: Forecast flights instead: from the first such share of each track's samples, at the times of the others
            (1: from all, every 0.02 s on to the floor); 0: from settings alone, from release to plane or floor.
        accept: Names of plausibility checks whose objections are accepted.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Returns:
        A row per shot. With a belief: shot_id, height_m at the target plane above the floor [m], deviation_m from the
        target's centre [m, up positive], outcome, and a note if a setting is outside the range of the fitted shots, the
        rig differs from theirs, or height_m is None because the ball hits the floor or turns back first. For a target
        that faces up: shot_id, along_m and across_m from its centre in the plane of the rim [m, away from the launcher
        and to the left], angle_deg below that plane, outcome, side of a miss, p_hit (probability), note. With a gate:
        shot_id, p_two and p_three (probabilities), in_domain, novelty (over 1: outside the recorded shots); None where
        the gate gives no number. With tracks: a row per time t_s [s, from the track's first sample, or from release]:
        where the ball is (launcher's frame), and for each axis half the width of the 90 % interval, by what the belief
        leaves open, launches scatter and the samples leave unknown.

    Raises:
        InputError: implausible data, neither or both of belief and gate, a file that is not a gate, a missing column,
            a rig without a target, tracks outside 0 to 1 or with a gate, or no flight that can be forecast.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    if (belief is None) == (gate is None):
        raise InputError("predict: give either a belief or gate=FILE")
    if tracks is not None and (belief is None or not 0.0 <= tracks <= 1.0):
        raise InputError(f"predict: tracks={tracks:g}: expected a share from 0 to 1, with a belief")
    dataset = check_plausible(dataset, accept)
    if belief is None:
        return Table(RATING_COLUMNS, tuple(rate_shots(load_gate(str(gate)), dataset.shots, dataset.name)))
    check_kind("belief", belief, Belief, "load_belief(...)")
    if tracks is not None:
        flights = forecast_flights(dataset, belief, float(tracks))
        return Table(TRACK_COLUMNS, tuple(
            (dataset.shots.shot_id[one.row], *map(float, numbers)) for one in flights
            for numbers in np.column_stack([one.t_s, one.place_m, Z90 * one.sd_m])))
    flown = _flown(dataset, belief, progress or show_progress("predict"))
    other, first = belief.other_rig(dataset.rig), next(iter(flown.values()))
    notes = ["; ".join(filter(None, (note, other))) for note in _notes(dataset.shots, first, belief.provenance)]
    rows = zip(dataset.shots.shot_id, *flown.values(), notes, strict=True)
    return Table(("shot_id", *flown, "note"), tuple(tuple(None if cell != cell else cell for cell in row)
                                                    for row in rows))


def _notes(shots: Shots, places_m: Sequence[float], provenance: Mapping[str, Any]) -> list[str]:
    """What to know of each forecast; "" where there is nothing."""
    notes: list[list[str]] = [[NOT_REACHED] if place != place else [] for place in places_m]
    fitted = provenance.get("range", {})
    for name, (low, high) in fitted.items() if isinstance(fitted, Mapping) else ():
        room = ROUNDING * (high - low)
        for note, value in zip(notes, shots.number(name).tolist(), strict=True):
            if value < low - room or value > high + room:
                note.append(f"{name} {value:.4g} is outside the fitted {low:.4g} to {high:.4g}")
    return ["; ".join(note) for note in notes]


def _flown(dataset: Dataset, belief: Belief, progress: Progress) -> dict[str, Sequence[Any]]:
    """Columns of each shot, under the conditions that the dataset records; NaN: not reached."""
    if dataset.rig.target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": deviation and outcome are about it")
    circumstances = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    columns = forecast(dataset.rig, belief.coefficients, dataset.shots, progress, circumstances, belief.catalogue)
    if dataset.rig.target.faces_up:
        lands = forecast_landings(dataset.rig, belief, dataset.shots)
        columns["p_hit"] = np.full(len(dataset.shots), np.nan)
        chance = lands.seen.class_chances(lands.mean_m, lands.spread_m, lapses=False)
        columns["p_hit"][lands.rows] = chance[:, 1:].sum(1)
    return {name: column.tolist() for name, column in columns.items()}


@dataclass(frozen=True)
class AimTable(Tabular):
    """Set points by ascending distance, and the distances without a scoring set point, with the reason; the target."""

    rows: tuple[AimRow, ...]
    refused: tuple[tuple[float, str], ...] = ()
    target: Target = field(default_factory=lambda: Target(0.0))

    def at(self, distance_m: float) -> AimRow:
        """Return the set point of any distance between the rows, interpolated by smooth monotone curves.

        Raises:
            InputError: the distance is outside the table, or one of its neighbours has no scoring set point.
        """
        first, last = self.rows[0].distance_m, self.rows[-1].distance_m
        if not first <= distance_m <= last:
            raise InputError(f"distance_m: {distance_m:g} is outside the table's {first:g} to {last:g}")
        bad = [(one, why) for one, why in self.refused if first < one < last]
        low = max(one.distance_m for one in self.rows if one.distance_m <= distance_m)
        high = min(one.distance_m for one in self.rows if one.distance_m >= distance_m)
        for one, why in bad:
            if low < one < high:
                raise InputError(f"distance_m: {distance_m:g}: {why} at {one:g}")
        if low == high:
            return next(one for one in self.rows if one.distance_m == low)
        x = np.array([one.distance_m for one in self.rows])
        y = np.array([one[:-1] for one in self.rows], float)
        numbers = PchipInterpolator(x, y)(distance_m)
        notes = dict.fromkeys(one.note for one in self.rows if one.distance_m in (low, high) and one.note)
        return AimRow._make([*map(float, numbers), "; ".join(notes)])

    def lines(self, unit: str = "m") -> list[str]:
        """Return a line per distance in the given unit of length: set point, probabilities, and the cost of errors, in
        hits for a hit-or-miss target."""
        metres = {"m": 1.0, **CONVERTED["m"]}[unit]
        turned, hits = any(one.lead_deg for one in self.rows), not any(one.p_three for one in self.rows)
        up, best = self.target.faces_up, self.target.worth[0]
        head = (unit, *(HITS if hits else RINGED if up else HEADER)[1:], *(["arrives deg"] if up else []),
                *(["lead deg"] if turned else []), "")
        rows = []
        for one in self.rows:
            lost = one.lost_10cm, one.lost_1deg, one.lost_50rpm
            worth = ([f"{-points / best:+.0%}".replace("-0%", "0%") for points in lost] if hits
                     else [f"{one.p_three:.0%}", f"{one.points:.2f}", *(f"{points:.2f}" for points in lost)])
            rows.append((f"{one.distance_m / metres:.2f}", f"{one.hood_deg:.1f}",
                         f"{one.motor_rad_s * RPM:.0f}", f"{one.p_two:.0%}", *worth,
                         *([f"{one.arrival_deg:.0f}"] if up else []),
                         *([f"{one.lead_deg:+.1f}"] if turned else []), one.note))
        refused = [f"{distance_m / metres:.2f} {unit}: no set point: {why}" for distance_m, why in self.refused]
        return [*make_text(head, rows, right=range(len(head) - 1)), *refused]

    def to_text(self, form: str) -> str:
        """Return the table in a format: text, csv, json, java, cpp, or the format of a team's public code."""
        return FORMATS[form](self) if form in FORMATS else TEAMS[form](self.rows)

    def table(self) -> Table:
        """Return all numbers, a row per distance."""
        return Table(AimRow._fields, self.rows)

    def to_csv(self) -> str:
        """Return CSV with a header, a row per distance."""
        return self.table().to_csv()

    def to_json(self) -> str:
        """Return JSON (schema truearc.aim_table/1)."""
        made: dict[str, Any] = {"schema": SCHEMA, "rows": [one._asdict() for one in self.rows],
                                "refused": [{"distance_m": one, "reason": why} for one, why in self.refused]}
        return json.dumps(made, indent=1)

    def to_java(self) -> str:
        """Return Java statements that fill WPILib's InterpolatingDoubleTreeMap: hood in degrees, motor in rpm."""
        return java_text(self.rows)

    def to_cpp(self) -> str:
        """Return a C++ array of distance in m, hood in degrees and motor in rpm."""
        return cpp_text(self.rows)

    def plot(self) -> Any:
        """Plot hood angle, motor speed with the band that scores, and probabilities, as a Matplotlib figure."""
        return draw_aim(self.rows, self.refused, self.target.faces_up)


FORMATS: dict[str, Callable[[AimTable], str]] = {"text": str, "csv": AimTable.to_csv, "json": AimTable.to_json,
                                                 "java": AimTable.to_java, "cpp": AimTable.to_cpp}


def aim(belief: Belief, rig: Rig, *, distances_m: Iterable[float] | None = None,
        hood_deg: tuple[float, float] | None = None, accept: Collection[str] = (),
        progress: Progress | None = None) -> AimTable:
    """Find the hood angle and motor speed with the most expected points for each distance.

    The height at the target, or the place where the ball comes down at one that faces up, is normally distributed about
    the belief's forecast, with the scatter between shots, the noise of the sensors (rig.toml [noise]) and the belief's
    covariance. At a target that faces up, set points are chosen as for three times that spread, so that of those that
    hit almost surely the one with the widest margin wins. Among set points that score nearly equally, a smooth sequence
    with slower wheels is chosen.

    Args:
        belief: Coefficients, scatter and covariance.
        rig: Launcher, target and sensor noise.
        distances_m: Distances from exit to target; None: every 0.25 m of the belief's fitted range, else of 2 to 7 m.
        hood_deg: Lowest and highest launch elevation; None: the belief's fitted range, or else 20 to 70.
        accept: Names of plausibility checks whose objections to the rig are accepted.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Returns:
        A row per distance; distances without a scoring set point are listed with the reason. The outer opening counts
        two points, the inner one three, and a hit on a hit-or-miss target two; a hit on a target that faces up counts
        what [target] states.

    Raises:
        InputError: an implausible rig, one without target, wheels or free speed, an invalid distance or angle, or no
            distance with a scoring set point.
    """
    check_kind("belief", belief, Belief, "load_belief(...)")
    check_kind("rig", rig, Rig, "load_rig(...)")
    check_plausible(Dataset("", rig, Shots((), {}, {})), accept)
    fitted = belief.provenance.get("range", {})
    known: Mapping[str, list[float]] = fitted if isinstance(fitted, Mapping) else {}
    try:
        low, high = map(float, known.get("hood_deg", HOOD_DEG) if hood_deg is None else hood_deg)
    except (TypeError, ValueError) as error:
        raise InputError(f"hood_deg: got {hood_deg!r}; expected lowest and highest in degrees") from error
    if not -90.0 < low <= high < 90.0:
        raise InputError(f"hood_deg: {low:g} to {high:g}; it must ascend, between -90 and 90")
    rows, refused = make_rows(rig, belief, _distances(distances_m, known), (low, high),
                              progress or show_progress("aim"))
    if other := belief.other_rig(rig):
        rows = tuple(row._replace(note="; ".join(filter(None, (row.note, other)))) for row in rows)
    assert rig.target is not None     # or no set point scores
    return AimTable(rows, refused, rig.target)


def export_aim(table: AimTable, belief: Belief, rig: Rig, path: str | Path, *, note: str = "") -> AimCheck:
    """Write the robot's aim file (`aim.policy = "belief"`) and check it against the simulator.

    Args:
        table: Result of `aim` with this belief and rig.
        belief: Coefficients, scatter and covariance.
        rig: Rig of the robot's launcher.toml; a robot with another ball, launcher or target refuses the file.
        path: File to write.
        note: One line for the driver, at most 200 characters.

    Returns:
        Expected points of the file's set points, read back as on the robot, and of the best ones at random distances.

    Raises:
        InputError: the file cannot be written, no two neighbouring distances have a set point, or a set point falls
            short of the best by more than 0.05 points. An existing file is then left unchanged.
    """
    check_kind("table", table, AimTable, "aim(...)")
    record = {"version": version("truearc"), "coefficients": belief.coefficients, "scatter": belief.scatter}
    data = aim_bytes(table.rows, table.refused, rig, note, record, belief)
    with naming(path), whole_file(path) as new:
        new.write_bytes(data)
        return verify_aim(new, belief, rig)


def verify_aim(path: str | Path, belief: Belief, rig: Rig, *, seed: int = 0) -> AimCheck:
    """Check an aim file, read as on the robot, against the best set points at 40 random distances.

    Args:
        path: Aim file.
        belief: Belief that the file was made from.
        rig: Rig that the file is for.
        seed: Seed of the distances.

    Raises:
        InputError: the file is not a valid aim file, is for another rig, or a set point falls short of the best by more
            than 0.05 points.
    """
    check_kind("belief", belief, Belief, "load_belief(...)")
    check_kind("rig", rig, Rig, "load_rig(...)")
    file = load_aim(path)
    check_rig(path, file, rig)
    check = check_aim_file(file, belief, rig, seed)
    if not check.passed:
        worst = float(check.distance_m[np.argmax(check.best - check.points)])
        raise InputError(f"{path}: at {worst:.2f} m the set point has {check.lost:.2f} points less than the best; use "
                         "this belief's own file, or smaller steps of distance")
    return check


def _distances(given: Iterable[float] | None, known: Mapping[str, list[float]]) -> np.ndarray:
    if given is None:
        low, high = known.get("distance_m", DISTANCES_M)
        first, last = np.ceil(low / STEP_M - 1e-9), np.floor(high / STEP_M + 1e-9)
        return np.arange(first, last + 1) * STEP_M if first <= last else np.array([0.5 * (low + high)])
    distances = np.unique(np.array(list(given), float))
    if not distances.size or not np.isfinite(distances).all() or distances[0] <= 0.0 or distances[-1] > FARTHEST_M:
        raise InputError(f"distances_m: between 0 and {FARTHEST_M:g} m are needed")
    return distances
