"""Speed and position of one encoder go together, or one of them is wrong: it hangs, or its firmware does. No IO.

A launcher is fired by its speeds alone, and with a single motor nothing else would tell. Positions are of families that
count turns on without a wrap, as 32-bit floats; speeds may lag a little, and be stamped a little late.
"""

import struct
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from truearc.hw.fault_codes import ENCODER_MISMATCH, ENCODER_STUCK
from truearc.hw.protocols import MotorReading
from truearc.hw.reason import Reason

MS = 1_000_000
STILL_NS = 50 * MS                    # a position that does not change for so long, at a speed, is stuck
MOVING_RAD_S = 10.0
# Change of position and integral of the speeds are compared over the longer of these, or at least the shorter one:
# readings come every 10 or 20 ms, and a stamp that a busy adapter or tick made 20 ms late is then a tenth of it.
WINDOW_NS, LEAST_NS = 200 * MS, 150 * MS
GAP_NS = 50 * MS                      # after more silence than a lost frame or two make, it begins again ...
SETTLE_NS = 50 * MS                   # ... so much later: what was held back comes at once, stamped when it came
SHARE = 0.25                          # they may differ by this, twice the worst stamps, and by a speed below motion
GRAIN = 2.0 ** -23                    # of a 32-bit float
# Turns, or turns per second or minute, that an encoder may mean, unless it is 0: less than a count of the finest,
# 2**-32, is none, and less than 2**-24 is not usual; 1e8 take a year
LEAST_TURNS, USUAL_TURNS, MOST_TURNS = 2.0 ** -32, 2.0 ** -24, 1e8
FEW = 3                               # values, of which nothing is concluded


class _Told(NamedTuple):
    t_ns: int
    position_rad: float
    velocity_rad_s: float
    angle_rad: float                  # integral of the reported speeds


class Agreement:
    """Whether a motor's position has gone with its speed."""

    def __init__(self) -> None:
        self._still_ns = 0                        # since when it says that it turns and stands still; 0: it does not
        self._told: deque[_Told] = deque()
        self._from_ns = 0
        self._differ: tuple[float, float] | None = None          # reported speed, and that of the position

    def take(self, before: MotorReading, reading: MotorReading) -> None:
        """One reading and the one before it."""
        if reading.t_ns != before.t_ns:
            still = reading.position_rad == before.position_rad and abs(reading.velocity_rad_s) > MOVING_RAD_S
            self._still_ns = (self._still_ns or before.t_ns) if still else 0
        elif reading.position_rad == before.position_rad:
            return                                # a frame about something else, or one that came twice
        if not 0 <= reading.t_ns - before.t_ns <= GAP_NS:
            self._told.clear()
            self._differ, self._from_ns = None, reading.t_ns + SETTLE_NS
        if reading.t_ns >= self._from_ns:
            self._follow(reading)

    def fault(self, controller: str, reading: MotorReading) -> Reason | None:
        """None for an encoder that goes with its motor; `controller` names what reports it."""
        if self._still_ns and reading.t_ns - self._still_ns >= STILL_NS:
            return ENCODER_STUCK(controller=controller, speed_rad_s=reading.velocity_rad_s)
        if self._differ is None:
            return None
        reported, turned = self._differ
        return ENCODER_MISMATCH(controller=controller, speed_rad_s=reported, turned_rad_s=turned)

    def _follow(self, reading: MotorReading) -> None:
        told, t_ns, velocity = self._told, reading.t_ns, reading.velocity_rad_s
        angle = 0.0
        if told:
            last = told[-1]
            angle = last.angle_rad + (last.velocity_rad_s + velocity) / 2.0 * (t_ns - last.t_ns) * 1e-9
        told.append(_Told(t_ns, reading.position_rad, velocity, angle))
        while len(told) > 2 and told[1].t_ns <= t_ns - WINDOW_NS:
            told.popleft()
        self._differ = self._compare(told[0], told[-1])

    def _compare(self, first: _Told, last: _Told) -> tuple[float, float] | None:
        span_ns = last.t_ns - first.t_ns
        if span_ns < LEAST_NS:
            return None
        span_s = span_ns * 1e-9
        told, turned = (last.angle_rad - first.angle_rad) / span_s, (last.position_rad - first.position_rad) / span_s
        speeds = [one.velocity_rad_s for one in self._told]
        lag = max(speeds) - min(speeds)           # a filter reports a changing speed late
        grain = GRAIN * (abs(first.position_rad) + abs(last.position_rad)) / span_s
        allowed = MOVING_RAD_S + SHARE * max(abs(told), abs(turned)) + lag + grain
        return None if abs(told - turned) <= allowed else (told, turned)


def is_byte_swapped(values: Iterable[bytes]) -> bool:
    """Whether 32-bit floats are big-endian: read so, an encoder may mean each; little-endian, most are not usual.

    A float's exponent is where the other order has the end of its mantissa, which is 0 or anything.
    """
    told = [value for value in values if len(value) == 4 and any(value)]
    odd = sum(not _is_between("<f", value, USUAL_TURNS) for value in told)
    return len(told) >= FEW and 2 * odd > len(told) and all(_is_between(">f", value, LEAST_TURNS) for value in told)


def _is_between(order: str, value: bytes, least: float) -> bool:
    size: float = abs(struct.unpack(order, value)[0])
    return size == 0.0 or least <= size <= MOST_TURNS
