"""Access to a robot's NetworkTables keys through WPILib's library: timestamped values, and published topics.

Timestamps are local. The library publishes a value when it changes, so a value's timestamp is that of its latest
change.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import ntcore

from truearc.errors import InputError
from truearc_frc.table import EXPECTED, server_parts

OURS = "/truearc/"
OLDER = "/AdvantageKit"               # where AdvantageKit puts what its log has under /RealOutputs and the like
PERIOD_S = 0.01                       # between what the server sends
IDENTITY = "truearc"
MOST_BITS = 64                        # of an integer
# WPILib's structs that are doubles alone, and how many; rotations in space are w, x, y, z
STRUCTS = {"Rotation2d": 1, "Translation2d": 2, "Translation3d": 3, "Pose2d": 3, "Transform2d": 3, "Twist2d": 3,
           "ChassisSpeeds": 3, "Pose3d": 7, "Transform3d": 7}


class Reading(NamedTuple):
    """Newest value of a key, a number (a boolean is 1 or 0) or text, and when it changed, on our clock."""

    t_ns: int
    value: float | str


class Keys(Protocol):
    """Source of keys; nothing waits."""

    @property
    def connected(self) -> bool: ...

    def read(self, now_ns: int) -> Mapping[str, Reading]: ...


class NtKeys:
    """Subscribes to keys of a server, by address or team number, and publishes `/truearc/...`; `close` ends both.

    Raises:
        InputError: `server` is not a team number or HOST[:PORT].
    """

    def __init__(self, server: str, keys: Sequence[str]) -> None:
        team, host, port = parse_server(server)
        self._now = ntcore._now                        # the library's clock, in us
        self._instance = ntcore.NetworkTableInstance.create()
        if team:
            self._instance.setServerTeam(team)
        else:
            self._instance.setServer(host, port)
        self._instance.startClient4(IDENTITY)
        # ours are sent again even where they are as before: who listens sees that they are fresh
        self._options = options = ntcore.PubSubOptions(periodic=PERIOD_S, keepDuplicates=True, sendAll=True)
        self._subscribed = {key: [self._instance.getTopic(name).genericSubscribe(options) for name in names_of(key)]
                            for key in keys}
        self._publishers: dict[str, Any] = {}
        self._stamps: dict[str, tuple[int, int]] = {}     # of each key's newest value: on the library's clock, on ours

    @property
    def connected(self) -> bool:
        return bool(self._instance.isConnected())

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        """Return every key that is present; now_ns: our clock."""
        now_us = self._now()
        found = {}
        for key, subscribers in self._subscribed.items():
            for subscriber in subscribers:
                timed = _reading(subscriber, key)
                if timed is not None:
                    found[key] = Reading(self._stamp(key, timed[0], now_us, now_ns), timed[1])
                    break
        return found

    def _stamp(self, key: str, changed_us: int, now_us: int, now_ns: int) -> int:
        """When a value changed, on our clock. Worked out once: the clocks are not read at one moment, and a value whose
        stamp wanders would seem to be a new one."""
        if self._stamps.get(key, (0, 0))[0] != changed_us:
            self._stamps[key] = changed_us, now_ns - max(now_us - changed_us, 0) * 1000
        return self._stamps[key][1]

    @property
    def offset_s(self) -> float | None:
        """Return the server's clock minus this library's; None while unknown."""
        offset_us = self._instance.getServerTimeOffset()
        return None if offset_us is None else offset_us * 1e-6

    def ahead_s(self) -> float:
        """Return by how much the newest timestamp is ahead of our clock; at most 0 if none is."""
        now_us = self._now()
        stamps = [subscriber.get().time() for subscribers in self._subscribed.values() for subscriber in subscribers
                  if subscriber.exists()]
        return (max(stamps) - now_us) * 1e-6 if stamps else -math.inf

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None:
        """Put values under /truearc/ and send them at once."""
        for name, value in values.items():
            if name not in self._publishers:
                self._publishers[name] = self._publisher(OURS + name, value)
            self._publishers[name].set(list(value) if isinstance(value, tuple) else value)
        self._instance.flush()

    def close(self) -> None:
        """Stop; published values disappear with the connection."""
        self._publishers.clear()
        self._subscribed.clear()
        self._instance.stopClient()

    def _publisher(self, name: str, value: float | str | Sequence[str]) -> Any:
        if isinstance(value, str):
            return self._instance.getStringTopic(name).publish(self._options)
        if isinstance(value, tuple):
            return self._instance.getStringArrayTopic(name).publish(self._options)
        return self._instance.getDoubleTopic(name).publish(self._options)


def parse_server(server: str) -> tuple[int, str, int]:
    """Return server_parts; InputError if `server` is neither a team number nor HOST[:PORT]."""
    parts = server_parts(server)
    if parts is None:
        raise InputError(f"NetworkTables: {server!r} is not a robot: {EXPECTED}")
    return parts


def names_of(key: str) -> list[str]:
    """Return topics that a map's key may be: the log's name without NT:, and where AdvantageKit publishes it.

    A key `/Name/0` may also be an element of an array or of a struct of doubles, or a bit of an integer (its lowest is
    0).
    """
    plain = "/" + key.removeprefix("NT:").lstrip("/")
    array = [plain.rpartition("/")[0]] if plain.rpartition("/")[2].isdigit() else []
    return [name for one in (plain, *array) for name in (one, OLDER + one)]


def _reading(subscriber: Any, key: str) -> tuple[int, float | str] | None:
    """When the newest value of a topic changed, on the library's clock in us, and that value."""
    value = subscriber.get()
    if not value.isValid() or not subscriber.exists():
        return None
    raw = value.value()
    if isinstance(raw, bytes):
        raw = _doubles(raw, subscriber.getTopic().getTypeString())
    if isinstance(raw, list | tuple):
        place = key.rpartition("/")[2]
        if not place.isdigit() or not int(place) < len(raw):
            return None
        raw = raw[int(place)]
    elif isinstance(raw, int) and not isinstance(raw, bool) and (bit := key.rpartition("/")[2]).isdigit() and (
            not subscriber.getTopic().getName().endswith(f"/{bit}")):
        raw = raw >> min(int(bit), MOST_BITS) & 1
    if not isinstance(raw, str | bool | int | float):
        return None
    return value.time(), raw if isinstance(raw, str) else float(raw)


def _doubles(raw: bytes, kind: str) -> tuple[float, ...]:
    """Of a WPILib struct that holds doubles alone, in the order of its schema; none of any other."""
    count = STRUCTS.get(kind.removeprefix("struct:"), 0)
    return struct.unpack(f"<{count}d", raw) if len(raw) == 8 * count else ()
