"""truearc identifiability: what recordings could show, before there are any."""

import argparse
from pathlib import Path

import truearc as ta
from truearc.cli.files import check_place, names_in, write_out
from truearc.cli.arguments import refuse
from truearc.cli.progress import make_progress
from truearc.cli.arguments import add_terms_from, catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.discover.settings import LEVEL, LEVELS, SEASON_SHOTS

DESCRIPTION = """Say, before any data, which effects a season with a rig could show, and which it could not tell
apart."""
EXAMPLE = "truearc identifiability rig.toml --level L1 --shots 300 --report sight.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("rig", metavar="RIG", help="rig.toml: a season of shots is planned for it; or a dataset "
                        "directory: its own shots, with or without results")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated; else rig.toml's")
    add_terms_from(parser)
    parser.add_argument("--json", metavar="FILE", help="write the answer as JSON")
    parser.add_argument("--report", metavar="FILE", help="write an HTML report")
    parser.add_argument("--seed", type=int, default=0, help="of everything drawn at random (default %(default)s)")
    parser.add_argument("--shots", type=int, metavar="N", help=f"shots of a planned season (default {SEASON_SHOTS})")
    parser.add_argument("--level", choices=LEVELS, help=f"what is recorded of them: outcomes, telemetry too, tracks "
                        f"too (default {LEVEL})")
    parser.add_argument("--sides", action="store_true", help="high or low is noted of every miss")


def main(args: argparse.Namespace) -> int:
    """Return 0, whatever could be seen."""
    path = Path(args.rig)
    if args.seed < 0:
        raise InputError(f"--seed: {args.seed} is negative")
    if path.is_dir():
        refuse(args, ("--shots", "--level"), f"{path} is a dataset directory, whose own shots are used")
    believe = names_in("--believe", args.believe)
    for place in (args.json, args.report):
        check_place(place)
    from truearc.sim.compile_cache import keep_compiled
    keep_compiled()
    source = ta.load_dataset(path) if path.is_dir() else ta.load_rig(path)
    try:
        answer = ta.identifiability(source, level=args.level, shots=args.shots, believe=believe,
                                    terms=catalogue_of(args), sides=args.sides,
                                    seed=args.seed, name=path.name,
                                    progress=make_progress("identifiability", args.quiet))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    print(answer)
    if args.json:
        write_out(args.json, answer.to_json())
    if args.report:
        answer.to_html(args.report)
    return 0
