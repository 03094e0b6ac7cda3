"""Advice over NetworkTables: a RobotIo that discards commands, and a publisher of the verdict of each tick."""

import math
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from msgspec import UNSET

from truearc.errors import InputError
from truearc.hw.protocols import NS_PER_S, AngleReading, ButtonEvent, CameraFrame, Clock, LinkLost, MotorReading
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.advice import ADVICE
from truearc.robot.aim import NOWHERE, as_at_rest
from truearc.robot.config.schema import Config
from truearc.robot.config.shot_map import NOT_MARKED, ShotMap, Signal, as_signal, plain
from truearc.robot.config.units import MOTOR, WHEEL, factor_of, unit_in
from truearc.robot.gate import FEATURES, Gate, load_gate
from truearc.robot.reasons import texts
from truearc.robot.runtime import Recorder
from truearc.robot.types import Command, Inputs, Sent, Sighting, Tick
from truearc_frc.inputs import NtCamera, NtVelocity
from truearc_frc.keys import Keys, NtKeys, Reading
from truearc_frc.table import nt4_of

DISTANCE = "distance_m"
NEEDED = (DISTANCE, "hood_deg", "battery_v")
# Lowest and highest of a column that can be; of the motors' speed as a share of the free speed. Distance and hood: no
# launcher is beyond (gate's contract). Battery: FRC's, whose controller browns out at 6.3 V
POSSIBLE = {DISTANCE: (FEATURES[0].low, FEATURES[0].high), "hood_deg": (FEATURES[2].low, FEATURES[2].high),
            "battery_v": (6.0, 16.0), MOTOR: (-0.1, 1.1)}


class AdviceIo:
    """Inputs from the mapped keys, `config.tick_hz` times a second.

    sigma_m: standard deviation of the robot's own distance. camera: measures the distance if given. driven: how the
    robot drives.

    Raises:
        InputError: the map lacks a column that advice needs, or states a unit that is not one of its column.
    """

    def __init__(self, config: Config, shot_map: ShotMap, keys: Keys, clock: Clock, over: Callable[[], bool],
                 sigma_m: float, camera: NtCamera | None = None, driven: NtVelocity | None = None) -> None:
        self._config, self._map, self._keys, self._clock, self._over = config, shot_map, keys, clock, over
        self._sigma_m, self._camera, self._driven = sigma_m, camera, driven
        self._unseen: Reason | None = None
        if config.hood_encoder.zero_deg is None:
            raise InputError("hood_encoder.zero_deg: missing key; advice does not home the hood")
        self._signals = scaled_columns(shot_map, config)
        self._feed = as_signal(shot_map.shots.feed).key if shot_map.shots.feed else None
        self._due_ns = clock.now_ns()
        self._cycle = self._seq = 0
        self._sighted_ns = 0
        self._last: dict[str, Reading] = {}       # of keys whose edges count

    def read(self) -> Inputs | None:
        """Wait for the next tick, then take every key's newest value."""
        if self._over():
            return None
        period = NS_PER_S // self._config.tick_hz
        turn_ns = self._due_ns + period
        self._due_ns = turn_ns + max(self._clock.now_ns() - turn_ns, 0) // period * period
        self._clock.sleep_until_ns(self._due_ns)
        t_ns = self._clock.now_ns()
        late_s = (t_ns - turn_ns) / NS_PER_S
        found = self._keys.read(t_ns)
        faults = [] if self._keys.connected else [because.NT_LOST()]
        if late_s > self._config.gate.reading_age_s:
            faults.append(because.TICKS_STALLED(stall_s=late_s))
        self._cycle += 1
        speed = self._number(MOTOR, found, faults)
        battery = self._number("battery_v", found, faults)
        motor = MotorReading() if speed is None or battery is None else MotorReading(
            t_ns=speed[0], velocity_rad_s=speed[1], heartbeat_t_ns=speed[0], bus_t_ns=battery[0], bus_v=battery[1])
        flywheels = (motor,) * len(self._config.axes.flywheels)
        return Inputs(t_ns, self._cycle, flywheels, MotorReading(), MotorReading(),
                      self._angle(self._number("hood_deg", found, faults)), self._see(found, faults),
                      self._presses(found, t_ns), tuple(faults), unseen=self._unseen,
                      velocity=(None if self._driven is None else self._driven.take(found)) or UNSET)

    def write(self, command: Command) -> Sent:
        """Send nothing."""
        return Sent(False, False, False, 0.0, 0.0, 0.0)

    def picture(self) -> CameraFrame | None:
        return None

    def _number(self, column: str, found: Mapping[str, Reading], faults: list[Reason]) -> tuple[int, float] | None:
        """(stamp, value in the column's unit); None, and a fault, where the key is not there, holds no number, or one
        that cannot be."""
        scaled = self._signals[column]
        reading = found.get(scaled.key)
        if reading is None or isinstance(reading.value, str) or not math.isfinite(reading.value):
            faults.append(because.KEY_MISSING(key=scaled.key))
            return None
        value = scaled.value(reading.value)
        if not scaled.low <= value <= scaled.high:
            faults.append(because.NT_VALUE_IMPOSSIBLE(key=scaled.key))
            return None
        if not scaled.alive:
            return reading.t_ns, value
        if scaled.alive not in found:
            faults.append(because.KEY_MISSING(key=scaled.alive))
            return None
        return max(reading.t_ns, found[scaled.alive].t_ns), value

    def _angle(self, hood: tuple[int, float] | None) -> AngleReading | None:
        """As the encoder of the configuration would read it."""
        if hood is None:
            return None
        encoder = self._config.hood_encoder
        turned = (encoder.zero_deg or 0.0) + hood[1] * encoder.direction
        return AngleReading(hood[0], math.radians(turned % 360.0), True)

    def _see(self, found: Mapping[str, Reading], faults: list[Reason]) -> Sighting | None:
        if self._camera is None:
            return self._sighting(self._number(DISTANCE, found, faults))
        try:
            sighting = self._camera.sight(found)
        except LinkLost as error:
            faults.append(because.CAMERA_LOST(cause=error.reason))
            return None
        if sighting is not None:
            self._unseen = sighting.reason
        return sighting

    def _sighting(self, distance: tuple[int, float] | None) -> Sighting | None:
        """Of a distance that has come since the last tick."""
        if distance is None or distance[0] <= self._sighted_ns:
            return None
        self._sighted_ns = distance[0]
        return Sighting(distance[0], True, None, distance[1] + self._config.camera.behind_exit_m, self._sigma_m)

    def _presses(self, found: Mapping[str, Reading], t_ns: int) -> tuple[ButtonEvent, ...]:
        """The feeder's starts as "fire", and the driver's marks."""
        words = []
        if self._feed is not None and self._rises(self._feed, found, self._map.shots.feed_above):
            words.append("fire")
        said = self._map.outcome
        if said.key and (mark := self._new(said.key, found)) is not None:
            meant = {plain(value): word for value, word in said.values.items()}
            words += [meant[plain(mark.value)]] if plain(mark.value) in meant else []
        words += [word for key, word in said.buttons.items() if self._rises(key, found, 0.5)]
        events = []
        for word in words:
            self._seq = (self._seq + 1) % 65536
            events.append(ButtonEvent(t_ns, self._seq, _BUTTONS.get(word, word)))
        return tuple(events)

    def _new(self, key: str, found: Mapping[str, Reading]) -> Reading | None:
        """A value that has come since the last tick; the first one is from before we were there."""
        reading, last = found.get(key), self._last.get(key)
        if reading is not None:
            self._last[key] = reading
        return reading if reading is not None and last is not None and reading.t_ns > last.t_ns else None

    def _rises(self, key: str, found: Mapping[str, Reading], above: float) -> bool:
        last = self._last.get(key)
        reading = self._new(key, found)
        return (reading is not None and last is not None and not isinstance(reading.value, str)
                and not isinstance(last.value, str) and last.value <= above < reading.value)


_BUTTONS = {"hit": "two", "high": "miss-high", "miss-long": "miss-high",
            **dict.fromkeys(("miss", "low", "miss-short", "miss-left", "miss-right"), "miss-low"),
            **dict.fromkeys(NOT_MARKED, "reject")}


class Scaled:
    """A key, its conversion to a column's number, and the lowest and highest plausible values."""

    def __init__(self, column: str, signal: Signal, free_rad_s: float) -> None:
        self.column, self.key, self.alive, self._signal = column, signal.key, signal.alive, signal
        scale = free_rad_s if column == MOTOR else 1.0
        self.low, self.high = (scale * end for end in POSSIBLE[column])
        stated = signal.unit or unit_in(signal.key)
        factor = factor_of(column, stated) if stated else (1.0, 0.0)
        if factor is None:
            raise InputError(f"{signal.key}: {stated!r} is not a unit of {column}; state unit = \"...\" in the map")
        self._factor, self._zero = factor

    def value(self, raw: float) -> float:
        return (raw * self._signal.times + self._signal.plus - self._zero) * self._factor


def scaled_columns(shot_map: ShotMap, config: Config) -> dict[str, Scaled]:
    """Return the columns that advice needs, by name; InputError as advised_columns, and for a wrong unit."""
    free = config.rig.launcher.free_speed_rad_s or math.inf
    return {column: Scaled(column, as_signal(said), free) for column, said in advised_columns(shot_map, config).items()}


def advised_columns(shot_map: ShotMap, config: Config) -> dict[str, str | Signal]:
    """Return the columns that advice needs, with the motors' speed; InputError names one that the map lacks."""
    columns = dict(shot_map.columns)
    speed = next((one for one in columns if one == MOTOR or WHEEL.fullmatch(one)), None)
    if speed is None:
        raise InputError(f"the map's columns name no {MOTOR} and no wheel: the gate needs a speed")
    needed = [column for column in NEEDED if not (config.is_seen_elsewhere and column == DISTANCE)]
    for column in needed:
        if column not in columns:
            raise InputError(f"the map has no columns.{column}, which advice needs")
    if speed == MOTOR:
        return {column: columns[column] for column in (MOTOR, *needed)}
    gears = {wheel.name: wheel.gear for wheel in config.rig.launcher.wheel}
    name = speed.removeprefix("wheel_").removesuffix("_rad_s")
    if name not in gears:
        raise InputError(f"{speed}: the rig has no wheel {name!r} ({', '.join(gears)})")
    wheel = as_signal(columns[speed])
    scaled = Signal(wheel.key, wheel.unit, wheel.times / gears[name], wheel.plus / gears[name], wheel.alive)
    return {MOTOR: scaled, **{column: columns[column] for column in needed}}


# --- publishing

LOOK_S = 0.02                         # between looks for a newer tick
PATIENCE_S = 3.0                      # with a server that does not answer, before that is said
STALE = {code.name for code in (
    because.NT_LOST, because.KEY_MISSING, because.CAMERA_LOST, because.ROBOT_SPEED_UNKNOWN, because.DEVICE_STALE,
    because.DEVICE_NEVER_RECEIVED, because.TARGET_STALE, because.TARGET_NEVER_SEEN, because.TICKS_STALLED)}


class NtPublisher:
    """A screen (truearc.robot.runtime) that accesses the network only from its own thread.

    It publishes the newest tick since the last publication, but prefers a tick with FIRE, of which there is one per
    ball. clock: clock of the ticks, which keeps `age_s` current; None: time passes otherwise. gate_path: the model that
    computes the novelty; None if there is none.
    """

    def __init__(self, config: Config, topics: NtKeys, gate_path: Path | None, clock: Clock | None) -> None:
        self._config, self._topics, self._gate_path, self._clock = config, topics, gate_path, clock
        self._swap = threading.Lock()
        self._tick: Tick | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="nt4", daemon=True)
        self._thread.start()

    def show(self, tick: Tick) -> None:
        """Keep the tick for the thread."""
        with self._swap:
            if self._tick is None or tick.verdict.fire or not self._tick.verdict.fire:
                self._tick = tick

    def close(self) -> None:
        """End the thread and the connection."""
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

    def __init__(self, recorder: Recorder, keys: NtKeys, config: Config, gate: Gate) -> None:
        self._recorder, self._keys, self._config, self._gate = recorder, keys, config, gate

    def record(self, tick: Tick, sent: Sent) -> None:
        """Publish, then record."""
        self._keys.publish(advice_of(tick, self._config, self._gate))
        self._recorder.record(tick, sent)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._recorder.keep_picture(picture)


def advice_of(tick: Tick, config: Config, gate: Gate | None) -> dict[str, float | str | tuple[str, ...]]:
    """Return the values to publish for a tick; NaN: not known.

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
