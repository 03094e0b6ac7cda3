"""truearc discover: where recordings and simulation disagree, and what recordings could tell at all."""

import argparse
import os
import platform
from pathlib import Path

import jax

from truearc.cli.progress import make_progress
from truearc.cli.terms_from import add_terms_from, catalogue_of
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, load_dataset, load_rig
from truearc.sim.discover.adopt import make_belief
from truearc.sim.discover.api import FALSE_ALARM, Investigation, discover
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.model.design_columns import check_believed
from truearc.sim.discover.model.external_measurements import read_measured
from truearc.sim.discover.plan.expected_information import foresee, foresee_dataset
from truearc.sim.discover.plan.identifiability import Sight, make_sight
from truearc.sim.discover.plan.planned_season import LEVELS, SHOTS
from truearc.sim.discover.report.finding_text import console_lines, too_little
from truearc.sim.discover.report.html_report import make_report
from truearc.sim.discover.report.identifiability_report import make_sight_page, sight_lines
from truearc.sim.infer.belief import load_belief, save_belief
from truearc.sim.physics.catalogue import Catalogue

DESCRIPTION = """Say whether a dataset disagrees with the simulation as it stands, where, and what the simulation lacks.
With --identifiability: say, before any data, which effects a season with a rig could show, and which it could not tell
apart."""
EXAMPLE = "truearc discover shots/ --believe gravity,drag --json finding.json --report finding.html"
KEPT_S = 0.3                          # what compiles faster is not kept
LEVEL = "L0"
RAREST = 0.002                        # alarm that a p of at least 1 in 1000 can tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("dataset", metavar="DIR", nargs="?", help="dataset directory")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated; else rig.toml's")
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml of this very rig from an earlier session "
                        "(discover --adopt, fit --method ml): what is believed, with its doubts; what has changed?")
    parser.add_argument("--since", metavar="DIR", help="dataset that --belief was adopted from: what the belief leaves "
                        "over there already is no change; tracks see that, and telemetry at times")
    add_terms_from(parser)
    parser.add_argument("--measured", metavar="TERM=VALUE,SD", action="append", default=[], help="what was measured of "
                        "a term without a shot, with its standard deviation, in the term's unit; may come often")
    parser.add_argument("--json", metavar="FILE", help="write the finding as JSON")
    parser.add_argument("--report", metavar="FILE", help="write an HTML report")
    parser.add_argument("--false-alarm", type=float, default=FALSE_ALARM, metavar="P",
                        help="how often to cry wolf where there is none (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of everything drawn at random (default %(default)s)")
    parser.add_argument("--adopt", metavar="FILE", help="write what was fitted and named as coefficients, for predict, "
                        "synth and train")
    before = parser.add_argument_group("before any data")
    before.add_argument("--identifiability", metavar="RIG", help="rig.toml: a season of shots is planned for it; or a "
                        "dataset directory: its own shots, with or without results")
    before.add_argument("--shots", type=int, metavar="N", help=f"shots of a planned season (default {SHOTS})")
    before.add_argument("--level", choices=LEVELS, help=f"what is recorded of them: outcomes, telemetry too, tracks "
                        f"too (default {LEVEL})")
    before.add_argument("--sides", action="store_true", help="high or low is noted of every miss")


def main(args: argparse.Namespace) -> int:
    """0 whether or not something was found."""
    if not RAREST <= args.false_alarm < 1.0:
        raise InputError(f"--false-alarm: {args.false_alarm} is not between {RAREST} (rarer alarms would take more "
                         f"draws "
                       "than are made) and 1")
    if args.seed < 0:
        raise InputError(f"--seed: {args.seed} is negative")
    among = catalogue_of(args)
    believed = believed_terms(args, among)
    _check_modes(args)
    for path in (args.json, args.report, args.adopt):
        check_place(path)
    keep_compiled()
    if args.identifiability is not None:
        return _identify(args, believed, among)
    belief = None if args.belief is None else load_belief(args.belief, among)
    dataset = load_dataset(args.dataset)
    found = discover(dataset, believed, args.false_alarm, args.seed, make_progress("discover", args.quiet), belief,
                     home_of(args, dataset), read_measured(args.measured, "--measured", among), among)
    adopted = [adopt(found, args.dataset, args.adopt)] if args.adopt else []
    tell(found, Path(args.dataset).name, args.json, args.report)
    print(*adopted, sep="\n", end="\n" if adopted else "")
    return 0


def home_of(args: argparse.Namespace, later: Dataset) -> Dataset | None:
    """The dataset that --since names; InputError for one of another rig."""
    if args.since is None:
        return None
    home = load_dataset(args.since)
    if (home.facts.ball, home.facts.launcher) != (later.facts.ball, later.facts.launcher):
        raise InputError(f"--since: {args.since}: was recorded with another rig ([ball] or [launcher] differs)")
    return home


def believed_terms(args: argparse.Namespace, among: Catalogue) -> list[str] | None:
    """What --believe names; InputError where it names nothing, or --belief does, or --since stands without that."""
    if args.since is not None and args.belief is None:
        raise InputError("--since goes with --belief, which was adopted from that dataset")
    if args.belief is not None and args.believe is not None:
        raise InputError("--belief and --believe exclude each other: the file names its terms")
    believed = None if args.believe is None else [name.strip() for name in args.believe.split(",") if name.strip()]
    if believed == []:
        raise InputError("--believe: names no term")
    try:
        check_believed(believed or (), among)
    except InputError as error:
        raise InputError(f"--believe: {error}") from error
    return believed


def tell(found: Investigation, name: str, json_path: str | Path | None, report_path: str | Path | None) -> None:
    """Write the answer about the dataset called `name` where asked, and print it: last, for its reader may be gone."""
    if json_path:
        write_out(json_path, make_json(found.finding))
    if report_path:
        write_out(report_path, make_report(name, found).encode())
    print("\n".join(console_lines(found.finding, found.catalogue)))


def adopt(found: Investigation, dataset: str, path: str) -> str:
    """Write the belief that the finding leads to; a line that says what it has."""
    try:
        belief, provenance = make_belief(found)
    except ValueError as error:
        raise InputError(f"--adopt: {dataset}: {error}") from error
    save_belief(path, belief, {"dataset": str(dataset), **provenance})
    vague = too_little(found.finding.also)
    named = [f"{name} (as fitted, though too little to be named)" if name in vague else name
             for name in provenance["adopted"]]
    but = f" (not all: {provenance['refused']})" if "refused" in provenance else ""
    what = f"the average of {', '.join(named)}" if provenance["averaged"] else ", ".join(named)
    return f"adopted: {what or 'nothing named, the fitted coefficients alone'}{but} -> {path}"


def keep_compiled() -> None:
    """Keep compiled code among the user's caches, so that only a machine's first run compiles; else do nothing.

    Where the user has chosen a place for it (JAX_COMPILATION_CACHE_DIR), that one is used. Code of one machine is not
    for another, hence its name.
    """
    if jax.config.values["jax_compilation_cache_dir"]:
        return
    try:
        folder = Path.home() / ".cache" / "truearc" / f"xla-{platform.node() or 'here'}"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", KEPT_S)


def _check_modes(args: argparse.Namespace) -> None:
    """Either data or a forecast of data; options that would not be heeded are refused."""
    if (args.dataset is None) == (args.identifiability is None):
        raise InputError("give either a dataset directory, or --identifiability with a rig.toml or a directory")
    if args.identifiability is None and (args.shots is not None or args.level is not None or args.sides):
        raise InputError("--shots, --level and --sides are for --identifiability")
    if args.identifiability is not None and (args.belief is not None or args.adopt is not None):
        raise InputError("--belief and --adopt are for data, not for --identifiability")
    if args.identifiability is not None and Path(args.identifiability).is_dir() and (
            args.shots is not None or args.level is not None):
        raise InputError(f"--shots, --level: {args.identifiability} is a directory, whose own shots are looked at")


def _identify(args: argparse.Namespace, believed: list[str] | None, among: Catalogue) -> int:
    path = Path(args.identifiability)
    progress = make_progress("identifiability", args.quiet)
    if path.is_dir():
        dataset = load_dataset(path)
        sight = foresee_dataset(dataset, _terms(dataset.facts, believed), args.sides, args.seed, progress, among)
    else:
        facts = load_rig(path)
        shots = SHOTS if args.shots is None else args.shots
        try:
            sight = foresee(facts, _terms(facts, believed), args.level or LEVEL, shots, args.sides, args.seed, progress,
                            among)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    _tell_sight(sight, path.name, args, among)
    return 0


def _terms(facts: Rig, believed: list[str] | None) -> tuple[str, ...]:
    return tuple(facts.believe.terms if believed is None else believed)


def _tell_sight(sight: Sight, name: str, args: argparse.Namespace, among: Catalogue) -> None:
    print("\n".join(sight_lines(sight, among)))
    if args.json:
        write_out(args.json, make_sight(sight))
    if args.report:
        write_out(args.report, make_sight_page(name, sight, among).encode())


def check_place(path: str | None) -> None:
    """InputError where an answer could not be written, before it is worked out."""
    if path is not None and not Path(path).resolve().parent.is_dir():
        raise InputError(f"{path}: there is no such directory to write to")


def write_out(path: str | Path, data: bytes) -> None:
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
