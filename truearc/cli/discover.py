"""Commands about what the simulation lacks: `discover`, `design`, `identifiability`."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import truearc as ta
from truearc.cli import common
from truearc.cli.outputs import out_file
from truearc.errors import about
from truearc.sim.discover import finding as settings

LIKELY = 0.1                          # probability of a name, from which it is compared with its measurement
FAR = 4.0                             # standard deviations by which they contradict each other


def discover_options(parser: argparse.ArgumentParser) -> None:
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


def _write_reports(args: argparse.Namespace, answer: "ta.Finding | ta.Identifiability") -> None:
    """Write the files of `add_reports`."""
    common.write_out(args.json, answer.to_json())
    if args.report:
        origin = common.origin_of(args)
        answer.to_html(args.report, made_at=origin.made_at, command=origin.command)


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
    parser.add_argument("--false-alarm", type=float, default=settings.FALSE_ALARM, metavar="P",
                        help="probability of a finding where nothing is missing")


def discover(args: argparse.Namespace) -> int:
    """Report whether a dataset disagrees with the simulation as it stands, where, and what the simulation lacks.

    Before there are data, `truearc identifiability` reports what a season of shots could show.
    """
    _, found = investigate(args, "discover", args.measured)
    adopted, refused = None, None
    try:
        adopted = _adopt(found, args.dataset, args.adopt) if args.adopt else None
    except ta.InputError as error:
        refused = error
    _write_reports(args, found)
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
    settings.check_chances(args.false_alarm, args.seed, ("--false-alarm", "--seed"))
    if args.since is not None and args.belief is None:
        raise ta.InputError("--since goes with --belief, which was adopted from that dataset")
    if args.belief is not None and args.believe is not None:
        raise ta.InputError("--belief and --believe exclude each other: the file names its terms")


def investigate(args: argparse.Namespace, what: str, measured: Sequence[str] = ()) -> "tuple[ta.Dataset, ta.Finding]":
    """The dataset and the finding in it, by the options of `add_baseline`; measured: as in --measured."""
    _check(args)
    from truearc.sim.compute import keep_compiled
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


def design_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    add_baseline(parser)
    parser.add_argument("--shots", type=common.number(int, 1), default=settings.PLANNED_SHOTS, metavar="N",
                        help="shots to plan")
    parser.add_argument("--configurations", type=common.number(int, 1), default=settings.CONFIGURATIONS, metavar="K",
                        help="that they are shared out to")
    parser.add_argument("--json", type=out_file, metavar="FILE", help="write the plan as JSON")


def design(args: argparse.Namespace) -> int:
    """Choose the next shots, or the measurement, that would best tell the remaining candidate terms apart.

    Candidates are the terms that `truearc discover` leaves; the shots are some that the robot can take. Say, too, how
    likely they are to decide.
    """
    if args.configurations > args.shots:
        raise ta.InputError(f"--shots {args.shots}, --configurations {args.configurations}: at least one shot each")
    dataset, found = investigate(args, "design")
    plan = ta.design_shots(dataset, found, shots=args.shots, configurations=args.configurations, seed=args.seed)
    print(plan)
    common.write_out(args.json, plan.to_json())
    return 0


def identifiability_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", metavar="RIG", help="rig.toml: a season of shots is planned for it; or a dataset "
                        "directory: its own shots, with or without results")
    add_believe(parser)
    add_reports(parser)
    common.add_accept(parser)
    parser.set_defaults(seed=None)
    parser.add_argument("--shots", type=common.number(int, 1), metavar="N",
                        help=f"shots of a planned season (default {settings.SEASON_SHOTS})")
    parser.add_argument("--level", choices=settings.LEVELS, help="what is recorded of them: outcomes, telemetry too, "
                        f"tracks too (default {settings.LEVEL})")
    parser.add_argument("--sides", action="store_true", help="high or low is noted of every miss")


def identifiability(args: argparse.Namespace) -> int:
    """Say, before any data, which effects a season with a rig could show, and which it could not tell apart."""
    path = Path(args.rig)
    if path.is_dir():
        common.refuse(args, ("--shots", "--level"), f"{path} is a dataset directory, whose own shots are used")
    from truearc.sim.compute import keep_compiled
    keep_compiled()
    source = ta.load_dataset(path) if path.is_dir() else ta.load_rig(path)
    with about(str(path if path.is_dir() else path.parent)):
        answer = ta.identifiability(source, level=args.level, shots=args.shots, believe=args.believe,
                                    terms=common.catalogue_of(args), sides=args.sides, seed=args.seed, name=path.name,
                                    accept=args.accept, progress=common.make_progress("identifiability", args.quiet))
    _write_reports(args, answer)
    print(answer)                     # last: whoever reads it may be gone
    return 0
