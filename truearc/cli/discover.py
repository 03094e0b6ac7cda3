"""The commands for inference from shots: `fit`, `predict`, `discover`, `design` and `identifiability`."""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import truearc as ta
from truearc.cli import common
from truearc.errors import about
from truearc.sim.discover import finding as settings
from truearc.sim.printed import Progress, part_of

# --- fit and predict

LONG = 50_000                         # shots that take over two seconds: progress is shown


def fit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", metavar="DIR", nargs="+", help="dataset of shots; several, of sessions or rigs, "
                        "are pooled: what they have in common, and by how much they differ")
    parser.add_argument("-o", "--out", type=common.out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", type=common.listed(str), metavar="NAMES",
                        help="terms to fit, comma-separated (default: [believe] of rig.toml)")
    common.add_terms_from(parser)
    common.add_accept(parser)
    parser.add_argument("--seed", type=common.number(int, 0), help="seed of pooling (default 0)")


def fit(args: argparse.Namespace) -> int:
    """Fit coefficients and shot-to-shot scatter by maximum a posteriori, from all data of a dataset.

    Report 90 % intervals and which parameters the shots cannot separate. The paper's grid search is `truearc paper
    fit`. Exit 1 if the fit did not converge.
    """
    if len(args.datasets) > 1:
        return _pool(args)
    common.refuse(args, ("--seed",), "applies with several datasets only")
    fit = _fit(args, args.datasets[0], common.make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        return _refuse_unsettled(args.datasets[0])
    if args.out is not None:
        fit.belief.save(args.out)
    return 0


def _fit(args: argparse.Namespace, path: str, progress: Progress) -> "ta.Fit":
    from truearc.api.arguments import names_of
    dataset = ta.load_dataset(path)
    among, where = common.catalogue_of(args), "--terms" if args.terms else f"{path}/rig.toml: believe.terms"
    terms = names_of(args.terms or dataset.rig.believe.terms, where, among)
    return ta.fit(dataset, among.find(terms or ()), accept=args.accept, progress=progress)


def _refuse_unsettled(path: str) -> int:
    print(f"truearc fit: {path}: the search for the most probable parameters did not settle: shots or rig.toml "
          "contradict each other (see truearc check), or fewer terms are enough; nothing is written", file=sys.stderr)
    return 1


def _pool(args: argparse.Namespace) -> int:
    fits, progress = [], common.make_progress("fit", args.quiet)
    for done, path in enumerate(args.datasets):
        fits.append(_fit(args, path, part_of(progress, done / len(args.datasets), 1.0 / len(args.datasets))))
        if not fits[-1].converged:
            return _refuse_unsettled(path)
    pooled = ta.pool(fits, seed=args.seed or 0)
    print(pooled)
    if args.out is not None:
        pooled.belief.save(args.out)
    return 0


def predict_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots (rig.toml and shots.csv or .parquet)")
    parser.add_argument("--gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--cd", type=common.number(float, 0.0), help="drag coefficient of the paper's Eq. 3")
    parser.add_argument("--cl", type=common.number(float), help="lift coefficient of the paper's Eq. 2")
    parser.add_argument("--coefficients", metavar="FILE", help="coefficients.toml, instead of --cd and --cl")
    parser.add_argument("--tracks", type=common.number(float, 0.0, 1.0), nargs="?", const=0.0, metavar="SHARE",
                        help="forecast flights: from the first SHARE of each track's samples (default 0: from settings "
                        "alone)")
    common.add_terms_from(parser)
    common.add_accept(parser)
    parser.add_argument("-o", "--out", type=common.out_file, metavar="FILE",
                        help="CSV to write instead of standard output")


def predict(args: argparse.Namespace) -> int:
    """Forecast the height and outcome of each shot of a dataset by the simulation, or its probabilities by a gate.

    By the simulation: shot_id,height_m,deviation_m,outcome,note: the height at the first crossing of x = distance, and
    its difference from the target's centre; both are empty if the ball hits the floor or turns back first. Of a target
    that faces up: shot_id,along_m,across_m,angle_deg,outcome,side,note: where it comes down from the centre. The note
    says so, and names settings outside the range of the shots that the coefficients were fitted to. With --gate:
    shot_id,p_two,p_three,in_domain,novelty (novelty over 1: outside the recorded shots).

    With --tracks: shot_id,t_s,x_m,y_m,z_m,x_band_m,y_band_m,z_band_m: where the ball will be, with half the width of
    each 90 % interval. --tracks: from settings, every 0.02 s from release to the plane or the floor. --tracks 0.4: from
    the first part of each track, at the times of its other samples. --tracks 1: from a whole one, on to the floor.
    """
    if args.tracks is not None:
        common.refuse(args, ("--gate",), "does not apply with --tracks")
        table = ta.predict(_plausible(args), _belief(args), tracks=args.tracks, accept=args.accept)
        table = ta.Table(table.columns, tuple((name, *(common.fixed(one, 6) for one in numbers))
                                              for name, *numbers in table.rows))
    elif args.gate is None:
        table = _by_simulation(args)
    else:
        common.refuse(args, ("--cd", "--cl", "--coefficients", "--terms-from"), "does not apply with --gate")
        table = ta.predict(_plausible(args), gate=args.gate, accept=args.accept)
    common.print_or_write(args.out, table.to_csv())
    return 0


def _plausible(args: argparse.Namespace) -> "ta.Dataset":
    """Return the dataset; what is accepted or only warns is on stderr, as the table goes to stdout."""
    dataset = ta.paper.check_plausible(ta.load_dataset(args.dataset), args.accept)
    for objection in dataset.accepted:
        print(f"warning: {objection}", file=sys.stderr)
    return dataset


def _by_simulation(args: argparse.Namespace) -> "ta.Table":
    belief = _belief(args)
    dataset = _plausible(args)
    forecast = ta.predict(dataset, belief, accept=args.accept,
                          progress=common.make_progress("predict", args.quiet or len(dataset.shots) < LONG))
    rows = tuple((name, *(cell if isinstance(cell, str) else common.fixed(cell, 9) for cell in cells))
                 for name, *cells in forecast.rows)
    if noted := sum(note != "" for *_, note in rows):
        print(f"{noted} of {len(rows)} forecasts have a note: outside the fitted range, of another rig, or without a "
              "height", file=sys.stderr)
    return ta.Table(forecast.columns, rows)


def _belief(args: argparse.Namespace) -> "ta.Belief":
    """Return the belief of the file or of both options; InputError when neither or both are given."""
    if args.coefficients is not None:
        if (args.cd, args.cl) != (None, None):
            raise ta.InputError("--coefficients and --cd, --cl exclude each other")
        return ta.load_belief(args.coefficients, common.catalogue_of(args))
    common.refuse(args, ("--terms-from",), "applies with --coefficients only, whose file names the terms")
    for option, value in (("--cd", args.cd), ("--cl", args.cl)):
        if value is None:
            raise ta.InputError(f"{option} is needed (or --coefficients FILE)")
    from truearc.sim.infer.belief import point_belief
    return point_belief({"drag": {"cd": args.cd}, "magnus": {"cl": args.cl}})


# --- what the simulation lacks

LIKELY = 0.1                          # probability of a name, from which it is compared with its measurement
FAR = 4.0                             # standard deviations by which they contradict each other


def discover_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset directory; with --system a table of runs (CSV)")
    parser.add_argument("--system", metavar="FILE.py", help="Python file that defines `system` (truearc.System) and "
                        "`columns` ({run, time, inputs, conditions}, as truearc.Runs takes them): test that simulator")
    add_baseline(parser)
    parser.add_argument("--measured", metavar="TERM=VALUE,SD", action="append", default=[], help="what was measured of "
                        "a term without a shot, with its standard deviation, in the term's unit; may come often")
    add_reports(parser)
    parser.add_argument("--adopt", type=common.out_file, metavar="FILE", help="write what was fitted and named as "
                        "coefficients, for predict, paper synth and train")


def add_reports(parser: argparse.ArgumentParser) -> None:
    """Add options for the files of an answer, to discover and identifiability."""
    parser.add_argument("--json", type=common.out_file, metavar="FILE", help="write the answer as JSON")
    parser.add_argument("--report", type=common.out_file, metavar="FILE", help="write an HTML report")


def _write_reports(args: argparse.Namespace, answer: "ta.Finding | ta.Identifiability") -> None:
    """Write the files of `add_reports`."""
    common.write_out(args.json, answer.to_json())
    if args.report:
        origin = common.origin_of(args)
        answer.to_html(args.report, made_at=origin.made_at, command=origin.command)


def add_believe(parser: argparse.ArgumentParser) -> None:
    """Add options that choose the terms, to discover, design and identifiability."""
    parser.add_argument("--believe", type=common.listed(str), metavar="TERMS",
                        help="terms of the simulation, comma-separated; else rig.toml's")
    common.add_terms_from(parser)
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="of everything drawn at random")


def add_baseline(parser: argparse.ArgumentParser) -> None:
    """Add options that say what is tested, and how, to discover and design."""
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

    Before you have data, `truearc identifiability` reports what a season of shots could show. With --system the
    simulator is your own, and the table has its runs.
    """
    if args.system is not None:
        return _discover_system(args)
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


def _discover_system(args: argparse.Namespace) -> int:
    """Answer for a simulator of the user's own."""
    common.refuse(args, ("--believe", "--terms-from", "--belief", "--since", "--accept", "--measured", "--adopt"),
                  "does not apply with --system")
    settings.check_chances(args.false_alarm, args.seed, ("--false-alarm", "--seed"))
    from truearc.sim.compute import keep_compiled
    from truearc.sim.systems.files import load_runs, load_system
    keep_compiled()
    system, columns = load_system(args.system)
    runs = load_runs(args.dataset, columns)
    found = ta.discover(system, runs, seed=args.seed, false_alarm=args.false_alarm,
                        progress=common.make_progress("discover", args.quiet))
    common.write_out(args.json, found.to_json())
    if args.report:
        origin = common.origin_of(args)
        found.to_html(args.report, made_at=origin.made_at, command=origin.command)
    print(found)
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
    """Return the dataset and the finding in it, by the options of `add_baseline`; measured: as in --measured."""
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
    from truearc.sim.discover.report.story import say_adopted
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
    parser.add_argument("--json", type=common.out_file, metavar="FILE", help="write the plan as JSON")


def design(args: argparse.Namespace) -> int:
    """Choose the next shots, or the measurement, that would best separate the remaining candidate terms.

    Candidates are the terms that `truearc discover` leaves; the shots are ones that the robot can take. Also report how
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
    """Report, before any data, which effects a season with a rig could show, and which it could not separate."""
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
