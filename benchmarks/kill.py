"""Benchmark of recordings under `kill -9`: the data that are lost when a process is killed at a random moment.

    python -m benchmarks.kill [--kills 200] [--seed 0]

A child process records real ticks, CAN frames and images in a loop, marks a trial every quarter of a second, and
reports through a pipe what it has handed to the recorder. It is killed, and its report is compared with the files.
The child runs at the robot's pace, 200 ticks per second; the recorder is a separate process and survives the kill.
Tests also kill a child that runs at full speed (`twin`: the recorder makes it wait) and a child that runs the recorder
in its own threads (`one`).
"""

import argparse
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from truearc.cli.common import SHIPPED
from truearc.cli.run_processes import RecorderProcess
from truearc.hw.protocols import CameraFrame, Frame
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import load_config
from truearc.robot.recording.files import load_image, load_pictures, parse_candump
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import CAN, load_header, load_session_config, load_trials
from truearc.robot.recording.upkeep import recover
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.types import Outcome, Tick

MARK_TICKS = 50
SAID = struct.Struct("<qq")           # time of a tick that was handed over, and how many trials have been
LONGEST_S = 1.0                       # ... after its first tick the child is killed
NS = 1e-9


class Killed(NamedTuple):
    """What one kill cost."""

    said_s: float                     # robot time of the last tick handed over
    lost_s: float                     # of which that much is not on disk
    marked: int
    marks_lost: int                   # not in trials.jsonl
    marks_recovered: int              # of those, put back by recover from the ticks
    faults: list[str]                 # whatever a reader had to object to


def kill_once(source: Path, folder: Path, seed: int, pace: str, layout: str = "one") -> Killed:
    """Record into `folder`, kill the recorder at a moment drawn from `seed`, read what is there and repair it."""
    child = subprocess.Popen([sys.executable, __file__, "--child", str(source), str(folder), pace, layout],
                             stdout=subprocess.PIPE)
    assert child.stdout is not None
    said = child.stdout.read(SAID.size)
    if len(said) < SAID.size:
        raise RuntimeError("no report from the child")
    timer = threading.Timer(random.Random(seed).uniform(0.0, LONGEST_S), os.kill, (child.pid, signal.SIGKILL))
    timer.start()
    said += child.stdout.read()       # to its end, which is the recorder's: it has the same output
    child.wait()
    child.stdout.close()
    whole = len(said) // SAID.size * SAID.size
    t_ns, marked = SAID.unpack(said[whole - SAID.size:whole])
    return _judge(folder, t_ns, marked)


def _judge(folder: Path, said_ns: int, marked: int) -> Killed:
    faults = []
    reader = TickReader(folder)
    cycles, frames, last_ns = [], 0, 0
    for tick, _ in reader:
        cycles.append(tick.inputs.cycle)
        frames += tick.inputs.frames
        last_ns = tick.inputs.t_ns
    if cycles != list(range(1, len(cycles) + 1)):
        faults.append("ticks with gaps")
    lines = (folder / CAN).read_text().splitlines(keepends=True)
    parsed = [parse_candump(line) for line in lines if line.endswith("\n")]
    received = sum(frame is not None and not frame[1] for frame in parsed)
    if received < frames:
        faults.append(f"{frames} frames read in ticks, {received} in {CAN}")
    if None in parsed:
        faults.append(f"{CAN}: a line that is not whole before the last")
    if any(load_image(folder, picture) is None for picture in load_pictures(folder)):
        faults.append("an image of the index is not whole")
    kept = len(load_trials(folder))
    recovered = recover(folder)
    again = TickReader(folder)
    if sum(1 for _ in again) != len(cycles) or again.cut_short:
        faults.append("not whole after recover")
    return Killed(said_ns * NS, max(said_ns - last_ns, 0) * NS, marked, max(marked - kept, 0),
                  max(min(recovered.trials, marked) - kept, 0), faults)


def record_for_ever(source: Path, folder: Path, pace: str, layout: str) -> None:
    """The child: never ends by itself."""
    clock, config = MonotonicClock(), load_session_config(source)
    open_keeper = RecorderProcess(ExitStack()).open_keeper if layout == "three" else None
    recorder = SessionWriter(folder, load_header(source), config, None, lossless=pace == "twin",
                             open_keeper=open_keeper)
    picture = load_image(source, load_pictures(source)[0])
    assert picture is not None
    due_ns, marked = clock.now_ns(), 0
    for tick, frames in _endless(source):
        if pace == "robot":
            due_ns += 5_000_000
            clock.sleep_until_ns(due_ns)
        for frame, sent in frames:
            recorder.tap(frame, sent)
        if tick.inputs.cycle % MARK_TICKS == 0:
            outcome = Outcome(marked, tick.inputs.t_ns, "two")
            shot = None if tick.memory.last_shot is None else replace(tick.memory.last_shot, trial=marked)
            tick = replace(tick, outcomes=(outcome,), memory=replace(tick.memory, last_shot=shot))
            recorder.keep_picture(CameraFrame(tick.inputs.t_ns, picture.image))
            marked += 1
        assert tick.sent is not None
        recorder.record(tick, tick.sent)
        os.write(1, SAID.pack(tick.inputs.t_ns, marked))


def _endless(source: Path) -> Iterator[tuple[Tick, list[tuple[Frame, bool]]]]:
    """The ticks of a session and the frames that were read in each, over and over, with time and cycle going on."""
    ticks = [tick for tick, _ in TickReader(source)]
    lines = [parsed for parsed in map(parse_candump, (source / CAN).open()) if parsed is not None and not parsed[1]]
    span_ns, round_number = ticks[-1].inputs.t_ns, 0
    while True:
        at = 0
        for tick in ticks:
            frames, at = lines[at:at + tick.inputs.frames], at + tick.inputs.frames
            inputs = replace(tick.inputs, t_ns=tick.inputs.t_ns + round_number * span_ns,
                             cycle=tick.inputs.cycle + round_number * len(ticks))
            yield replace(tick, inputs=inputs, outcomes=()), frames
        round_number += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        record_for_ever(*map(Path, args.child[:2]), *args.child[2:])
    from truearc.sim.world.emulated_robot import emulate  # not for the child, nor its recorder, which import this file

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        emulate(load_config(SHIPPED), source, trials=1, seed=args.seed)
        kills = [kill_once(source, Path(folder) / f"{number}", args.seed + number, "robot", "three")
                 for number in range(args.kills)]
    lost = sorted(kill.lost_s for kill in kills)
    print(f"{len(kills)} kills at the robot's pace, recorder in a separate process, after "
          f"{sum(kill.said_s for kill in kills):.0f} s of ticks")
    print(f"ticks lost           median {lost[len(lost) // 2]:.3f} s, worst {lost[-1]:.3f} s (limit: 0.25 s)")
    print(f"marked trials        {sum(kill.marked for kill in kills)}: {sum(kill.marks_lost for kill in kills)} lost; "
          f"`recover` restored {sum(kill.marks_recovered for kill in kills)}")
    faults = [f"kill {number}: {fault}" for number, kill in enumerate(kills) for fault in kill.faults]
    print("\n  ".join([f"damaged after kill   {len(faults)}", *faults]))


if __name__ == "__main__":
    main()
