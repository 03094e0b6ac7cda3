"""What `truearc run` and `truearc advise` publish of each tick as topics of NetworkTables: the gate's verdict."""

import math
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from msgspec import UNSET

from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock
from truearc.robot import reasons as because
from truearc.robot.aim import NOWHERE, as_at_rest
from truearc.robot.config.schema import Config
from truearc.robot.gate import Gate, load_gate
from truearc.robot.reasons import texts
from truearc.robot.runtime import Recorder
from truearc.robot.tick import ADVICE
from truearc.robot.types import Sent, Tick
from truearc_frc.advice import Keys
from truearc_frc.table import nt4_of

LOOK_S = 0.02                         # between looks for a newer tick
PATIENCE_S = 3.0                      # with a server that does not answer, before that is said
STALE = {code.name for code in (
    because.NT_LOST, because.KEY_MISSING, because.CAMERA_LOST, because.ROBOT_SPEED_UNKNOWN, because.DEVICE_STALE,
    because.DEVICE_NEVER_RECEIVED, because.TARGET_STALE, because.TARGET_NEVER_SEEN, because.TICKS_STALLED)}


class Topics(Protocol):
    """Where advice goes."""

    @property
    def connected(self) -> bool: ...

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None: ...

    def close(self) -> None: ...


class NtPublisher:
    """A screen (truearc.robot.runtime) whose thread alone has to do with the network.

    Of the ticks since it last published it takes the newest, but one with a FIRE before any other: that is one tick
    for each ball. clock: that of the ticks, by which `age_s` is brought up to date; None: time passes otherwise.
    gate_path: the model that is asked for the novelty; None: there is none.
    """

    def __init__(self, config: Config, topics: Topics, gate_path: Path | None, clock: Clock | None) -> None:
        self._config, self._topics, self._gate_path, self._clock = config, topics, gate_path, clock
        self._swap = threading.Lock()
        self._tick: Tick | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="nt4", daemon=True)
        self._thread.start()

    def show(self, tick: Tick) -> None:
        """Keep it for the thread."""
        with self._swap:
            if self._tick is None or tick.verdict.fire or not self._tick.verdict.fire:
                self._tick = tick

    def close(self) -> None:
        """End the thread, and the connection."""
        self._over.set()
        self._thread.join()
        self._topics.close()

    def _publish(self) -> None:
        gate = None if self._gate_path is None else load_gate(self._gate_path)
        looks, said = 0, False
        while not self._over.wait(LOOK_S):
            looks += 1
            if not said and (self._topics.connected or looks * LOOK_S >= PATIENCE_S):
                said = True
                self._say(self._topics.connected)
            with self._swap:
                tick, self._tick = self._tick, None
            if tick is not None:
                self._topics.publish(self._advice(tick, gate))

    def _advice(self, tick: Tick, gate: Gate | None) -> dict[str, float | str | tuple[str, ...]]:
        advice = advice_of(tick, self._config, gate)
        age_s = advice["age_s"]
        if self._clock is not None and isinstance(age_s, float) and not math.isnan(age_s):
            advice["age_s"] = age_s + (self._clock.now_ns() - tick.inputs.t_ns) / NS_PER_S
        return advice

    def _say(self, connected: bool) -> None:
        nt4 = nt4_of(self._config)
        print(f"truearc: NetworkTables server {nt4.server if nt4 else ''}: " + ("connected" if connected else
              "does not answer; nothing is published until it does"), file=sys.stderr)


class Adviser:
    """A Recorder that publishes each tick's verdict, then passes the tick on."""

    def __init__(self, recorder: Recorder, keys: Keys, config: Config, gate: Gate) -> None:
        self._recorder, self._keys, self._config, self._gate = recorder, keys, config, gate

    def record(self, tick: Tick, sent: Sent) -> None:
        """Publish, then record."""
        self._keys.publish(advice_of(tick, self._config, self._gate))
        self._recorder.record(tick, sent)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._recorder.keep_picture(picture)


def advice_of(tick: Tick, config: Config, gate: Gate | None) -> dict[str, float | str | tuple[str, ...]]:
    """Return the values to publish of a tick; NaN: not known.

    verdict: FIRE, HOLD, or STALE where a key is missing or old; age_s: of the oldest key. hood_deg, wheel_rad_s (of the
    motors), correction, lead_deg (to the left of the target): the aim file's, NaN and 0 where it has none; without one
    where the launcher is, and 0.
    """
    seen, verdict = tick.estimate, tick.verdict
    novelty = math.nan
    answered = verdict.p_two is not None
    if gate is not None and answered and seen.distance_m is not None and seen.hood_deg is not None:
        asked = as_at_rest(seen, tick.aim)
        novelty = _or_nan(gate.rate(asked.distance_m or 0.0, asked.motor_ratio, seen.hood_deg).novelty)
    oldest_ns = _oldest_ns(tick)
    word = "FIRE" if verdict.fire else (
        "STALE" if any(reason.code in STALE for reason in verdict.reasons) else "HOLD")
    hood_deg, ratio = _set_points(tick)
    free = config.rig.launcher.free_speed_rad_s or math.nan
    return {"p_two": _or_nan(verdict.p_two), "p_three": _or_nan(verdict.p_three), "verdict": word,
            "reasons": tuple(texts(verdict.reasons)), "novelty": novelty, "hood_deg": hood_deg,
            "wheel_rad_s": ratio * free,
            "correction": tick.aim.correction if isinstance(tick.aim.correction, float) else 0.0,
            "lead_deg": tick.aim.lead_deg if isinstance(tick.aim.lead_deg, float) else 0.0,
            "age_s": (tick.inputs.t_ns - oldest_ns) / NS_PER_S if oldest_ns else math.nan}


def _set_points(tick: Tick) -> tuple[float, float]:
    """(hood in degrees, share of the free speed), NaN where there are none."""
    has_launcher = tick.estimate.hood_deg is not None and tick.inputs.flywheels[0].t_ns
    if tick.aim.source in NOWHERE or (tick.aim.source == ADVICE and not has_launcher):
        return math.nan, math.nan
    return tick.aim.hood_deg, tick.aim.motor_ratio


def _oldest_ns(tick: Tick) -> int:
    """The stamp of the oldest key; 0 where one has never come. A motor of ours may not tell its battery."""
    inputs, motor, last = tick.inputs, tick.inputs.flywheels[0], tick.memory.last_sighting
    return min(motor.t_ns, motor.bus_t_ns or motor.t_ns, inputs.hood_angle.t_ns if inputs.hood_angle else 0,
               last.t_ns if last else 0, inputs.t_ns if inputs.velocity is UNSET else inputs.velocity.t_ns)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
