"""Memory of all processes of `truearc run` on the emulated robot, with camera, gate, and clients of its page.

    python -m benchmarks.memory --gate gate.onnx [--minutes 5] [--clients 12] [--out DIR]

The largest sum of the processes' shares (PSS: what several use counts once) is what the unit's MemoryMax is made of;
Linux only. `--out` on a disk that is full shows what waits for room.
"""

import argparse
import re
import tempfile
import threading
import time
from http.client import HTTPConnection, HTTPException
from pathlib import Path

from benchmarks.real_robot import PATIENT, RealRobot, save_config

PORT = 5808
LOOK_S = 1.0
MB = 1e6
ASKS = b'{"distance_m": 3.2, "motor_ratio": 0.5, "hood_deg": 50.0}'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gate", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--clients", type=int, default=12)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        robot = RealRobot(save_config(Path(folder) / "launcher.toml", PATIENT), args.out or Path(folder) / "out",
                          ("--gate", str(args.gate.resolve()), "--page", str(PORT)))
        try:
            for number in range(args.clients):
                threading.Thread(target=look_on, args=(number,), daemon=True).start()
            largest, end_s = {0: 0.0}, time.monotonic() + 60.0 * args.minutes
            while time.monotonic() < end_s:
                robot.rest(LOOK_S)
                shares = {pid: share_mb(pid) for pid in family(robot.pids["control"])}
                if sum(shares.values()) > sum(largest.values()):
                    largest = shares
            print(f"largest sum {sum(largest.values()):.0f} MB after {args.minutes:g} min with {args.clients} clients: "
                  + ", ".join(f"{share:.0f}" for share in sorted(largest.values(), reverse=True)))
        finally:
            print(*robot.said, robot.end(), sep="")


def family(pid: int) -> list[int]:
    """A process and all that it and they have started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:               # has ended meanwhile
            continue
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def share_mb(pid: int) -> float:
    """Its proportional share of memory; 0 once it has ended."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0.0
    shares = re.findall(r"^(?:Pss|SwapPss): +(\d+) kB", text, re.MULTILINE)
    return sum(map(int, shares)) * 1024 / MB


def look_on(number: int) -> None:
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
            time.sleep(LOOK_S)


if __name__ == "__main__":
    main()
