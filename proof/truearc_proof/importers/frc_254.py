"""Team 254's own `Constants.java` of 2020 -> the table that set_points reads."""

from pathlib import Path

from truearc.errors import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.table import Cell, Problems, RawTable, load_table
from truearc_proof.importers.originals import INCH_M, matching, scaled

NUMBER = r"new InterpolatingDouble\((?P<{}>[^()]*)\)"
HOOD = r"kLaser(?P<ball>Old|Medium|New)HoodMap\.put\(" + NUMBER.format("inches") + r",\s*" + NUMBER.format("hood")
SPEED = r"kLaserRPMMap\.put\(" + NUMBER.format("inches") + r",\s*" + NUMBER.format("rpm")
BEYOND_IN = 12.0                      # where the team went on in a straight line, so as not to clamp
STRAIGHT_DEG = 1e-4
Point = tuple[float | None, float | None]


def load_254(path: Path, problems: Problems) -> RawTable:
    """`Constants.java` or a table in CSV; rows of the Java file that repeat another are taken once."""
    if path.suffix != ".java":
        return load_table(path, problems)
    found = matching(path, HOOD)
    rpm = matching(path, SPEED).columns["rpm"]
    if len(set(rpm)) > 1:
        raise InputError(f"{path}: kLaserRPMMap has several speeds; a version with one is needed")
    rows = list(zip(*(found.columns[name] for name in ("ball", "inches", "hood")), strict=True))
    kept = [k for k, row in enumerate(rows) if row not in rows[:k]]
    ball, inches, hood = ([found.columns[name][k] for k in kept] for name in ("ball", "inches", "hood"))
    points = list(zip(ball, map(parse_number, inches), map(parse_number, hood), strict=True))
    columns: dict[str, list[Cell]] = {
        "team": ["254"] * len(kept), "table": [f"laser_{str(name).lower()}_ball" for name in ball],
        "distance_m": scaled(inches, INCH_M), "wheel_rpm": [rpm[0]] * len(kept), "hood_raw": hood,
        "note": ["EXTRAPOLATED" if is_extrapolated((x, y), [(a, b) for other, a, b in points if other == name])
                 else None for name, x, y in points]}
    return RawTable(path, columns, [found.lines[k] for k in kept])


def is_extrapolated(point: Point, table: list[Point]) -> bool:
    """Whether this is a table's last point, BEYOND_IN from the one before and in line with the two before."""
    known = sorted((x, y) for x, y in table if x is not None and y is not None)
    if len(known) < 3 or point != known[-1]:
        return False
    (x0, y0), (x1, y1), (x2, y2) = known[-3:]
    return abs(x2 - x1 - BEYOND_IN) < 1e-6 and abs(y1 + (y1 - y0) / (x1 - x0) * (x2 - x1) - y2) < STRAIGHT_DEG
