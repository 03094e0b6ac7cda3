"""The command `aim`: tables of set points."""

import argparse
import math
import re
import sys

import truearc as ta
from truearc.cli import common
from truearc.cli.outputs import out_file
from truearc.errors import about, save_whole
from truearc.robot.config.shot_map import CONVERTED

FORMATS = ("text", "csv", "json", "java", "cpp", "java-6328", "java-254", "csv-2928", "json-3476")
MOST = 1000                           # distances
UNIT = re.compile(r"(.*[\d.]) ?([a-z]+)")


def aim_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("belief", metavar="BELIEF", help="coefficients.toml, as `truearc fit` and `truearc discover "
                        "--adopt` write it")
    parser.add_argument("--rig", required=True, metavar="FILE", help="rig.toml of a dataset, or launcher.toml")
    parser.add_argument("--distances", type=parse_distances, metavar="LOW:HIGH:STEP", help="in m, or a list such "
                        "as 2,3.5,5; a unit may follow: 6:20:1ft (default: every 0.25 m of the range that the belief "
                        "was fitted to)")
    parser.add_argument("--hood", type=_span, metavar="LOW:HIGH", help="launch elevations in degrees to choose from "
                        "(default: the range that the belief was fitted to)")
    parser.add_argument("--format", choices=FORMATS, default="text", help="text for people, CSV or JSON with every "
                        "number, lines to paste into robot code, or the shape of a team's public "
                        "code: java-6328, java-254, csv-2928, json-3476 (default text)")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="file to write instead of standard output")
    parser.add_argument("--picture", type=out_file, metavar="PNG", help="picture of set points and of the band that "
                        "scores")
    parser.add_argument("--robot", type=out_file, metavar="FILE", help="aim file for `truearc run --aim`, checked "
                        "against the simulator; --rig should be the robot's launcher.toml then")
    parser.add_argument("--note", metavar="TEXT", help="one line in that file for the driver")
    common.add_terms_from(parser)
    common.add_accept(parser)


def aim(args: argparse.Namespace) -> int:
    """Find the hood angle and motor speed that score most at each distance, by a belief.

    Probabilities hold the scatter from shot to shot, the sensors' noise (rig.toml [noise]) and the belief's covariance.
    The last columns of the table say how many points an error of distance, hood angle or motor speed costs.
    """
    from truearc.sim.compute import keep_compiled
    keep_compiled()
    if args.picture and args.picture.suffix.lower() != ".png":
        raise ta.InputError(f"--picture: {args.picture}: a PNG is written; end the name with .png")
    rig, belief = common.load_any_rig(args.rig), ta.load_belief(args.belief, common.catalogue_of(args))
    with about(args.rig):
        table = ta.aim(belief, rig, distances_m=args.distances, hood_deg=args.hood, accept=args.accept,
                       progress=common.make_progress("aim", args.quiet))
    if args.robot is None:
        common.refuse(args, ("--note",), "applies with --robot only")
    unit = args.distances.unit if args.distances is not None else "m"
    common.print_or_write(args.out, "\n".join(table.lines(unit)) if args.format == "text" else
                          table.to_text(args.format))
    if args.format != "text":         # which says so itself
        for distance_m, why in table.refused:
            print(f"warning: {distance_m:.2f} m has no set point: {why}", file=sys.stderr)
        for row in table.rows if args.format not in ("csv", "json") else ():           # which have a column of notes
            if row.note:
                print(f"warning: {row.distance_m:.2f} m: {row.note}", file=sys.stderr)
    if args.robot:
        check = ta.export_aim(table, belief, rig, args.robot, note=args.note or "")
        print(f"{args.robot}: aim file; {check}", file=sys.stderr)
    if args.picture:
        from truearc.sim.report import make_png
        save_whole(args.picture, make_png(table.plot()))
    return 0


def _numbers(text: str, separator: str) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, text.split(separator)))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not numbers with {separator!r} between them") from error
    if not all(map(math.isfinite, numbers)):
        raise argparse.ArgumentTypeError(f"got {text}; expected finite numbers")
    return numbers


class Distances(tuple[float, ...]):
    """Distances in m; `unit`: in which they were stated, and are printed."""

    unit = "m"


def parse_distances(text: str) -> Distances:
    """Distances of a list or of LOW:HIGH:STEP; a length's unit may follow the last number."""
    stated = UNIT.fullmatch(text)
    if stated is None:
        return Distances(_listed_or_stepped(text))
    lengths = {"m": 1.0, **CONVERTED["m"]}
    if stated[2] not in lengths:
        raise argparse.ArgumentTypeError(f"got the unit {stated[2]!r}; expected one of {', '.join(lengths)}")
    found = Distances(lengths[stated[2]] * number for number in _listed_or_stepped(stated[1]))
    found.unit = stated[2]
    return found


def _listed_or_stepped(text: str) -> tuple[float, ...]:
    if ":" not in text:
        return _numbers(text, ",")
    numbers = _numbers(text, ":")
    if len(numbers) != 3 or numbers[2] <= 0.0 or not 0.0 < numbers[0] <= numbers[1]:
        raise argparse.ArgumentTypeError(f"got {text}; expected LOW:HIGH:STEP, ascending and above 0, such as 2:7:0.25")
    low, high, step = numbers
    count = int((high - low) / step + 1e-9) + 1
    if count > MOST:
        raise argparse.ArgumentTypeError(f"got {count} distances; at most {MOST} are possible")
    return tuple(low + step * index for index in range(count))


def _span(text: str) -> tuple[float, float]:
    numbers = _numbers(text, ":")
    if len(numbers) != 2 or not numbers[0] <= numbers[1]:
        raise argparse.ArgumentTypeError(f"got {text}; expected LOW:HIGH such as 30:54")
    return numbers[0], numbers[1]
