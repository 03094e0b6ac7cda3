"""`truearc advise` beside a stand-in robot program (benchmarks/stand_in_robot.py) on a real NetworkTables server.

    python -m benchmarks.advise --gate gate.onnx [--minutes 10] [--trouble-seconds 16]

First both run for --minutes and all is well; then each key freezes, jumps and disappears in turn. The exit code
is 1 where advice came less than 20 times a second, or said FIRE later than --grace after a trouble began.
"""

import argparse
import json
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

KEYS = {"/Vision/Distance": "distance", "/Hood/Angle": "hood angle", "/Shooter/RPM": "wheel speed",
        "/Battery": "battery"}
TROUBLES = ("freezes", "jumps", "disappears")
LEAST_HZ = 20.0
MAP = """schema = "truearc.shot-map/1"
[columns]
distance_m = "/Vision/Distance"
hood_deg = { key = "/Hood/Angle", unit = "deg" }
motor_rad_s = { key = "/Shooter/RPM", unit = "rpm" }
battery_v = "/Battery"
"""


class Beside(NamedTuple):
    """(time in s, verdict) of what the robot heard; ages in s; the session's folder."""

    heard: list[tuple[float, str]]
    ages: list[float]
    session: Path


def play_beside(gate: Path, folder: Path, seconds: float, trouble: str = "", key: str = "",
                after_s: float = 0.0) -> Beside:
    """Both programs in processes of their own for these seconds."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (folder / "shots.toml").write_text(MAP, encoding="utf-8")
    words = [trouble, key, str(after_s)] if trouble else []
    robot = subprocess.Popen([sys.executable, str(Path(__file__).with_name("stand_in_robot.py")), str(port),
                              str(seconds), *words], stdout=subprocess.PIPE, text=True)
    advice = subprocess.Popen([sys.executable, "-m", "truearc", "advise", "--nt", f"127.0.0.1:{port}", "--map",
                               str(folder / "shots.toml"), "--gate", str(gate), "--out", str(folder / "sessions")],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = json.loads(robot.communicate(timeout=seconds + 60.0)[0])
    finally:
        advice.send_signal(signal.SIGTERM)
        out, err = advice.communicate(timeout=30)
    if advice.returncode != 0:
        raise RuntimeError(out + err)
    (session,) = (folder / "sessions").iterdir()
    return Beside([(at, word) for at, word in said["heard"]], said["ages"], session)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gate", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--trouble-seconds", type=float, default=16.0)
    parser.add_argument("--grace", type=float, default=0.6, help="s after a trouble began in which FIRE may still "
                        "come; of a battery that freezes ten times that")
    parser.add_argument("--keys", default=",".join(KEYS), help="keys to trouble")
    args = parser.parse_args()
    sound = _all_well(args.gate, args.minutes)
    print("\n| key | trouble | FIRE before | FIRE after | last FIRE, s after it began |\n|---|---|---|---|---|")
    for key in args.keys.split(","):
        for trouble in TROUBLES:
            sound &= _troubled(args, key, trouble)
    return 0 if sound else 1


def _all_well(gate: Path, minutes: float) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        heard, ages, session = play_beside(gate, Path(folder), 60.0 * minutes)
        replay = subprocess.run([sys.executable, "-m", "truearc", "session", "replay", str(session), "--check"],
                                capture_output=True, text=True, check=False)
    times = np.array([at for at, _ in heard])
    steady = times[times > times[0] + 1.0]
    words = [word for at, word in heard if at > times[0] + 1.0]
    rate = len(steady) / (steady[-1] - steady[0])
    p50, p99 = np.nanpercentile(ages, [50.0, 99.0])
    fires = words.count("FIRE") / len(words)
    print(f"{minutes:g} minutes beside each other: {rate:.1f} advices a second, longest gap "
          f"{np.diff(steady).max():.2f} s, age median {p50:.3f} s, 99 % {p99:.3f} s, FIRE {fires:.1%}; replay: "
          f"{'the same to the bit' if replay.returncode == 0 else replay.stderr.strip()}", flush=True)
    return bool(rate >= LEAST_HZ and replay.returncode == 0)


def _troubled(args: argparse.Namespace, key: str, trouble: str) -> bool:
    after_s = 0.4 * args.trouble_seconds
    with tempfile.TemporaryDirectory() as folder:
        heard, _, _ = play_beside(args.gate, Path(folder), args.trouble_seconds, trouble, key, after_s)
    fires = np.array([at for at, word in heard if word == "FIRE"])
    grace = args.grace * (10.0 if (key, trouble) == ("/Battery", "freezes") else 1.0)
    late = fires[fires > after_s]
    print(f"| {KEYS[key]} | {trouble} | {int((fires <= after_s).sum())} | {len(late)} | "
          f"{late.max() - after_s if len(late) else 0.0:.2f} |", flush=True)
    return bool((fires <= after_s).any() and not (late > after_s + grace).any())


if __name__ == "__main__":
    sys.exit(main())
