"""The work of `truearc session convert`: one function per format."""

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from truearc.cli.common import make_progress
from truearc.cli.outputs import refuse_file
from truearc.robot.config.schema import InputError
from truearc.robot.recording.export import convert as exports
from truearc.robot.recording.export.convert import TRIAL_COLUMNS, ExportRows
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

GROUP_ROWS = 10_000                   # of a Parquet file
WriteRows = Callable[[tuple[Column, ...], Iterator[list[Value]], Path], None]


def convert(args: argparse.Namespace) -> int:
    """Write the session in the format asked for; args: those of `truearc session convert`."""
    if args.session.resolve() in args.out.resolve().parents:
        raise InputError(f"{args.out}: lies in the session that it is made from; a recording is never written over")
    if args.to in ("csv", "parquet"):
        refuse_file(trials_path(args.out), args.force)
    progress = make_progress("convert", args.quiet)
    rows = ExportRows(args.session, progress)
    try:
        made = FORMATS[args.to](rows, args.out)
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
    if rows.reader.cut_short:
        print(f"{rows.reader.cut_short}; what follows is missing: truearc session recover", file=sys.stderr)
    return 0


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


def trials_path(out: Path) -> Path:
    """Where the trials go: week.csv -> week.trials.csv."""
    return out.with_suffix(".trials" + out.suffix)


def _part(path: Path) -> Path:
    """The name of a file until it is whole."""
    return path.with_name(path.name + ".part")


FORMATS: dict[str, Callable[[ExportRows, Path], tuple[Path, ...]]] = {
    "csv": partial(_to_two_files, exports.write_csv), "parquet": partial(_to_two_files, _write_parquet),
    "mcap": partial(_to_one_file, exports.write_mcap),
    "wpilog": partial(_to_one_file, exports.write_wpilog)}
