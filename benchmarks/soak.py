"""Soak test of the robot's processes over hours: memory, open files, threads, lateness and complete recording.

    python -m benchmarks.soak [--minutes 60] [--folder DIR] [--gate gate.onnx] [--clients 12]

`truearc run` has three processes and its emulated devices a fourth (slcan on a pseudo-terminal), all in real time. The
resources of each process are read from /proc (Linux). The result is FAIL if a process keeps growing or accumulates open
files or threads, if ticks are missing from the recording or drift against the clock, if a process ends, or if a file
cannot be read. The largest total of the robot's proportional memory (PSS, which divides shared pages among processes),
with a gate and that many clients of the page, determines MemoryMax in the systemd unit. With `--folder` on a full disk,
the test shows the memory of data that wait for space.
"""

import re
import statistics
import sys
import tempfile
import threading
import time
from array import array
from collections.abc import Callable
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from benchmarks.options import read_options
from benchmarks.real_robot import PATIENT, RealRobot, save_config
from truearc.robot.config.schema import load_config
from truearc.robot.recording.files import load_image, load_pictures
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import LATENESS, load_trials
from truearc.robot.runtime import Second

SAMPLE_S, PORT = 1.0, 5808
ASKS = b'{"distance_m": 3.2, "motor_ratio": 0.5, "hood_deg": 50.0}'
WARM_SHARE = 0.25                     # of the run: caches fill, libraries are loaded
GROWTH_MB = 4.0                       # more than this after that, and still growing at its end, is a leak
INDEX_MB_PER_H = 17.5                 # the recording's index, which its end needs, may grow: 0.5 kB per chunk of 0.1 s
DRIFT_S = 0.0005                      # by which ticks may come off the beat they began with
PIECE_S = 20
LAG_S = 1.0                           # that the last tick may be older than the end
KIB_PER_MB, S_PER_H, NS_PER_S = 1024, 3600.0, 1_000_000_000


class Sample(NamedTuple):
    """What one process holds at one moment."""

    t_s: float
    rss_mb: float
    files: int
    threads: int


def sample(pid: int, t_s: float) -> Sample:
    """FileNotFoundError when it has ended."""
    fields = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    return Sample(t_s, int(fields["VmRSS"].split()[0]) / KIB_PER_MB, len(list(Path(f"/proc/{pid}/fd").iterdir())),
                  int(fields["Threads"]))


def growth_mb(samples: list[Sample]) -> float:
    """How much larger the middle of the last third is than that of the first, once it was warm; 0 when it has ended
    growing: the last sixth is then no larger than the one before."""
    warm = samples[int(WARM_SHARE * len(samples)):]
    third, sixth = max(len(warm) // 3, 1), max(len(warm) // 6, 1)

    def middle(part: list[Sample]) -> float:
        return statistics.median(item.rss_mb for item in part)

    still = middle(warm[-sixth:]) - middle(warm[-2 * sixth:-sixth] or warm[-sixth:])
    return middle(warm[-third:]) - middle(warm[:third]) if still > 0.0 else 0.0


def gathered(samples: list[Sample], what: Callable[[Sample], int]) -> int:
    """By how much the least that is held in the last third is above the least in the first, once it was warm."""
    warm = samples[int(WARM_SHARE * len(samples)):]
    third = max(len(warm) // 3, 1)
    return min(map(what, warm[-third:])) - min(map(what, warm[:third]))


def family(pid: int) -> list[int]:
    """A process and all that it and they have started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):       # has ended meanwhile
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def share_mb(pid: int) -> float:
    """Its proportional share of memory; 0 once it has ended."""
    with suppress(OSError):
        shares = re.findall(r"^(?:Pss|SwapPss): +(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)
        return sum(map(int, shares)) * KIB_PER_MB / 1e6
    return 0.0


def look_on() -> None:
    """A browser with the page open, now and then asking the gate."""
    while True:
        try:
            line = HTTPConnection("127.0.0.1", PORT, timeout=10.0)
            line.request("POST", "/predict", ASKS, {"Content-Type": "application/json", "Host": f"127.0.0.1:{PORT}"})
            line.getresponse().read()
            line.request("GET", "/events", headers={"Host": f"127.0.0.1:{PORT}"})
            stream = line.getresponse()
            for _ in range(200):
                stream.readline()
            line.close()
        except (OSError, HTTPException):
            time.sleep(SAMPLE_S)


def watch(robot: RealRobot, seconds: float) -> tuple[dict[str, list[Sample]], float]:
    """What each process holds, once a second, and the largest sum of shares in MB; RuntimeError when one ends."""
    samples: dict[str, list[Sample]] = {name: [] for name in robot.pids}
    began_s, largest_mb = time.monotonic(), 0.0
    while (t_s := time.monotonic() - began_s) < seconds:
        for name, pid in robot.pids.items():
            samples[name].append(sample(pid, t_s))
        largest_mb = max(largest_mb, sum(map(share_mb, family(robot.pids["control"]))))
        robot.rest(SAMPLE_S)
    return samples, largest_mb


def judge_memory(samples: dict[str, list[Sample]]) -> list[str]:
    """What has grown."""
    wrong = []
    for name, held in samples.items():
        index_mb = INDEX_MB_PER_H * (1.0 - WARM_SHARE) * 2.0 / 3.0 * (held[-1].t_s - held[0].t_s) / S_PER_H
        if (grown := growth_mb(held)) > GROWTH_MB + (index_mb if name == "recorder" else 0.0):
            wrong.append(f"{name} has grown by {grown:.1f} MB and goes on")
        for what, count in (("open files", gathered(held, lambda item: item.files)),
                            ("threads", gathered(held, lambda item: item.threads))):
            if count > 0:
                wrong.append(f"{name} gathers {what}: {count} more")
    return wrong


def judge_recording(session: Path, tick_hz: int, ended_ns: int) -> tuple[list[str], list[str]]:
    """Return the faults of a recording that has just ended, and a summary."""
    reader, times_ns, wrong, cycle, fired = TickReader(session), array("q"), [], 0, 0
    for tick, _ in reader:
        if tick.inputs.cycle != cycle + 1:
            wrong.append(f"tick {cycle + 1} is missing")
        cycle = tick.inputs.cycle
        times_ns.append(tick.inputs.t_ns)
        fired += tick.shot is not None
    count, last_ns, took_s = len(times_ns), times_ns[-1], (times_ns[-1] - times_ns[0]) * 1e-9
    off_s = drift_s(np.array(times_ns), tick_hz)
    if reader.cut_short:
        wrong.append("the recording is cut short")
    if abs(off_s) > DRIFT_S:
        wrong.append(f"ticks have drifted by {1000 * off_s:.2f} ms against the clock")
    if (ended_ns - last_ns) * 1e-9 > LAG_S:
        wrong.append(f"the last tick is {(ended_ns - last_ns) * 1e-9:.1f} s older than the end")
    pictures = load_pictures(session)
    if any(load_image(session, picture) is None for picture in pictures):
        wrong.append("an image of the index is not whole")
    seconds = [msgspec.json.decode(line, type=Second) for line in (session / LATENESS).read_bytes().splitlines()]
    told = sum(sum(second.counts) for second in seconds)
    if told != count - 1:
        wrong.append(f"lateness.jsonl tells of {told} ticks, the recording of {count}")
    return wrong, [f"{count} ticks in {took_s:.1f} s, {round(took_s * tick_hz) + 1 - count} left out where the machine "
                   f"stalled; {1000 * off_s:+.2f} ms of drift against the clock; {fired} shots, "
                   f"{len(load_trials(session))} marked trials, {len(pictures)} images, all readable"]


def drift_s(times_ns: np.ndarray, tick_hz: int) -> float:
    """By how much ticks at the end are off the beat of those at the beginning, followed from piece to piece: what they
    come off within one must be less than half a period."""
    period_ns = NS_PER_S // tick_hz
    pieces = np.array_split(times_ns - times_ns[0], max(2, len(times_ns) // (PIECE_S * tick_hz)))
    beats_ns = np.array([np.median((piece - piece[0] + period_ns // 2) % period_ns - period_ns // 2) + piece[0]
                         for piece in pieces])
    steps_ns = (np.diff(beats_ns) + period_ns / 2) % period_ns - period_ns / 2
    return float(steps_ns.sum()) / NS_PER_S


def report(samples: dict[str, list[Sample]], wrong: list[str], summary: list[str]) -> None:
    """The table."""
    print("process     MB at first   once warm   at last   most   open files   threads")
    for name, held in samples.items():
        warm = held[int(WARM_SHARE * len(held))]
        print(f"{name:10s} {held[0].rss_mb:12.1f} {warm.rss_mb:11.1f} {held[-1].rss_mb:9.1f} "
              f"{max(item.rss_mb for item in held):6.1f} {warm.files:6d} -> {held[-1].files:<4d} "
              f"{warm.threads:4d} -> {held[-1].threads}")
    print(*summary, *(f"FAIL: {words}" for words in wrong), *(["ok"] if not wrong else []), sep="\n")


def soak(seconds: float, folder: Path, options: tuple[str, ...] = (), clients: int = 0) -> bool:
    """Run for so long, and print what came of it; whether all was well."""
    config = save_config(folder / "launcher.toml", PATIENT)
    robot = RealRobot(config, folder / "sessions", options)
    wrong, samples = [], {}
    try:
        for _ in range(clients):
            threading.Thread(target=look_on, daemon=True).start()
        samples, largest_mb = watch(robot, seconds)
        ended_ns = time.monotonic_ns()
        words = robot.end()
    except (RuntimeError, FileNotFoundError) as error:
        print(f"FAIL: a process has ended: {error}", *robot.said, sep="\n")
        return False
    finally:
        robot.kill()
    if robot.code != 0:
        wrong.append(f"exit code {robot.code}")
    found, summary = judge_recording(robot.session, load_config(config).tick_hz, ended_ns)
    wrong += judge_memory(samples) + found
    report(samples, wrong, [*words.splitlines()[1:2], *summary, f"largest sum of shares {largest_mb:.0f} MB"])
    return not wrong


def main() -> None:
    args = read_options(__doc__, minutes=60.0, folder=(Path, "to record in (default: the system's temporary folder)"),
                        gate=(Path, "to be loaded"), clients=(0, "of the page"))
    options = ("--page", str(PORT), *(("--gate", str(args.gate.resolve())) if args.gate else ()))
    with tempfile.TemporaryDirectory(dir=args.folder) as name:
        sys.exit(0 if soak(60.0 * args.minutes, Path(name), options, args.clients) else 1)


if __name__ == "__main__":
    main()
