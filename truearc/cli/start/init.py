"""Write templates to fill in: a dataset (rig.toml and shots.csv), or with --robot a launcher's configuration.

shots.csv gets a row for each shot: a name, the horizontal distance to the target in metres, the hood's angle above the
horizontal in degrees, motor speed / free speed, and miss, two or three. docs/reference/dataset.md has all of them.
"""

import argparse
from pathlib import Path

from truearc.cli.common import SHIPPED, write_out
from truearc.cli.outputs import OutFolder, out_file
from truearc.errors import InputError

EXAMPLE = "truearc init my_shots"
PROGRESS = False
RIG = Path(__file__).with_name("rig_template.toml")
COLUMNS = ("shot_id", "distance_m", "hood_deg", "motor_ratio", "outcome")
TRACKED = {"shots.csv": ("shot_id", "exit_spin_rev_s"), "tracks.csv": ("shot_id", "t_s", "x_m", "y_m", "z_m")}
TRACKED_BELIEF = """[believe]                             # what the simulation has before anything is discovered
terms = ["gravity", "drag", "magnus"]"""
NOT_TRACKED = ("[[launcher.wheel]]", "[target]", "free_speed_rad_s")       # of rig.toml: flights alone need none


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", nargs="?", type=OutFolder(("rig.toml", "shots.csv", "tracks.csv")),
                        metavar="DIR", help="dataset directory to make")
    parser.add_argument("--units", type=lambda text: text.split(","), default=[], metavar="UNIT[,UNIT]",
                        help="in which shots.csv has distances and angles instead of m and deg: mm, cm, in or ft; rad")
    parser.add_argument("--tracks", action="store_true", help="a dataset of flights that a camera saw: tracks.csv, "
                        "too, and a rig.toml without wheels and target")
    parser.add_argument("--robot", type=out_file, metavar="FILE", help="launcher.toml to write instead: the "
                        "configuration that the emulated robot runs with, every key with its meaning")


def main(args: argparse.Namespace) -> int:
    """Return 0 once the templates are written."""
    if (args.dataset is None) == (args.robot is None):
        raise InputError("DIR or --robot FILE: give one of the two")
    if args.robot is not None and args.units:
        raise InputError("--units: launcher.toml is in SI units; it goes with DIR")
    if args.tracks and (args.robot is not None or args.units):
        raise InputError("--tracks: goes with DIR alone; columns in other units are read by their names (x_mm, x_ft)")
    columns = in_units(args.units)
    if args.robot is not None:
        write_out(args.robot, SHIPPED.read_text(encoding="utf-8"))
        print(f"{args.robot}: change what differs on your launcher; then: truearc doctor --config {args.robot}")
        return 0
    args.dataset.mkdir(parents=True, exist_ok=True)
    rig = RIG.read_text(encoding="utf-8")
    write_out(args.dataset / "rig.toml", for_tracks(rig) if args.tracks else rig)
    for name, header in (TRACKED if args.tracks else {"shots.csv": columns}).items():
        write_out(args.dataset / name, ",".join(header) + "\n")
    rows = ", a row of shots.csv for each shot and one of tracks.csv for each frame" if args.tracks else (
        " and a row of shots.csv for each shot")
    print(f"{args.dataset}: fill in rig.toml{rows}; then: truearc check {args.dataset}")
    return 0


def for_tracks(rig: str) -> str:
    """Return the template rig.toml without what flights alone do not need."""
    blocks = [TRACKED_BELIEF if block.startswith("[believe]") else block for block in rig.split("\n\n")
              if not block.startswith(NOT_TRACKED)]
    return "\n".join(line for line in "\n\n".join(blocks).split("\n") if not line.startswith(NOT_TRACKED))


def in_units(units: list[str]) -> list[str]:
    """Return the columns of shots.csv in these units; InputError for a unit that none of them can be in."""
    from truearc.robot.config.unit_table import CONVERTED
    columns = list(COLUMNS)
    for unit in units:
        read = next((read for read in ("m", "deg") if unit in (read, *CONVERTED[read])), None)
        if read is None:
            known = ", ".join(one for read in ("m", "deg") for one in (read, *CONVERTED[read]))
            raise InputError(f"--units: {unit!r} is not a unit of a distance or an angle; there are {known}")
        columns = [name.removesuffix(read) + unit if name.endswith(f"_{read}") else name for name in columns]
    return columns
