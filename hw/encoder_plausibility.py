"""Speed and position of one encoder go together, and no speed jumps, or the encoder or its firmware is wrong. No IO.

A launcher is fired by its speeds alone, and with a single motor nothing else would tell. Positions are of families that
count turns on without a wrap, as 32-bit floats; speeds may lag a little, and be stamped a little late.
"""

import struct
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from truearc.hw.fault_codes import ENCODER_MISMATCH, ENCODER_STUCK, SPEED_JUMPED
from truearc.hw.protocols import MotorReading
from truearc.hw.reason import Reason

MS = 1_000_000
STILL_NS = 50 * MS                    # a position that does not change for so long, at a speed, is stuck
MOVING_RAD_S = 10.0
# A ball slows the shipped wheels by 2.5 rad/s per ms, wheels of a fifth of their inertia by 8.4. Readings closer
# together than their usual period were held up on their way; a jump is told for as long as a tick may be late.
JUMP_RAD_S2, JUMP_LEAST_NS, JUMP_TOLD_NS = 10_000.0, 10 * MS, 100 * MS
# Change of position and integral of the speeds are compared over the longer of these, or at least the shorter one:
# readings come every 10 or 20 ms, and a stamp that a busy adapter or tick made 20 ms late is then a tenth of it.
WINDOW_NS, LEAST_NS = 200 * MS, 150 * MS
GAP_NS = 50 * MS                      # after more silence than a lost frame or two make, it begins again ...
SETTLE_NS = 50 * MS                   # ... so much later: what was held back comes at once, stamped when it came
SHARE = 0.25                          # they may differ by this, twice the worst stamps, ...
SLACK_RAD_S = 3.0                     # ... by this, the noise of a speed, ...
# ... and by what a filter of so long makes of a changing speed: a motor of ours has a quick one (a SPARK's is set to
# 8 ms), another controller's may have its maker's, of 0.1 s
OWN_LAG_S, LAG_S = 0.005, 0.2
LASTS_NS = 20 * MS                    # readings that were held up, and are stamped when they came, differ for less
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

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._still_ns = 0                        # since when it says that it turns and stands still; 0: it does not
        self._told: deque[_Told] = deque()
        self._from_ns = 0
        self._differ: tuple[float, float] | None = None          # reported speed, and that of the position
        self._differ_ns = 0                       # ... since then
        self._jump: tuple[int, float, float] | None = None       # when, from which speed, to which

    def take(self, before: MotorReading, reading: MotorReading) -> None:
        """One reading and the one before it."""
        if reading.t_ns != before.t_ns:
            gap_ns = max(reading.t_ns - before.t_ns, JUMP_LEAST_NS)
            if before.t_ns and not abs(reading.velocity_rad_s - before.velocity_rad_s) <= JUMP_RAD_S2 * gap_ns * 1e-9:
                self._jump = (reading.t_ns, before.velocity_rad_s, reading.velocity_rad_s)
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
        if self._differ is not None and reading.t_ns - self._differ_ns >= LASTS_NS:
            reported, turned = self._differ
            return ENCODER_MISMATCH(controller=controller, speed_rad_s=reported, turned_rad_s=turned)
        if self._jump is not None and reading.t_ns - self._jump[0] < JUMP_TOLD_NS:
            return SPEED_JUMPED(controller=controller, before_rad_s=self._jump[1], after_rad_s=self._jump[2])
        return None

    def _follow(self, reading: MotorReading) -> None:
        told, t_ns, velocity = self._told, reading.t_ns, reading.velocity_rad_s
        angle = 0.0
        if told:
            last = told[-1]
            angle = last.angle_rad + (last.velocity_rad_s + velocity) / 2.0 * (t_ns - last.t_ns) * 1e-9
        told.append(_Told(t_ns, reading.position_rad, velocity, angle))
        while len(told) > 2 and told[1].t_ns <= t_ns - WINDOW_NS:
            told.popleft()
        differ = self._compare(told[0], told[-1])
        if self._differ is None or differ is None:
            self._differ_ns = t_ns
        self._differ = differ

    def _compare(self, first: _Told, last: _Told) -> tuple[float, float] | None:
        span_ns = last.t_ns - first.t_ns
        if span_ns < LEAST_NS:
            return None
        span_s = span_ns * 1e-9
        told, turned = (last.angle_rad - first.angle_rad) / span_s, (last.position_rad - first.position_rad) / span_s
        speeds = [one.velocity_rad_s for one in self._told]
        slower = abs(last.velocity_rad_s) < abs(first.velocity_rad_s)     # stamps count more than what is turned
        lag_s = LAG_S if slower else 0.0 if abs(told) > abs(turned) else self._lag_s      # a filter runs behind
        lag = (max(speeds) - min(speeds)) * lag_s / span_s
        grain = GRAIN * (abs(first.position_rad) + abs(last.position_rad)) / span_s
        allowed = SLACK_RAD_S + SHARE * max(abs(told), abs(turned)) + lag + grain
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
