"""Team 2910's own `TargetWithShooterCommand.java` of 2020 -> the table that set_points reads."""

from pathlib import Path

from truearc.sim.data.table import Cell, Problems, RawTable, load_table
from truearc_proof.importers.originals import INCH_M, matching, scaled

# a distance in inches, and a vector of the hood's elevation and the wheel's speed
TUNING = (r"SHOOTER_TUNING\.put\(\s*new InterpolatingDouble\((?P<inches>[^()]*)\),\s*"
          r"new Vector2\(\s*Math\.toRadians\((?P<hood>[^()]*)\),\s*(?P<rpm>[^()]*)\)")


def load_2910(path: Path, problems: Problems) -> RawTable:
    """`TargetWithShooterCommand.java` or a table in CSV."""
    if path.suffix != ".java":
        return load_table(path, problems)
    found = matching(path, TUNING)
    count = len(found.lines)
    columns: dict[str, list[Cell]] = {
        "team": ["2910"] * count, "table": ["shooter_tuning"] * count,
        "distance_m": scaled(found.columns["inches"], INCH_M), "wheel_rpm": found.columns["rpm"],
        "hood_raw": found.columns["hood"], "note": [None] * count}
    return RawTable(path, columns, found.lines)
