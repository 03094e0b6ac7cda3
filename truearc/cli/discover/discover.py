"""truearc discover: where recordings and simulation disagree."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from truearc.cli.terms_from import add_terms_from, catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.discover.settings import FALSE_ALARM, LEAST_FALSE_ALARM

if TYPE_CHECKING:
    from truearc.sim.data.dataset import Dataset
    from truearc.sim.discover.api import Investigation
    from truearc.sim.physics.catalogue import Catalogue

DESCRIPTION = """Report whether a dataset disagrees with the simulation as it stands, where, and what the simulation
lacks. Before there are data, `truearc identifiability` reports what a season of shots could show."""
EXAMPLE = "truearc discover shots/ --believe gravity,drag --json finding.json --report finding.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated; else rig.toml's")
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml of this very rig from an earlier session "
                        "(discover --adopt, fit): the baseline, with its uncertainties; what has changed?")
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
                        "paper synth and train")


def main(args: argparse.Namespace) -> int:
    """Return 0 whether or not something was found."""
    from truearc.cli.progress import make_progress
    from truearc.sim.compile_cache import keep_compiled
    from truearc.sim.data.dataset import load_dataset
    from truearc.sim.discover.api import discover
    from truearc.sim.discover.model.external_measurements import read_measured
    from truearc.sim.infer.belief import load_belief
    if not LEAST_FALSE_ALARM <= args.false_alarm < 1.0:
        raise InputError(f"--false-alarm: {args.false_alarm} is not between {LEAST_FALSE_ALARM} (rarer alarms would "
                         "take more draws than are made) and 1")
    if args.seed < 0:
        raise InputError(f"--seed: {args.seed} is negative")
    among = catalogue_of(args)
    believed = believed_terms(args, among)
    for path in (args.json, args.report, args.adopt):
        check_place(path)
    keep_compiled()
    belief = None if args.belief is None else load_belief(args.belief, among)
    dataset = load_dataset(args.dataset)
    found = discover(dataset, believed, args.false_alarm, args.seed, make_progress("discover", args.quiet), belief,
                     home_of(args, dataset), read_measured(args.measured, "--measured", among), among)
    adopted = [adopt(found, args.dataset, args.adopt)] if args.adopt else []
    tell(found, Path(args.dataset).name, args.json, args.report)
    print(*adopted, sep="\n", end="\n" if adopted else "")
    return 0


def home_of(args: argparse.Namespace, later: "Dataset") -> "Dataset | None":
    """The dataset that --since names; InputError for one of another rig."""
    if args.since is None:
        return None
    from truearc.sim.data.dataset import load_dataset
    home = load_dataset(args.since)
    if (home.facts.ball, home.facts.launcher) != (later.facts.ball, later.facts.launcher):
        raise InputError(f"--since: {args.since}: was recorded with another rig ([ball] or [launcher] differs)")
    return home


def believed_terms(args: argparse.Namespace, among: "Catalogue") -> list[str] | None:
    """What --believe names; InputError where it names nothing, or --belief does, or --since stands without that."""
    if args.since is not None and args.belief is None:
        raise InputError("--since goes with --belief, which was adopted from that dataset")
    if args.belief is not None and args.believe is not None:
        raise InputError("--belief and --believe exclude each other: the file names its terms")
    return parse_terms(args.believe, among)


def parse_terms(text: str | None, among: "Catalogue") -> list[str] | None:
    """The terms in the text of --believe; None where it was not given, InputError for a term that does not exist."""
    from truearc.sim.discover.model.design_columns import check_believed
    believed = None if text is None else [name.strip() for name in text.split(",") if name.strip()]
    if believed == []:
        raise InputError("--believe: names no term")
    try:
        check_believed(believed or (), among)
    except InputError as error:
        raise InputError(f"--believe: {error}") from error
    return believed


def tell(found: "Investigation", name: str, json_path: str | Path | None, report_path: str | Path | None) -> None:
    """Write the answer about the dataset called `name` where asked, and print it: last, for its reader may be gone."""
    from truearc.sim.discover.finding import make_json
    from truearc.sim.discover.report.finding_text import console_lines
    from truearc.sim.discover.report.html_report import make_report
    if json_path:
        write_out(json_path, make_json(found.finding))
    if report_path:
        write_out(report_path, make_report(name, found).encode())
    print("\n".join(console_lines(found.finding, found.catalogue)))


def adopt(found: "Investigation", dataset: str, path: str) -> str:
    """Write the belief that the finding leads to; a line that says what it has."""
    from truearc.sim.discover.adopt import make_belief
    from truearc.sim.discover.report.finding_text import too_little
    from truearc.sim.infer.belief import save_belief
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


def check_place(path: str | None) -> None:
    """InputError where an answer could not be written, before it is worked out."""
    if path is not None and not Path(path).resolve().parent.is_dir():
        raise InputError(f"{path}: there is no such directory to write to")


def write_out(path: str | Path, data: bytes) -> None:
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
