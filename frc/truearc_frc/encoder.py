"""The hood's angle from a key of the robot's NetworkTables server as an EncoderFamily: another program's reading."""

import math
from collections.abc import Iterator, Mapping
from typing import Protocol

from truearc.errors import InputError
from truearc.hw.devices.family import CHECK, Around, Encoder, EncoderFamily, Finding, Heard, failure, ok
from truearc.hw.emulated.nodes import Plant
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import AngleReading
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.named_tables import ReadEncoder
from truearc_frc.keys import NtKeys, Reading
from truearc_frc.table import NAME

DEGREES = {"deg": 1.0, "rad": 180.0 / math.pi, "rev": 360.0}
MOST_DEG = 360.0                      # in size; more is not an angle of a hood, or not in this unit
SIGMA_DEG = 0.3                       # it is up to two of the robot's loops old, and so may a moving hood's be off
LOOP_NS = 20 * MS                     # of a robot program
LOOK_NS, STEP_NS = 2000 * MS, 5 * MS  # that the doctor waits for the server


class AngleKeys(Protocol):
    """Where keys come from; nothing waits."""

    @property
    def connected(self) -> bool: ...

    def read(self, now_ns: int) -> Mapping[str, Reading]: ...


class NtEncoder(Encoder):
    """The newest value of a key; its stamp is when it was published, so one that stays away grows old."""

    def __init__(self, table: ReadEncoder, keys: AngleKeys) -> None:
        self._key, self._deg, self._keys = table.key, DEGREES[table.unit], keys
        self._faults: tuple[Reason, ...] = ()

    def read(self, t_ns: int) -> AngleReading | None:
        found = self._keys.read(t_ns).get(self._key)
        self._faults = () if self._keys.connected else (because.NT_LOST(),)
        if found is None:
            self._faults += (because.KEY_MISSING(key=self._key),)
        elif isinstance(found.value, str) or not abs(angle_deg := found.value * self._deg) <= MOST_DEG:
            self._faults += (because.KEY_IMPLAUSIBLE(key=self._key, value=str(found.value)),)
        else:
            self.reading = AngleReading(found.t_ns, math.radians(angle_deg % 360.0), True)
        return self.reading

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        return self._faults


def examine(table: ReadEncoder, around: Around, heard: Heard) -> Iterator[Finding]:
    """Whether the server is there, has the key, and publishes it often enough."""
    try:
        keys = NtKeys(around.readings[NAME]["server"], [table.key])
    except InputError as error:
        yield failure(CHECK, str(error), "see nt4.server")
        return
    encoder, clock, last, changes = NtEncoder(table, keys), MonotonicClock(), 0, 0
    until_ns = clock.now_ns() + LOOK_NS
    while (now_ns := clock.now_ns()) < until_ns and changes < 3:
        reading = encoder.read(now_ns)
        if reading is not None and reading.t_ns - last > MS:      # two clocks: the same value's stamp moves a little
            last, changes = reading.t_ns, changes + 1
        clock.sleep_until_ns(now_ns + STEP_NS)
    keys.close()
    if faults := encoder.faults(now_ns):
        yield failure(CHECK, "; ".join(because.texts(faults)), "look at nt4.server, hood_encoder.key and unit")
    elif changes < 3:
        yield failure(CHECK, f"{table.key} stands still", "publish it in each loop, equal values too")
    else:
        yield ok(CHECK, f"{table.key} is published")


class _WorldKeys:
    """Keys of the emulated robot's own program: the angle as of its newest loop."""

    connected = True

    def __init__(self, table: ReadEncoder, plant: Plant) -> None:
        self._table, self._plant = table, plant
        self._newest: Reading | None = None

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        table = self._table
        if self._newest is None or now_ns - self._newest.t_ns >= LOOP_NS:
            angle_deg = table.zero_deg + table.direction * math.degrees(self._plant.hood_encoder_rad())
            self._newest = Reading(now_ns, angle_deg / DEGREES[table.unit])
        return {table.key: self._newest}


NT_ENCODER = EncoderFamily(
    driver=NAME, table=ReadEncoder, example=ReadEncoder(NAME, "/Hood/AngleDeg", "deg", 0.0, 1),
    least_sigma_deg=SIGMA_DEG,
    make=lambda table, around: NtEncoder(table, NtKeys(around.readings[NAME]["server"], [table.key])),
    make_rules=lambda table, each_tick: (), questions=lambda table: (), examine=examine,
    make_node=lambda table, plant, nodes: None,
    make_off_bus=lambda table, plant: NtEncoder(table, _WorldKeys(table, plant)))
