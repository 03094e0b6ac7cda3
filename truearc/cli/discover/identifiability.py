"""truearc identifiability: which effects a season of shots could show, before there are any data."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from truearc.cli.discover.discover import check_place, parse_terms, write_out
from truearc.cli.options import refuse
from truearc.cli.terms_from import add_terms_from, catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.discover.settings import LEVEL, LEVELS, SEASON_SHOTS

if TYPE_CHECKING:
    from truearc.robot.config.rig_spec import Rig
    from truearc.sim.discover.plan.identifiability import Sight
    from truearc.sim.physics.catalogue import Catalogue

DESCRIPTION = """Report which effects a season of shots with a rig could show and which it could not tell apart, before
any shot is recorded; or what the shots of a dataset can show, with or without their results."""
EXAMPLE = "truearc identifiability rig.toml --level L1 --shots 300 --report identifiability.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", metavar="RIG", help="rig.toml: a season of shots is planned for it; or a dataset "
                        "directory: its own shots are used")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated (default: "
                        "rig.toml's)")
    add_terms_from(parser)
    parser.add_argument("--shots", type=int, metavar="N", help=f"shots of a planned season (default {SEASON_SHOTS})")
    parser.add_argument("--level", choices=LEVELS, help="what a planned season records: outcomes (L0), telemetry too "
                        f"(L1), tracks too (L2) (default {LEVEL})")
    parser.add_argument("--sides", action="store_true", help="high or low is noted of every miss")
    parser.add_argument("--json", metavar="FILE", help="write the answer as JSON")
    parser.add_argument("--report", metavar="FILE", help="write an HTML report")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything drawn at random (default %(default)s)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the answer is written."""
    from truearc.sim.compile_cache import keep_compiled
    if args.seed < 0:
        raise InputError(f"--seed: {args.seed} is negative")
    among = catalogue_of(args)
    believed = parse_terms(args.believe, among)
    for path in (args.json, args.report):
        check_place(path)
    if Path(args.rig).is_dir():
        refuse(args, ("--shots", "--level"), f"{args.rig} is a dataset directory, whose own shots are used")
    keep_compiled()
    _tell(_predict(args, believed, among), args, among)
    return 0


def _predict(args: argparse.Namespace, believed: list[str] | None, among: "Catalogue") -> "Sight":
    from truearc.cli.progress import make_progress
    from truearc.sim.data.dataset import load_dataset, load_rig
    from truearc.sim.discover.plan.expected_information import foresee, foresee_dataset
    path, progress = Path(args.rig), make_progress("identifiability", args.quiet)
    if path.is_dir():
        dataset = load_dataset(path)
        return foresee_dataset(dataset, _terms(dataset.facts, believed), args.sides, args.seed, progress, among)
    rig = load_rig(path)
    shots = SEASON_SHOTS if args.shots is None else args.shots
    try:
        return foresee(rig, _terms(rig, believed), args.level or LEVEL, shots, args.sides, args.seed, progress,
                       among)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _terms(rig: "Rig", believed: list[str] | None) -> tuple[str, ...]:
    return tuple(rig.believe.terms if believed is None else believed)


def _tell(sight: "Sight", args: argparse.Namespace, among: "Catalogue") -> None:
    from truearc.sim.discover.plan.identifiability import make_sight
    from truearc.sim.discover.report.identifiability_report import make_sight_page, sight_lines
    print("\n".join(sight_lines(sight, among)))
    if args.json:
        write_out(args.json, make_sight(sight))
    if args.report:
        write_out(args.report, make_sight_page(Path(args.rig).name, sight, among).encode())
