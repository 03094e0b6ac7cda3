"""Say, before any data, which effects a season with a rig could show, and which it could not tell apart."""

import argparse
from pathlib import Path

import truearc as ta
from truearc.cli.common import add_accept, catalogue_of, make_progress, number, origin_of, refuse, write_out
from truearc.cli.discover.discover import add_believe, add_reports
from truearc.errors import about
from truearc.sim.discover.finding import LEVEL, LEVELS, SEASON_SHOTS

EXAMPLE = "truearc identifiability rig.toml --level L1 --shots 300 --report sight.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("rig", metavar="RIG", help="rig.toml: a season of shots is planned for it; or a dataset "
                        "directory: its own shots, with or without results")
    add_believe(parser)
    add_reports(parser)
    add_accept(parser)
    parser.set_defaults(seed=None)
    parser.add_argument("--shots", type=number(int, 1), metavar="N",
                        help=f"shots of a planned season (default {SEASON_SHOTS})")
    parser.add_argument("--level", choices=LEVELS, help=f"what is recorded of them: outcomes, telemetry too, tracks "
                        f"too (default {LEVEL})")
    parser.add_argument("--sides", action="store_true", help="high or low is noted of every miss")


def main(args: argparse.Namespace) -> int:
    """Return 0, whatever could be seen."""
    path = Path(args.rig)
    if path.is_dir():
        refuse(args, ("--shots", "--level"), f"{path} is a dataset directory, whose own shots are used")
    from truearc.sim.compile_cache import keep_compiled
    keep_compiled()
    source = ta.load_dataset(path) if path.is_dir() else ta.load_rig(path)
    with about(str(path if path.is_dir() else path.parent)):
        answer = ta.identifiability(source, level=args.level, shots=args.shots, believe=args.believe,
                                    terms=catalogue_of(args), sides=args.sides, seed=args.seed, name=path.name,
                                    accept=args.accept, progress=make_progress("identifiability", args.quiet))
    write_out(args.json, answer.to_json())
    if args.report:
        origin = origin_of(args)
        answer.to_html(args.report, made_at=origin.made_at, command=origin.command)
    print(answer)                     # last: whoever reads it may be gone
    return 0
