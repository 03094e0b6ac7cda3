"""truearc discover: where recordings and simulation disagree."""

import argparse
from pathlib import Path

from doors.progress import make_progress
from robot.config import BadInput
from sim.discover.discover import FALSE_ALARM, Investigation, discover
from sim.discover.finding import make_json
from sim.discover.page import make_report
from sim.discover.words import console_lines
from sim.shots import load_dataset

DESCRIPTION = "Say whether a dataset disagrees with the simulation as it stands, and where."
EXAMPLE = "truearc discover shots/ --believe gravity,drag --json finding.json --report finding.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated; else rig.toml's")
    parser.add_argument("--json", metavar="FILE", help="write the finding as JSON")
    parser.add_argument("--report", metavar="FILE", help="write an HTML report")
    parser.add_argument("--false-alarm", type=float, default=FALSE_ALARM, metavar="P",
                        help="how often to cry wolf where there is none (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the random signs (default %(default)s)")


def main(args: argparse.Namespace) -> int:
    """0 whether or not something was found."""
    if not 0.0 < args.false_alarm < 1.0:
        raise BadInput(f"--false-alarm: {args.false_alarm} is not between 0 and 1")
    if args.seed < 0:
        raise BadInput(f"--seed: {args.seed} is negative")
    believed = None if args.believe is None else [name.strip() for name in args.believe.split(",") if name.strip()]
    if believed == []:
        raise BadInput("--believe: names no term")
    found = discover(load_dataset(args.dataset), believed, args.false_alarm, args.seed,
                     make_progress("discover", args.quiet))
    tell(found, Path(args.dataset).name, args.json, args.report)
    return 0


def tell(found: Investigation, name: str, json_path: str | Path | None, report_path: str | Path | None) -> None:
    """Print the answer about the dataset called `name`, and write it where asked."""
    print("\n".join(console_lines(found.finding)))
    if json_path:
        _write(json_path, make_json(found.finding))
    if report_path:
        _write(report_path, make_report(name, found).encode())


def _write(path: str | Path, data: bytes) -> None:
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from error
