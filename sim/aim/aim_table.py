"""A table of set points by distance: what prints, what other programs read, and what lies between its rows."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from truearc.robot.config.schema import InputError
from truearc.sim.aim import snippets
from truearc.sim.printed import Printed
from truearc.sim.tables import make_text

SCHEMA = "truearc.aim_table/1"
DISTANCE_M, HOOD_DEG, SPEED_RPM = 0.10, 1.0, 50.0       # errors whose cost is reported
HEADER = ("m", "hood deg", "motor rpm", "P(two)", "P(three)", "points", "-10 cm", "-1 deg", "-50 rpm")


class AimRow(NamedTuple):
    """A set point.

    Fields:
        distance_m: For which it is.
        hood_deg: Launch elevation.
        motor_ratio: Motor speed over free speed.
        motor_rad_s: Motor speed.
        lead_deg: By how much to aim to the left of the target, against wind across.
        p_two, p_three: Probability of at least two points, and of three.
        points: Expected.
        lost_10cm, lost_1deg, lost_50rpm: Points that such an error of distance, hood or motor speed costs, the mean of
            both directions.
        slowest_rad_s, fastest_rad_s: Motor speeds between which at least half of the points are left.
        note: What of it is outside the range of the shots that the belief was fitted to.
    """

    distance_m: float
    hood_deg: float
    motor_ratio: float
    motor_rad_s: float
    lead_deg: float
    p_two: float
    p_three: float
    points: float
    lost_10cm: float
    lost_1deg: float
    lost_50rpm: float
    slowest_rad_s: float
    fastest_rad_s: float
    note: str


@dataclass(frozen=True)
class AimTable(Printed):
    """Set points by ascending distance, and the distances at which nothing scores, with the reason."""

    rows: tuple[AimRow, ...]
    refused: tuple[tuple[float, str], ...] = ()

    def at(self, distance_m: float) -> AimRow:
        """Return the set point of any distance between the rows, each number along a smooth monotone curve.

        Raises:
            InputError: the distance is beyond the table's ends, or nothing scores on one side of it.
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

    def lines(self) -> list[str]:
        """Return a line per distance: set point, probabilities, and what errors cost."""
        turned = any(one.lead_deg for one in self.rows)
        head = (*HEADER, *(["lead deg"] if turned else []), "")
        rows = [(f"{one.distance_m:.2f}", f"{one.hood_deg:.1f}", f"{one.motor_rad_s * snippets.RPM:.0f}",
                 f"{one.p_two:.0%}", f"{one.p_three:.0%}", f"{one.points:.2f}", f"{one.lost_10cm:.2f}",
                 f"{one.lost_1deg:.2f}", f"{one.lost_50rpm:.2f}", *([f"{one.lead_deg:+.1f}"] if turned else []),
                 one.note) for one in self.rows]
        refused = [f"{distance_m:.2f} m: no set point: {why}" for distance_m, why in self.refused]
        return [*make_text(head, rows, right=range(len(head) - 1)), *refused]

    def to_text(self, form: str) -> str:
        """Return the table in a form: text, csv, json, java or cpp."""
        return FORMATS[form](self)

    def to_csv(self) -> str:
        """Return CSV with a header, a row per distance."""
        return snippets.csv_text(AimRow._fields, self.rows)

    def to_json(self) -> str:
        """Return JSON (schema truearc.aim_table/1)."""
        made: dict[str, Any] = {"schema": SCHEMA, "rows": [one._asdict() for one in self.rows],
                                "refused": [{"distance_m": one, "reason": why} for one, why in self.refused]}
        return json.dumps(made, indent=1)

    def to_java(self) -> str:
        """Return statements that fill WPILib's InterpolatingDoubleTreeMap: hood in degrees, motor in rpm."""
        return snippets.java_text(self.rows)

    def to_cpp(self) -> str:
        """Return a C++ array of distance in m, hood in degrees and motor in rpm."""
        return snippets.cpp_text(self.rows)

    def plot(self) -> Any:
        """Return a Matplotlib figure: hood angle, motor speed with the band that scores, and probabilities."""
        from truearc.sim.aim.plot import draw_aim
        return draw_aim(self.rows, self.refused)


FORMATS: dict[str, Callable[[AimTable], str]] = {"text": str, "csv": AimTable.to_csv, "json": AimTable.to_json,
                                                 "java": AimTable.to_java, "cpp": AimTable.to_cpp}
