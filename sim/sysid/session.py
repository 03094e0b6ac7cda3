"""Records of effort and resulting speed to be fitted, read from a session of `truearc sysid` or from a table.

The base installation on the robot can read sessions; only tables need pyarrow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from truearc.errors import InputError
from truearc.hw.protocols import NS, MotorReading
from truearc.robot.config.schema import Config
from truearc.robot.reasons import IDENTIFY_DONE, text
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_header, load_session_config
from truearc.robot.sysid import FLYWHEEL, HOME, HOOD, POLICY, READY, phases
from truearc.robot.types import Progress, Tick
from truearc.sim.sysid.fit import Floats, Record

if TYPE_CHECKING:
    from truearc.sim.data.table import RawTable

SHORT_SHARE = 0.15                    # of the largest current: a larger deviation from the expected one is not noise
SHORT_TICKS = 0.1                     # of the driven ticks: more than switching transients explain
EFFORTS = ("nm", "v")


@dataclass(frozen=True)
class Driven:
    """The content of a session: `records` of the joints whose program was completed; `whole`: all of them."""

    config: Config
    records: dict[str, Record]
    whole: bool
    warnings: tuple[str, ...]


def load_driven(session: Path) -> Driven:
    """Load a session; InputError if it was not made by `truearc sysid`."""
    if load_header(session).policy != POLICY:
        raise InputError(f"{session}: not a recording of `truearc sysid`")
    config = load_session_config(session)
    reader = TickReader(session)
    ticks = [tick for tick, _ in reader]
    if not ticks:
        raise InputError(f"{reader.path}: no ticks")
    program, whole = phases(config), True
    warnings = [reader.cut_short] if reader.cut_short else []
    records = {}
    for joint in (FLYWHEEL, HOOD):
        steps = [index for index, phase in enumerate(program)
                 if phase.joint == joint and phase.kind not in (READY, HOME)]
        if not steps:
            continue
        ended = _progress(ticks[-1])
        if ended.phase <= steps[-1] and (ended.over is None or ended.over.code != IDENTIFY_DONE.name):
            whole, why = False, "the recording ends" if ended.over is None else text(ended.over)
            warnings.append(f"{joint}: its program did not come to the end ({why})")
            continue
        mine = [tick for tick in ticks if steps[0] <= _progress(tick).phase <= steps[-1]]
        records[joint] = _record(f"{session}: {joint}", joint, mine)
        warnings += _short_of_current(joint, mine)
    return Driven(config, records, whole, tuple(warnings))


def _progress(tick: Tick) -> Progress:
    progress = tick.memory.identify
    return progress if isinstance(progress, Progress) else Progress()


def _motors(tick: Tick, joint: str) -> tuple[MotorReading, ...]:
    return tick.inputs.flywheels if joint == FLYWHEEL else (tick.inputs.hood_motor,)


def _sent_nm(tick: Tick, joint: str) -> float:
    assert tick.sent is not None
    return tick.sent.flywheel_torque_nm if joint == FLYWHEEL else tick.sent.hood_torque_nm


def _record(name: str, joint: str, ticks: Sequence[Tick]) -> Record:
    """Torque on each motor from the tick on that sent it; the motors' mean speed at the mean of their stamps."""
    begin_ns = ticks[0].inputs.t_ns
    stamps, speeds, last = [], [], 0.0
    for tick in ticks:
        motors = _motors(tick, joint)
        stamp = sum((motor.t_ns - begin_ns) * NS for motor in motors) / len(motors)
        if stamp > last:
            last = stamp
            stamps.append(stamp)
            speeds.append(sum(motor.velocity_rad_s for motor in motors) / len(motors))
    return Record(name, "nm", np.array([(tick.inputs.t_ns - begin_ns) * NS for tick in ticks]),
                  np.array([_sent_nm(tick, joint) for tick in ticks]), np.array(stamps), np.array(speeds))


def _short_of_current(joint: str, ticks: Sequence[Tick]) -> list[str]:
    """Whether the drivers gave less than was asked: current should go with torque, by one constant."""
    pairs = np.array([(_sent_nm(tick, joint), motor.current_a) for tick in ticks for motor in _motors(tick, joint)])
    asked_nm, current_a = pairs[:, 0], pairs[:, 1]
    driven = asked_nm != 0.0
    if not driven.any() or not current_a.any():
        return [f"{joint}: no motor current was reported, so a limit of voltage or current cannot be detected"]
    off = np.abs(current_a - _slope(asked_nm[driven], current_a[driven]) * asked_nm)[driven]
    share = float(np.mean(off > SHORT_SHARE * np.abs(current_a).max()))
    if share <= SHORT_TICKS:
        return []
    return [f"{joint}: in {share:.0%} of the driven time the current does not go with the torque that was asked "
            "(voltage or current limit?): ask for a lower step_nm or top_rad_s"]


def _slope(x: Floats, y: Floats) -> float:
    """Median of y/x over the larger x: a few limited ticks do not bend it."""
    large = np.abs(x) > 0.5 * np.abs(x).max()
    return float(np.median(y[large] / x[large]))


def load_steps(path: Path) -> Record:
    """Load columns t_s, one that ends in _V or _Nm (the effort, held until the next row), one in _rad_s; others are
    ignored.

    InputError names file, line and column.
    """
    from truearc.sim.data.table import gathered, load_table, need_columns, number_column
    with gathered() as problems:
        table = load_table(path, problems)
        need_columns(table, ["t_s"])
        effort, speed = _only(table, EFFORTS, "voltage or torque"), _only(table, ("rad_s",), "speed")
        t_s, efforts, speeds = (number_column(table, name, problems) for name in ("t_s", effort, speed))
    if len(t_s) < 2:
        raise InputError(f"{path}: {len(t_s)} rows; expected at least 2")
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(backwards):
        raise InputError(f"{table.place(int(backwards[0]) + 1)}: column t_s: time does not go on")
    t_s = t_s - t_s[0]
    return Record(str(path), effort.lower().rpartition("_")[2], t_s, efforts, t_s, speeds)


def _only(table: "RawTable", units: tuple[str, ...], what: str) -> str:
    """The one column in one of these units."""
    found = [name for name in table.columns if name.lower().endswith(tuple(f"_{unit}" for unit in units))]
    if len(found) != 1:
        ends = " or ".join(f"_{unit}" for unit in units)
        raise InputError(f"{table.place(-1)}: {len(found)} columns end in {ends} ({', '.join(found) or 'none'}); "
                       f"exactly one, the {what}, is needed")
    return found[0]
