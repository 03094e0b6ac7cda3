"""Runs of `truearc advise` with a fault in one of the robot's NetworkTables keys, in stepped time, and their judgement.

Every key is noisy, as sensors are. A run is wrong if it FIREs during the fault after the row's time limit, if no HOLD
with the row's reason comes within that limit, if it never FIREs before or after the fault, or if its replay differs.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
from msgspec.structs import replace

from benchmarks.matrix.fault import Key, Row, find
from truearc.cli.common import SHIPPED
from truearc.hw.emulated.nodes import StepClock
from truearc.robot.advice import ADVICE, advise_step
from truearc.robot.config.schema import AprilTag, Config, load_config
from truearc.robot.config.shot_map import ShotMap, Signal
from truearc.robot.gate import Rating
from truearc.robot.reasons import text
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Comparer, Difference, RecordedRows
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import ReplayRig
from truearc.robot.runtime import run
from truearc.robot.types import Tick
from truearc_frc.advice import AdviceIo
from truearc_frc.inputs import NtCamera, NtVelocity
from truearc_frc.keys import Reading
from truearc_frc.table import Nt4, Nt4Velocity, Nt4Vision, nt4_of, with_nt4

NS = 1_000_000_000
HZ, FRESH_S, BEGIN_S, AFTER_S = 50, 0.25, 1.0, 2.0
MAP = ShotMap("truearc.shot-map/1", columns={
    "distance_m": "/Vision/Distance", "hood_deg": Signal("/Hood/Angle", "deg"),
    "motor_rad_s": Signal("/Shooter/RPM", "rpm"), "battery_v": "/Battery"})
FRONT, LIMELIGHT, HEADING, ALIVE = "/photonvision/front", "/limelight", "/Drive/Heading", "/Drive/Loop"
POSE = f"{FRONT}/targetPose"
WELL = {"/Vision/Distance": 3.0, "/Hood/Angle": 45.0, "/Shooter/RPM": 2400.0, "/Battery": 12.4}
CAMERAS = {
    FRONT: {f"{POSE}/0": 2.74, f"{POSE}/1": 0.0, f"{POSE}/2": -0.53, f"{FRONT}/heartbeat": 1.0,
            f"{FRONT}/hasTarget": 1.0, f"{FRONT}/latencyMillis": 30.0},
    LIMELIGHT: {**{f"{LIMELIGHT}/targetpose_cameraspace/{axis}": at for axis, at in enumerate((0.0, 0.53, 2.74))},
                f"{LIMELIGHT}/hb": 1.0, f"{LIMELIGHT}/tv": 1.0, f"{LIMELIGHT}/cl": 15.0, f"{LIMELIGHT}/tl": 15.0,
                f"{LIMELIGHT}/stddevs/0": 0.02, f"{LIMELIGHT}/stddevs/1": 0.02, f"{LIMELIGHT}/tid": 4.0}}
VISION = {FRONT: Nt4Vision("photonvision", "front", 0.05), LIMELIGHT: Nt4Vision("limelight", "limelight", 0.05)}
DRIVEN = {"/Drive/Speeds/0": 0.0, "/Drive/Speeds/1": 0.0, HEADING: 0.0, ALIVE: 1.0}
EXACT = ("hasTarget", "latencyMillis", "/tv", "/tid")          # without noise
NOISE = {"/Shooter/RPM": 2.0, "/Battery": 0.02}
JUMP = 1.5                            # times as large, or m/s or rad more, is a value that jumps
JUMPS = {"/Battery": 0.5}             # no battery has 1.5 times as much


# A gate that agrees with everything
AGREES: Any = SimpleNamespace(sha256="0" * 64, rate=lambda *settings: Rating(0.9, 0.9, True, 0.0))


class Robot:
    """The robot's keys; `trouble` from `begin_ns` to `end_ns`."""

    def __init__(self, trouble: Key, begin_ns: int, end_ns: int) -> None:
        self._trouble, self._begin_ns, self._end_ns = trouble, begin_ns, end_ns
        self._stands = False
        self._values = WELL | CAMERAS.get(_camera_of(trouble), {}) | (DRIVEN if "Drive" in trouble.key else {})

    @property
    def connected(self) -> bool:
        return not (self._trouble.what == "server gone" and self._stands)

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        self._stands = self._begin_ns <= now_ns < self._end_ns
        return {} if not self.connected else {
            key: reading for key, value in self._values.items() if (reading := self._reading(key, value, now_ns))}

    def publish(self, values: object) -> None:
        """No client listens."""

    def _reading(self, key: str, value: float, now_ns: int) -> Reading | None:
        wave = math.sin(now_ns * 1e-9 * 61.0 + len(key))
        well = Reading(now_ns - 2_000_000, value if key.endswith(EXACT) else value + NOISE.get(key, 1e-3) * wave)
        if not self._stands or not key.startswith(self._trouble.key):
            return well
        match self._trouble.what:
            case "freezes":
                return Reading(self._begin_ns, value)
            case "jumps":
                off = now_ns // 100_000_000 % 2
                return Reading(well.t_ns, value * JUMPS.get(key, JUMP) if off and value else well.value + JUMP * off)
            case "impossible":                    # of an angle: the same place
                return Reading(well.t_ns, well.value - 3600.0)
            case "not a number":
                return Reading(well.t_ns, math.nan)
        return None


def make_config(trouble: Key) -> Config:
    """The shipped launcher, a gate obeyed, and the camera or the velocity that the trouble is about."""
    shipped = load_config(SHIPPED)
    velocity = Nt4Velocity("/Drive/Speeds", 2.0, 2.0)
    if trouble.key in (HEADING, ALIVE):
        velocity = replace(velocity, frame="field", heading=HEADING, alive=ALIVE if trouble.key == ALIVE else "")
    nt4 = Nt4("254", VISION.get(_camera_of(trouble)), velocity if "Drive" in trouble.key else None)
    gate = replace(shipped.gate, policy="model", reading_age_s=FRESH_S, sighting_age_s=FRESH_S)
    return with_nt4(replace(shipped, tick_hz=HZ, gate=gate, apriltag=AprilTag((4,), 0.1651, 1.23, 0.3)), nt4)


def _camera_of(trouble: Key) -> str:
    return next((table for table in CAMERAS if trouble.key.startswith(f"{table}/")), "")


def play_keys(row: Row, trouble: Key, folder: Path) -> None:
    """Record the run in `folder`/session."""
    config, clock = make_config(trouble), StepClock(lambda t_ns: None)
    began_ns = clock.now_ns()
    begin_ns = began_ns + round(BEGIN_S * NS)
    end_ns = begin_ns + round(row.lasts_s * NS)
    robot = Robot(trouble, begin_ns, end_ns)
    nt4 = nt4_of(config)
    assert nt4 is not None
    rig = AdviceIo(config, MAP, robot, clock, lambda: clock.now_ns() >= end_ns + AFTER_S * NS, 0.05,
                   NtCamera(config, robot, clock) if nt4.vision else None,
                   NtVelocity(config, robot, clock) if nt4.velocity else None)
    header = replace(make_header(config, None, None), policy=ADVICE)
    recorder = SessionWriter(folder / "session", header, config, None, lossless=True)
    run(rig, config, AGREES, recorder, advise_step)
    recorder.close()
    (folder / "keys.json").write_bytes(msgspec.json.encode((begin_ns, end_ns)))


def judge_keys(row: Row, trouble: Key, folder: Path, result: Any) -> None:
    """Fill in `result` (benchmarks.matrix.judge.Result)."""
    ticks = [tick for tick, _ in TickReader(folder / "session")]
    begin_ns, end_ns = msgspec.json.decode((folder / "keys.json").read_bytes(), type=tuple[int, int])
    fires = [tick.inputs.t_ns for tick in ticks if tick.verdict.fire]
    result.fires, result.outcome = len(fires), "HOLD"
    if not any(t_ns < begin_ns for t_ns in fires):
        result.wrong.append("had not fired before")
    result.stale = sum(begin_ns + round(row.within_s * NS) < t_ns < end_ns for t_ns in fires)
    if result.stale:
        result.wrong.append(f"fired {result.stale} times while it stood")
    held = first_hold(row, ticks, begin_ns)
    if held is None or held[0] > row.within_s:
        result.wrong.append(f"no HOLD with its reason within {row.within_s:.2f} s")
    else:
        result.hold_s, result.reason = held
    again = next((t_ns for t_ns in fires if t_ns > end_ns), None)
    result.recovery_s = None if again is None else (again - end_ns) / NS
    if again is None:
        result.wrong.append("never fired again")
    result.wrong += replays(folder / "session", make_config(trouble), AGREES, partial(advise_step, aims={}))


def first_hold(row: Row, ticks: Sequence[Tick], begin_ns: int) -> tuple[float, str] | None:
    """How soon a verdict held with the row's reason, and its text."""
    return next((((tick.inputs.t_ns - begin_ns) / NS, text(reason)) for tick in ticks
                 if tick.inputs.t_ns >= begin_ns and not tick.verdict.fire
                 and (reason := find(row.reason, tick.verdict.reasons)) is not None), None)


def replays(session: Path, config: Config, gate: Any, *step: Any) -> list[str]:
    """A sentence where it replays otherwise."""
    rows = RecordedRows(TickReader(session))
    try:
        run(ReplayRig(rows), config, gate, Comparer(rows), *step)
    except Difference as difference:
        return [f"replays otherwise: {difference}"]
    return []
