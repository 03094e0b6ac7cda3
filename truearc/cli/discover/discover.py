"""Report whether a dataset disagrees with the simulation as it stands, where, and what the simulation lacks.

Before there are data, `truearc identifiability` reports what a season of shots could show.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import truearc as ta
from truearc.cli import common
from truearc.cli.outputs import out_file
from truearc.errors import about
from truearc.sim.discover.finding import FALSE_ALARM, check_chances

LIKELY = 0.1                          # probability of a name, from which it is compared with its measurement
FAR = 4.0                             # standard deviations by which they contradict each other
EXAMPLE = "truearc discover shots/ --believe gravity,drag --json finding.json --report finding.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    add_baseline(parser)
    parser.add_argument("--measured", metavar="TERM=VALUE,SD", action="append", default=[], help="what was measured of "
                        "a term without a shot, with its standard deviation, in the term's unit; may come often")
    add_reports(parser)
    parser.add_argument("--adopt", type=out_file, metavar="FILE", help="write what was fitted and named as "
                        "coefficients, for predict, paper synth and train")


def add_reports(parser: argparse.ArgumentParser) -> None:
    """Options for the files that an answer is written to: of discover and identifiability."""
    parser.add_argument("--json", type=out_file, metavar="FILE", help="write the answer as JSON")
    parser.add_argument("--report", type=out_file, metavar="FILE", help="write an HTML report")


def add_believe(parser: argparse.ArgumentParser) -> None:
    """Options that say which terms there are: of discover, design and identifiability."""
    parser.add_argument("--believe", type=common.listed(str), metavar="TERMS",
                        help="terms of the simulation, comma-separated; else rig.toml's")
    common.add_terms_from(parser)
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="of everything drawn at random")


def add_baseline(parser: argparse.ArgumentParser) -> None:
    """Options that say what is tested, and how: of discover and design."""
    add_believe(parser)
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml of this very rig from an earlier session "
                        "(discover --adopt, fit): the baseline, with its uncertainties; what has changed?")
    parser.add_argument("--since", metavar="DIR", help="dataset that --belief was adopted from: misfit that "
                        "is present there, too, is not evidence of change; tracks show it, and telemetry at times")
    common.add_accept(parser)
    parser.add_argument("--false-alarm", type=float, default=FALSE_ALARM, metavar="P",
                        help="probability of a finding where nothing is missing")


def main(args: argparse.Namespace) -> int:
    """Return 0, whether or not something was found; InputError, after the report, where nothing can be adopted."""
    _, found = investigate(args, "discover", args.measured)
    adopted, refused = None, None
    try:
        adopted = _adopt(found, args.dataset, args.adopt) if args.adopt else None
    except ta.InputError as error:
        refused = error
    common.write_out(args.json, found.to_json())
    if args.report:
        origin = common.origin_of(args)
        found.to_html(args.report, made_at=origin.made_at, command=origin.command)
    print(found)                      # last: whoever reads it may be gone
    for line in _contradicted(found, args.measured):
        print(line)
    if args.measured and found.verdict == "none":
        print("not used: --measured, which weighs names: nothing is missing that would have one")
    if adopted is not None:
        print(adopted)
    if refused is not None:
        raise refused
    return 0


def _contradicted(found: "ta.Finding", measured: Sequence[str]) -> list[str]:
    """A line for each likely name whose fitted size its measurement contradicts."""
    from truearc.sim.infer.likelihood.layout import read_measured
    sizes = {name.partition(".")[0]: size for name, size in read_measured(
        [word for word in measured if word.partition("=")[0] in {one.term for one in found.effects}], "--measured",
        found.investigation.catalogue).items()}
    return [f"warning: --measured {one.term}: {size.value:g} was measured, and these shots say {one.value:.3g} "
            f"{one.unit}: one of both is wrong, or something else is missing"
            for one in found.effects if one.probability >= LIKELY and (size := sizes.get(one.term)) is not None
            and abs(one.value - size.value) > FAR * math.hypot(one.sd, size.sd)]


def _check(args: argparse.Namespace) -> None:
    """InputError where an option's value is unusable, or options exclude each other, before anything is loaded."""
    check_chances(args.false_alarm, args.seed, ("--false-alarm", "--seed"))
    if args.since is not None and args.belief is None:
        raise ta.InputError("--since goes with --belief, which was adopted from that dataset")
    if args.belief is not None and args.believe is not None:
        raise ta.InputError("--belief and --believe exclude each other: the file names its terms")


def investigate(args: argparse.Namespace, what: str, measured: Sequence[str] = ()) -> "tuple[ta.Dataset, ta.Finding]":
    """The dataset and the finding in it, by the options of `add_baseline`; measured: as in --measured."""
    _check(args)
    from truearc.sim.compile_cache import keep_compiled
    from truearc.sim.infer.likelihood.layout import check_believed, read_measured
    among = common.catalogue_of(args)
    with about("--believe"):
        check_believed(args.believe or (), among)
    sizes = read_measured(measured, "--measured", among)
    keep_compiled()
    belief = None if args.belief is None else ta.load_belief(args.belief, among)
    dataset = ta.load_dataset(args.dataset)
    since = None if args.since is None else ta.load_dataset(args.since)
    return dataset, ta.discover(
        dataset, belief=belief, believe=args.believe, terms=among, since=since, seed=args.seed,
        measured={name.partition(".")[0]: size for name, size in sizes.items()}, false_alarm=args.false_alarm,
        accept=args.accept, progress=common.make_progress(what, args.quiet))


def _adopt(found: "ta.Finding", dataset: str, path: Path) -> str:
    """Write the belief that the finding leads to; a line that says what it has."""
    from truearc.sim.discover.report.finding_text import say_adopted
    with about("--adopt"):
        belief = found.adopt()
    replace(belief, provenance={**belief.provenance, "dataset": dataset}).save(path)
    names = {str(name).partition(" ")[0] for name in belief.provenance.get("adopted", ())}
    sizes = [f"{term}.{name} {value:.3g}" for term in sorted(names & set(belief.coefficients))
             for name, value in belief.coefficients[term].items()]
    added = f", with {', '.join(sizes)}" if sizes else ""
    return f"{say_adopted(found.record, belief.provenance)}{added} -> {path}"
