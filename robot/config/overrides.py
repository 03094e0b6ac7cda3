"""Command-line options that replace parts of the configuration: ports, and a table of prescribed shots.

The table (`truearc run --plan`) has configurations to be shot as they stand, instead of the walk that the robot would
take. It is read with the standard library alone, since the robot reads it too.
"""

import argparse
import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

from msgspec.structs import replace

from truearc.errors import MAX_TEXT_BYTES, InputError, load_bytes, naming, number_in
from truearc.robot.config.schema import Can, Config, Prescribed


def add_port_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--can", metavar="INTERFACE:CHANNEL", help="instead of [can], such as slcan:/dev/ttyACM0")
    parser.add_argument("--buttons", metavar="PORT", help="instead of [buttons] port")
    parser.add_argument("--camera", metavar="DEVICE", help="instead of [camera] device; a URL, too")


def with_ports(config: Config, can: str | None, buttons: str | None, camera: str | None) -> Config:
    """`config` with these ports; InputError names one that is none."""
    if can is not None:
        interface, channel = split_bus(can, "--can")
        config = replace(config, can=Can(interface, channel, config.can.bitrate))
    if buttons is not None:
        config = replace(config, buttons=replace(config.buttons, port=buttons))
    if camera is not None:
        config = replace(config, camera=replace(config.camera, device=camera))
    return config


def split_bus(bus: str, option: str) -> tuple[str, str]:
    """(interface, channel) of `interface:channel`; the channel may have colons of its own."""
    interface, _, channel = bus.partition(":")
    if not interface or not channel:
        raise InputError(f"{option} {bus}: an interface and a channel, such as slcan:/dev/ttyACM0 or socketcan:can0")
    return interface, channel


COLUMNS = ("distance_m", "motor_ratio", "hood_deg")
SHOWN = 5                             # bad rows that a message names before it only counts


def load_plan(path: str | Path, config: Config) -> tuple[Prescribed, ...]:
    """Rows of a CSV file, or of shots.csv in a dataset directory; other columns are not looked at.

    InputError names file, line and column of every row that this launcher cannot be set to: ratio in (0, 1], elevation
    within the hood's limits, distance above 0.
    """
    file = Path(path) / "shots.csv" if Path(path).is_dir() else Path(path)
    plan, bad = [], []
    for line, row in _rows(file):
        plan.append({name: number_in(cell) for name, cell in row.items()})
        bad += [f"{file}:{line}: {what}" for what in _errors(row, plan[-1], config)]
    if bad:
        more = [f"... and {len(bad) - SHOWN} more"] if len(bad) > SHOWN else []
        raise InputError("\n".join([*bad[:SHOWN], *more]))
    if not plan:
        raise InputError(f"{file}: no rows: there is nothing to shoot")
    return tuple(Prescribed(**values) for values in plan)


def with_plan(config: Config, plan: tuple[Prescribed, ...], repeats: int | None = None) -> Config:
    """The configuration with these shots prescribed, each `repeats` times (None: as often as [collect] says)."""
    repeats = config.collect.repeats if repeats is None else repeats
    if repeats < 1:
        raise InputError(f"--repeats {repeats}: at least 1")
    return replace(config, collect=replace(config.collect, prescribed=plan, repeats=repeats))


def _rows(file: Path) -> list[tuple[int, dict[str, str]]]:
    """(line, cells by column) of each row; InputError when it is no such table."""
    with naming(file):
        text = load_bytes(file, MAX_TEXT_BYTES).decode("utf-8-sig")
        reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
        header = reader.fieldnames or []
        if missing := [name for name in COLUMNS if name not in header]:
            raise InputError(f"{file}:1: columns {', '.join(missing)} are missing; a plan has them by these names, "
                             "with commas between cells, and no other unit is converted")
        return [(reader.line_num, {name: row[name] or "" for name in COLUMNS}) for row in reader]


def _errors(row: dict[str, str], values: dict[str, float], config: Config) -> Iterator[str]:
    limits = {"distance_m": (0.0, 1e3), "motor_ratio": (0.0, 1.0),
              "hood_deg": (config.hood.low_deg, config.hood.high_deg)}
    for name, value in values.items():
        low, high = limits[name]
        if math.isnan(value):
            yield f"{name}: {row[name]!r} is not a number"
        elif not low <= value <= high or (value == 0.0 and name != "hood_deg"):
            yield f"{name}: {value:g} is out of the launcher's range ({low:g} to {high:g})"
