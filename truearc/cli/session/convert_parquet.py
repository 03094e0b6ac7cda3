"""Rows to Parquet; here, for pyarrow is not in the robot's base install."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

GROUP_ROWS = 10_000
TYPES = {FLOAT: pa.float64(), INT: pa.int64(), BOOL: pa.bool_(), TEXT: pa.string(), TEXTS: pa.list_(pa.string()),
         FLOATS: pa.list_(pa.float64())}


def write_parquet(columns: tuple[Column, ...], rows: Iterator[list[Value]], path: Path) -> None:
    """A column a name, absent values null; each column's metadata has its unit."""
    schema = pa.schema([pa.field(column.name, TYPES[column.kind], metadata={"unit": column.unit})
                        for column in columns])
    with pq.ParquetWriter(path, schema) as writer:
        while group := list(islice(rows, GROUP_ROWS)):
            arrays = [pa.array(cells, type=field.type) for cells, field in zip(zip(*group, strict=True), schema,
                                                                               strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
