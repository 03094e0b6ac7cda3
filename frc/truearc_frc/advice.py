"""A RobotIo of NetworkTables keys: inputs as of a launcher of ours, and commands that go nowhere."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from msgspec import UNSET

from truearc.errors import InputError
from truearc.hw.protocols import NS_PER_S, AngleReading, ButtonEvent, CameraFrame, Clock, LinkLost, MotorReading
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config
from truearc.robot.config.shot_map import (
    MOTOR,
    NOT_MARKED,
    WHEEL,
    ShotMap,
    Signal,
    as_signal,
    factor_of,
    plain,
    unit_in,
)
from truearc.robot.gate import FEATURES
from truearc.robot.types import Command, Inputs, RobotVelocity, Sent, Sighting
from truearc_frc.keys import Reading

DISTANCE = "distance_m"
NEEDED = (DISTANCE, "hood_deg", "battery_v")
# Lowest and highest of a column that can be; of the motors' speed as a share of the free speed. Distance and hood: no
# launcher is beyond (gate's contract). Battery: FRC's, whose controller browns out at 6.3 V
POSSIBLE = {DISTANCE: (FEATURES[0].low, FEATURES[0].high), "hood_deg": (FEATURES[2].low, FEATURES[2].high),
            "battery_v": (6.0, 16.0), MOTOR: (-0.1, 1.1)}


class Keys(Protocol):
    """Where keys come from and advice goes."""

    @property
    def connected(self) -> bool: ...

    def read(self, now_ns: int) -> Mapping[str, Reading]: ...

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None: ...


class Camera(Protocol):
    """Sees the target for us."""

    def sight(self, found: Mapping[str, Reading]) -> Sighting | None: ...


class Driven(Protocol):
    """Says how the robot drives."""

    def take(self, found: Mapping[str, Reading]) -> RobotVelocity | None: ...


class AdviceIo:
    """Inputs from the keys of a map, `config.tick_hz` times a second; sigma_m: of the robot's own distance, which
    `camera` measures where there is one; driven: how it drives.

    Raises:
        InputError: the map lacks a column that advice needs, or states a unit that is not one of its column.
    """

    def __init__(self, config: Config, shot_map: ShotMap, keys: Keys, clock: Clock, over: Callable[[], bool],
                 sigma_m: float, camera: Camera | None = None, driven: Driven | None = None) -> None:
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


_BUTTONS = {"hit": "two", "miss": "miss-low", "low": "miss-low", "high": "miss-high",
            **dict.fromkeys(NOT_MARKED, "reject")}


class Scaled:
    """A key, how its number becomes one of a column, and the lowest and highest of those that can be."""

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
    """The columns that advice needs, by name; InputError as advised_columns, and for a unit that is none of its."""
    free = config.rig.launcher.free_speed_rad_s or math.inf
    return {column: Scaled(column, as_signal(said), free) for column, said in advised_columns(shot_map, config).items()}


def advised_columns(shot_map: ShotMap, config: Config) -> dict[str, str | Signal]:
    """The columns that advice needs, the speed as that of the motors; InputError names one that the map lacks."""
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
