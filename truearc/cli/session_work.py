"""Implementation of `truearc session replay` and `truearc session convert`."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import entry_points
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from truearc.cli.common import catalogue_of, make_progress, refuse, refuse_file
from truearc.errors import EXPORTS, InputError, PluginError, load_plugin, needs, only_point
from truearc.robot.config.schema import load_config
from truearc.robot.gate import load_gate
from truearc.robot.reasons import texts
from truearc.robot.recording import export as exports
from truearc.robot.recording import replay
from truearc.robot.recording.export import NO_FLIGHTS, TRIAL_COLUMNS, ExportRows, Flights, in_target_frame
from truearc.robot.recording.session import TRIALS, load_session_config, load_session_gate
from truearc.robot.recording.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

# --- replay

MOST_KEYS, MOST_FLIPS = 12, 10
NAME, COUNT, TIME, VALUES = 30, 13, 10, 30        # widths of the table's columns, characters


def replay_as_recorded(args: argparse.Namespace) -> int:
    """Recompute with the recording's own configuration and model; return 1 at the first difference."""
    try:
        if args.depth == "frames":
            replayed, again = replay.replay_frames(args.session)
        else:
            replayed, again = replay.replay(args.session), None
    except replay.Difference as difference:
        print(f"{args.session}: {difference}", file=sys.stderr)
        return 1
    print(f"{args.session}: {replayed.ticks} ticks replayed, every output bit-equal")
    if again is not None:
        print(_again(again))
    if replayed.cut_short:
        print(replayed.cut_short, file=sys.stderr)
    return 1 if args.check and (replayed.cut_short or (again is not None and again.missing)) else 0


def _again(again: replay.Recomputed) -> str:
    lines = [f"  {again.frames} CAN frames parsed again, every motor and encoder reading bit-equal",
             f"  {again.seen} images seen again, every sighting bit-equal; {again.taken} sightings are as recorded, "
             "for their images were not kept (the one behind each shot is)",
             "  as recorded, too: button presses, and that a wire was lost or the recording in trouble"]
    if again.missing:
        lines.append(f"  {again.missing} images that the session names, or the index of all, are not there or broken")
    return "\n".join(lines)


def replay_with(args: argparse.Namespace) -> int:
    """Replay the recorded inputs with another configuration or model, and list the outputs that change."""
    recorded = load_session_config(args.session)
    config = recorded if args.config is None else load_config(args.config)
    gate = load_session_gate(args.session) if args.gate is None else load_gate(args.gate)
    if len(config.axes.flywheels) != len(recorded.axes.flywheels):
        raise InputError(f"{args.config}: {len(config.axes.flywheels)} flywheel motors, the recording has "
                       f"{len(recorded.axes.flywheels)}")
    if config.gate.policy == "model" and gate is None:
        raise InputError(f"{args.config}: gate.policy is 'model', and the recording has none: --gate is needed")
    try:
        changes = replay.find_changes(args.session, config, gate)
    except replay.Difference as difference:
        print(f"{args.session}: {difference}", file=sys.stderr)
        return 1
    print(describe_changes(str(args.session), changes, replay.config_changes(recorded, config)))
    return 1 if args.check and (changes.differing or changes.remembering or changes.cut_short) else 0


def describe_changes(session: str, changes: replay.Changes, keys: Sequence[str]) -> str:
    """Describe the keys that differ, which outputs changed, when first and by how much, and the changed verdicts."""
    lines = [f"{session}: {changes.ticks} ticks replayed from the recorded inputs"]
    lines += _shortened([f"  with {key}" for key in keys], MOST_KEYS, "keys")
    if not changes.differing:
        only = f" (what it remembers did, in {changes.remembering} ticks)" if changes.remembering else ""
        lines.append(f"no output changes{only}")
    else:
        lines += ["", f"{changes.differing} ticks come out otherwise. Times are from the recording's start.", "",
                  f"  {'output':{NAME}}{'ticks':{COUNT}}{'first at':{TIME}}{'then: was -> is':{VALUES}}largest change"]
        in_order = sorted(changes.outputs.values(), key=lambda change: (change.first_s, change.name))
        lines += [_line(change, changes.ticks) for change in in_order]
        lines += ["", *_verdicts(changes)]
        lines += ["", "The inputs stay as recorded: what the robot would have sensed after acting otherwise, no replay "
                  "knows.", "Read the first change as it stands, later ones as what it would have wanted."]
    if changes.cut_short:
        lines.append(changes.cut_short)
    return "\n".join(lines)


def _line(change: replay.Change, ticks: int) -> str:
    share = f"{change.ticks} ({change.ticks / ticks:.0%})"
    head = f"  {change.name:{NAME}}{share:{COUNT}}{f'{change.first_s:.2f} s':{TIME}}"
    if isinstance(change.was, list) and isinstance(change.now, list):
        return head + _listed(change.was, change.now)
    values = f"{_word(change.was)} -> {_word(change.now)} {change.unit}".rstrip()
    largest = "" if change.largest is None else (f"{change.largest:.3g} {change.unit}".rstrip()
                                                 + f" at {change.largest_s:.2f} s")
    return f"{head}{values:{VALUES}}{largest}".rstrip()


def _listed(was: list[str], now: list[str]) -> str:
    """Of a list of words: what it says only now, and what it said only then."""
    words = [f"now also: {item}" for item in now if item not in was]
    words += [f"no longer: {item}" for item in was if item not in now]
    return "; ".join(words)


def _verdicts(changes: replay.Changes) -> list[str]:
    if not changes.flips:
        return [f"No verdict changes: {changes.fired} shots then and now."]
    lines = [f"{len(changes.flips)} verdicts change: {changes.fired} shots then, {changes.fires} now."]
    return lines + _shortened([_flip(flip) for flip in changes.flips], MOST_FLIPS, "verdicts")


def _flip(flip: replay.Flip) -> str:
    reasons = "; ".join(texts(flip.reasons))
    if flip.fired:
        return f"  at {flip.t_s:.2f} s it fired, and now holds: {reasons}"
    return f"  at {flip.t_s:.2f} s it held ({reasons}), and now fires"


def _shortened(lines: list[str], most: int, what: str) -> list[str]:
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"  ... and {more} more {what}"]


def _word(value: Value) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


# --- convert: one function per format

GROUP_ROWS = 10_000                   # of a Parquet file
WriteRows = Callable[[tuple[Column, ...], Iterator[list[Value]], Path], None]


def convert(args: argparse.Namespace) -> int:
    """Write the session in the requested format; args: those of `truearc session convert`."""
    if args.session.resolve() in args.out.resolve().parents:
        raise InputError(f"{args.out}: lies in the session that it is made from; a recording is never written over")
    if args.to in ("csv", "parquet"):
        refuse_file(trials_path(args.out), args.force)
    if args.to != "mcap":
        refuse(args, ("--belief", "--terms-from"), "applies with --to mcap only")
    progress = make_progress("convert", args.quiet)
    rows = ExportRows(args.session, progress)
    write = _writer(args)
    try:
        made = write(rows, args.out)
        if rows.count == 0:
            raise InputError(f"{rows.reader.path}: no ticks to convert"
                           + (f" ({rows.reader.cut_short})" if rows.reader.cut_short else ""))
        for path in made:
            _part(path).replace(path)
    finally:
        for path in (args.out, trials_path(args.out)):
            _part(path).unlink(missing_ok=True)
    progress(1.0, f"{rows.count} ticks")
    print(f"{', '.join(map(str, made))}: {rows.count} ticks, {len(rows.trials)} trials")
    for count, what in ((rows.missing, "were missing, and are taken from the telemetry"),
                        (rows.unlike, "are not as the telemetry has them")):
        if count:
            print(f"warning: {args.session / TRIALS}: {count} of {len(rows.trials)} trials {what}: truearc session "
                  f"recover {args.session}", file=sys.stderr)
    if rows.reader.cut_short:
        print(f"{rows.reader.cut_short}; what follows is missing: truearc session recover", file=sys.stderr)
    return 0


def _writer(args: argparse.Namespace) -> Callable[[ExportRows, Path], tuple[Path, ...]]:
    """What writes the format asked for; InputError where its distribution is not installed or is broken."""
    if args.to == "mcap":
        return partial(_to_one_file, partial(_write_mcap, flights=_flights(args)))
    if args.to in FORMATS:
        return FORMATS[args.to]
    try:
        return partial(_to_one_file, load_plugin(only_point(tuple(entry_points(group=EXPORTS, name=args.to)), args.to)))
    except LookupError as error:
        raise InputError(f"--to {args.to}: {needs(args.to)}") from error
    except PluginError as error:
        raise InputError(str(error)) from error


def _to_two_files(write: WriteRows, rows: ExportRows, out: Path) -> tuple[Path, ...]:
    trials = trials_path(out)
    write(rows.columns, iter(rows), _part(out))
    write(TRIAL_COLUMNS, map(exports.trial_row, rows.trials), _part(trials))
    return out, trials


def _write_parquet(columns: tuple[Column, ...], rows: Iterator[list[Value]], path: Path) -> None:
    """One column per name, absent values null; each column's metadata has its unit."""
    try:
        import pyarrow as pa
        from pyarrow.parquet import ParquetWriter
    except ModuleNotFoundError as error:
        raise InputError(f"--to parquet: needs {error.name}, which the robot's base install leaves out: "
                         "pip install 'truearc[sim]'") from error
    types = {FLOAT: pa.float64(), INT: pa.int64(), BOOL: pa.bool_(), TEXT: pa.string(), TEXTS: pa.list_(pa.string()),
             FLOATS: pa.list_(pa.float64())}
    schema = pa.schema([pa.field(column.name, types[column.kind], metadata={"unit": column.unit})
                        for column in columns])
    with ParquetWriter(path, schema) as writer:
        while group := list(islice(rows, GROUP_ROWS)):
            arrays = [pa.array(cells, type=field.type)
                      for cells, field in zip(zip(*group, strict=True), schema, strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


def _to_one_file(write: Callable[[ExportRows, BinaryIO], None], rows: ExportRows, out: Path) -> tuple[Path, ...]:
    with _part(out).open("wb") as file:
        write(rows, file)
    return (out,)


def _write_mcap(rows: ExportRows, file: BinaryIO, flights: Flights) -> None:
    if lost := exports.write_mcap(rows, file, flights):
        print(f"warning: {rows.session}: {lost} images are named but missing", file=sys.stderr)


def _flights(args: argparse.Namespace) -> Flights:
    """The flights of the session's marked shots by --belief, before the target."""
    if args.belief is None:
        refuse(args, ("--terms-from",), "applies with --belief only")
        return NO_FLIGHTS
    try:
        from truearc.sim.compute import keep_compiled
        from truearc.sim.data.dataset import circumstances_of
        from truearc.sim.data.recordings import shots_from_sessions
        from truearc.sim.infer.belief import along, load_belief
        from truearc.sim.infer.likelihood.data import every_column
        from truearc.sim.physics.simulate import trajectories
    except ModuleNotFoundError as error:
        raise InputError(f"--belief: needs {error.name}, which the robot's base install leaves out: "
                         "pip install 'truearc[sim]'") from error
    keep_compiled()
    belief = load_belief(args.belief, catalogue_of(args))
    dataset = shots_from_sessions([args.session], args.session.name)
    what = f"as the belief {args.belief.name} has it from the set points at the feed; not measured"
    if other := belief.other_rig(dataset.rig):
        print(f"warning: {args.belief}: {other}", file=sys.stderr)
        what += f"; {other}"
    around = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    flown = trajectories(dataset.rig, belief.coefficients, dataset.shots, around, belief.catalogue)
    points = {int(shot_id.rpartition("-")[2]): [in_target_frame(distance_m, *place) for place in places.tolist()]
              for shot_id, (places, distance_m) in zip(dataset.shots.shot_id, flown, strict=True)}
    return Flights(points, what, (args.belief,))


def trials_path(out: Path) -> Path:
    """Return the path for the trials: week.csv -> week.trials.csv."""
    return out.with_suffix(".trials" + out.suffix)


def _part(path: Path) -> Path:
    """The name of a file until it is whole."""
    return path.with_name(path.name + ".part")


FORMATS: dict[str, Callable[[ExportRows, Path], tuple[Path, ...]]] = {
    "csv": partial(_to_two_files, exports.write_csv), "parquet": partial(_to_two_files, _write_parquet)}
