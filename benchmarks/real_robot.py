"""A harness for benchmarks and tests: `truearc run` and the emulated devices in real time, as separate processes."""

import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

from truearc.cli.common import SHIPPED

ROOT = Path(__file__).parents[1]
# A robot has its machine for itself; one that shares it stalls for longer than a robot would put up with.
PATIENT = {"reading_age_s = 0.1": "reading_age_s = 0.15", "sighting_age_s = 0.3": "sighting_age_s = 2.0",
           "request_s = 8.0": "request_s = 60.0", "feed_s = 0.25": "feed_s = 0.6", "clear_s = 0.6": "clear_s = 1.2"}
WATCHDOG_MS = 2000
START_S, END_S = 120.0, 60.0
MANY = 1_000_000                      # trials: more than anybody waits for
TRUEARC = ("-m", "truearc", "run")


def save_config(path: Path, changes: dict[str, str]) -> Path:
    """The shipped configuration with some lines changed."""
    text = SHIPPED.read_text(encoding="utf-8")
    for shipped, wanted in changes.items():
        assert shipped in text, shipped
        text = text.replace(shipped, wanted)
    path.write_text(text, encoding="utf-8")
    return path


class RealRobot:
    """Running when it is made; `pids`: devices, control, and those that control says it has started."""

    def __init__(self, config: Path, out: Path, options: tuple[str, ...] = (), run: tuple[str, ...] = TRUEARC,
                 bus: str = "slcan:auto") -> None:
        self.out = out
        self._devices = begin("-m", "truearc", "emulate", "--trials", MANY, "--seed", 3, "--bus", bus, "--config",
                              config, "--watchdog-ms", WATCHDOG_MS)
        assert self._devices.stdout is not None
        self._devices.stdout.readline()
        ports = self._devices.stdout.readline().split()[2:]
        self._control = begin(*run, *ports, "--out", out, *options)
        self.said: list[str] = []
        self.pids = {"devices": self._devices.pid, "control": self._control.pid}
        self._started = threading.Event()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        if not self._started.wait(START_S) or self.code is not None:
            self.kill()
            raise RuntimeError("the robot does not start: " + "".join(self.said))

    @property
    def session(self) -> Path:
        return next(self.out.iterdir())

    @property
    def code(self) -> int | None:
        """Its exit code, once it has ended."""
        return self._control.poll()

    def rest(self, seconds: float) -> None:
        """Let it run for so long; RuntimeError when it ends before."""
        try:
            self._control.wait(seconds)
        except subprocess.TimeoutExpired:
            return
        raise RuntimeError("the robot has ended: " + "".join(self.said))

    def end(self) -> str:
        """Have the robot end, and then its devices; what it said on its standard output."""
        self._control.send_signal(signal.SIGTERM)
        return self.wait()

    def wait(self) -> str:
        """The same, when it ends by itself."""
        assert self._control.stdout is not None
        try:
            words = self._control.stdout.read()
            self._control.wait(END_S)
            self._listener.join(END_S)
        finally:
            self.kill()
        return words

    def kill(self) -> None:
        for process in (self._control, self._devices):
            process.kill()
            process.wait()

    def _listen(self) -> None:
        assert self._control.stderr is not None
        for line in self._control.stderr:
            self.said.append(line)
            if found := re.search(r"(\w+) is process (\d+)", line):
                self.pids[found[1]] = int(found[2])
            if "recorder" in line:
                self._started.set()
        self._started.set()


def begin(*words: object) -> subprocess.Popen[str]:
    """Python, in a process of its own."""
    return subprocess.Popen([sys.executable, *map(str, words)], cwd=ROOT, text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE)
