"""The work of `truearc session convert`: one function per format."""

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import entry_points
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from truearc.cli.common import catalogue_of, make_progress, refuse
from truearc.cli.outputs import refuse_file
from truearc.errors import EXPORTS, InputError, PluginError, load_plugin, needs, only_point
from truearc.robot.recording.export import convert as exports
from truearc.robot.recording.export.convert import TRIAL_COLUMNS, ExportRows
from truearc.robot.recording.export.field_pose import in_target_frame
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value
from truearc.robot.recording.export.viewer_mcap import NO_FLIGHTS, Flights
from truearc.robot.recording.session import TRIALS

GROUP_ROWS = 10_000                   # of a Parquet file
WriteRows = Callable[[tuple[Column, ...], Iterator[list[Value]], Path], None]


def convert(args: argparse.Namespace) -> int:
    """Write the session in the format asked for; args: those of `truearc session convert`."""
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
    """Where the trials go: week.csv -> week.trials.csv."""
    return out.with_suffix(".trials" + out.suffix)


def _part(path: Path) -> Path:
    """The name of a file until it is whole."""
    return path.with_name(path.name + ".part")


FORMATS: dict[str, Callable[[ExportRows, Path], tuple[Path, ...]]] = {
    "csv": partial(_to_two_files, exports.write_csv), "parquet": partial(_to_two_files, _write_parquet)}
