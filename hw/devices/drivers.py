"""Code shared by motor drivers: receiving a motor's frames, checking its readings, converting torque to duty cycle.

Each reading is checked for plausibility (speed and position must be consistent) and for lateness (the time that the
device takes to answer a request). Drivers receive frames and times as arguments, so they need no I/O and no clock.
"""

import struct
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

from msgspec import UNSET, Struct
from msgspec.structs import replace

from truearc.hw import fault_codes as codes
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import Frame, MotorReading, Order
from truearc.hw.reason import Reason

# --- position and speed of one encoder

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
LOST_NS = 25 * MS                     # after a longer silence, in which a hood may have hopped, positions may be right
# ... and by what a filter of so long makes of a changing speed: a motor of ours has a quick one (a SPARK's is set to
# 8 ms), another controller's may have its maker's, of 0.1 s
OWN_LAG_S, LAG_S = 0.005, 0.2
# Or by less, where four times the lag is allowed for: a speed that is 26 % too low shows before wheels pass a set point
LESS_SHARE, MORE_LAG = 0.2, 4.0
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
    unseen_rad: float                 # by how much the position changed otherwise in long silences


class Agreement:
    """Check that a motor's position agrees with its speed."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._still_ns = 0                        # since when it says that it turns and stands still; 0: it does not
        self._told: deque[_Told] = deque()
        self._from_ns = 0
        self._differ: tuple[float, float] | None = None          # reported speed, and that of the position
        self._differ_ns = 0                       # ... since then
        self._jump: tuple[int, float, float] | None = None       # when, from which speed, to which

    def take(self, before: MotorReading, reading: MotorReading) -> None:
        """Take one reading and its predecessor."""
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
        """Return None for an encoder that agrees with its motor; `controller` names what reports it."""
        if self._still_ns and reading.t_ns - self._still_ns >= STILL_NS:
            return codes.ENCODER_STUCK(controller=controller, speed_rad_s=reading.velocity_rad_s)
        if self._differ is not None and reading.t_ns - self._differ_ns >= LASTS_NS:
            reported, turned = self._differ
            return codes.ENCODER_MISMATCH(controller=controller, speed_rad_s=reported, turned_rad_s=turned)
        if self._jump is not None and reading.t_ns - self._jump[0] < JUMP_TOLD_NS:
            return codes.SPEED_JUMPED(controller=controller, before_rad_s=self._jump[1], after_rad_s=self._jump[2])
        return None

    def _follow(self, reading: MotorReading) -> None:
        told, t_ns, velocity = self._told, reading.t_ns, reading.velocity_rad_s
        angle = unseen = 0.0
        if told:
            last = told[-1]
            gap_ns, unseen = t_ns - last.t_ns, last.unseen_rad
            by_speeds = (last.velocity_rad_s + velocity) / 2.0 * gap_ns * 1e-9
            angle = last.angle_rad + by_speeds
            if gap_ns > LOST_NS:
                unseen += reading.position_rad - last.position_rad - by_speeds
        told.append(_Told(t_ns, reading.position_rad, velocity, angle, unseen))
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
        larger = max(abs(told), abs(turned))
        allowed = SLACK_RAD_S + grain + min(SHARE * larger + lag, LESS_SHARE * larger + MORE_LAG * lag)
        off, unseen = told - turned, (last.unseen_rad - first.unseen_rad) / span_s
        return None if abs(off) <= allowed or abs(off + unseen) <= allowed else (told, turned)


def is_byte_swapped(values: Iterable[bytes]) -> bool:
    """Return whether 32-bit floats are big-endian: plausible if read so, and mostly implausible if read little-endian.

    A float's exponent is where the other byte order has the end of the mantissa, which is 0 or arbitrary.
    """
    told = [value for value in values if len(value) == 4 and any(value)]
    odd = sum(not _is_between("<f", value, USUAL_TURNS) for value in told)
    return len(told) >= FEW and 2 * odd > len(told) and all(_is_between(">f", value, LEAST_TURNS) for value in told)


def _is_between(order: str, value: bytes, least: float) -> bool:
    size: float = abs(struct.unpack(order, value)[0])
    return size == 0.0 or least <= size <= MOST_TURNS


# --- how late frames come

# From one question to the next, after an answer and without one. Each answer is counted from the newest question: one
# that is later than a gap looks early. With gaps that differ it does not four times running, for delays up to 4 s.
ANSWERED_NS = (1000 * MS, 850 * MS, 1150 * MS)
UNANSWERED_NS = (500 * MS, 350 * MS, 650 * MS)
COUNTED = 4                           # of this number of answers the shortest counts, unless one is later than LATE_NS
STEP_NS = 5 * MS                      # it is counted in steps of this: a little more or less does not move every stamp
HICCUP_NS = 30 * MS                   # what takes longer is asked again at once: something may have held it up once
LATE_NS = 100 * MS                    # later readings are of no use to a loop, however fresh the gate would have them
STALL_NS = 60 * MS                    # ticks come every 50 ms at least: after a longer gap the answer has waited for us
# Of questions and answers half may be lost, and 60 in a row are not in the life of a robot (0.75 ** 60 = 3e-8)
SILENT_NS = 30_000 * MS


class RoundTrip:
    """Queries to one device, once a second, and its answer times.

    device: its name in messages, such as "odrive node 1". `late_ns`: by how much its readings are older than they
    appear.
    """

    def __init__(self, device: str) -> None:
        self.late_ns = 0
        self.is_due = False           # a question is to be sent in this tick
        self.is_open = False          # the newest question has had no answer
        self.is_measured = self.is_timely = False     # timely: readings may be acted on
        self._device = device
        self._took_ns: deque[int] = deque(maxlen=COUNTED)
        self._asked_ns = self._due_ns = self._tick_ns = 0
        self._heard_ns: int | None = None         # when it last answered, or was first asked
        self._turn = 0
        self._unanswered = 0          # questions since the last answer
        self._doubted_ns = 0          # a long time that has not been confirmed; 0: none

    def tick(self, t_ns: int) -> None:
        """Call once a tick, with the tick's recorded time, before anything is sent."""
        self._tick_ns = t_ns
        if t_ns >= self._due_ns:
            self.is_due = True
            if self._heard_ns is not None and t_ns - self._heard_ns > SILENT_NS:
                self.is_timely = False

    def asked(self) -> None:
        """Note that the query is sent in this tick, with the tick's recorded time, which is slightly early."""
        t_ns = self._tick_ns
        if self._heard_ns is None:
            self._heard_ns = t_ns
        self._turn = (self._turn + 1) % len(UNANSWERED_NS)
        self.is_due, self.is_open = False, True
        self._unanswered += 1
        self._asked_ns, self._due_ns = t_ns, t_ns + UNANSWERED_NS[self._turn]

    def answered(self, t_ns: int) -> int:
        """Take an answer at `t_ns`; return the change of `late_ns`."""
        if self._heard_ns is None:
            return 0                  # to another host
        was_open, self.is_open, self._heard_ns = self.is_open, False, t_ns
        alone, self._unanswered = self._unanswered == 1, 0       # it is the answer to the newest question
        if t_ns - self._tick_ns > STALL_NS:
            self.is_timely = bool(self._took_ns) and max(self._took_ns) <= LATE_NS
            return 0                  # asked again without waiting for the usual time
        took_ns, doubted_ns = max(t_ns - self._asked_ns, 0), self._doubted_ns
        if alone and took_ns > HICCUP_NS and not doubted_ns and took_ns > self.late_ns:
            self._doubted_ns, self._due_ns = took_ns, t_ns
            return 0
        if was_open:
            self._due_ns = self._asked_ns + ANSWERED_NS[self._turn]
        self._doubted_ns = 0
        self._took_ns.append(max(took_ns, doubted_ns) if took_ns > HICCUP_NS else took_ns)
        longest_ns, before_ns = max(self._took_ns), self.late_ns
        # a delay of all frames is in the shortest, too, unless one of them shows that they were counted from the wrong
        # question; what some have beyond it is the computer's, which had other things to do
        steps_ns = -(-(longest_ns if longest_ns > LATE_NS else min(self._took_ns)) // STEP_NS) * STEP_NS
        if not before_ns - STEP_NS <= steps_ns <= before_ns:
            self.late_ns = steps_ns
        self.is_measured, self.is_timely = True, longest_ns <= LATE_NS
        return self.late_ns - before_ns

    def fault(self) -> Reason | None:
        """Return why the device's readings cannot be trusted; None while they can."""
        if self.is_timely:
            return None
        if not self.is_measured or self._heard_ns is None:
            return codes.FEEDBACK_UNMEASURED(controller=self._device)
        if (silence_ns := self._tick_ns - self._heard_ns) > SILENT_NS:
            return codes.CONTROLLER_NOT_ANSWERING(controller=self._device, silence_s=silence_ns * 1e-9)
        return codes.FEEDBACK_LATE(controller=self._device, delay_s=max(self._took_ns) * 1e-9)


# --- motors

Parse = Callable[[Frame, MotorReading], MotorReading]
STAMPS = ("t_ns", "heartbeat_t_ns", "current_t_ns", "bus_t_ns", "endstop_t_ns", "errors_t_ns")


class HeardMotor:
    """A truearc.hw.protocols.Motor that sends no frames, whatever torque it is given.

    device: its name in messages, such as "odrive node 1". frame_ids: the frames that `parse` understands.
    """

    _lag_s = LAG_S                    # by which its filter may report a changing speed late

    def __init__(self, device: str, frame_ids: Iterable[int], is_extended: bool, parse: Parse) -> None:
        self.reading = MotorReading()
        self._device, self._parse = device, parse
        self._ids = tuple((frame_id, is_extended) for frame_id in frame_ids)
        self._agreement = Agreement(self._lag_s)
        self._late_ns = 0             # by which its frames come late, as far as that is known

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._ids

    def take(self, frame: Frame) -> None:
        if self._late_ns:
            frame = older(frame, self._late_ns)
        before, self.reading = self.reading, self._parse(frame, self.reading)
        self._agreement.take(before, self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        fault = self._agreement.fault(self._device, self.reading)
        return () if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        return Order()

    def release(self) -> tuple[Frame, ...]:
        return ()


class AskedMotor(HeardMotor):
    """A motor that sends the remote frame `question` once a second; its readings are older by the answer time.

    `faults` is called before `order` in each tick, at the tick's own time.
    """

    _lag_s = OWN_LAG_S

    def __init__(self, device: str, frame_ids: Iterable[int], is_extended: bool, parse: Parse, question: Frame) -> None:
        super().__init__(device, frame_ids, is_extended, parse)
        self._question, self._trip = question, RoundTrip(device)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        trip = self._trip
        trip.tick(t_ns)
        fault = None if trip.is_timely else trip.fault()
        return super().faults(t_ns) if fault is None else (fault,)

    def _take_answer(self, frame: Frame) -> None:
        """An answer that has been found to be one."""
        if by_ns := self._trip.answered(frame.t_ns):
            self._late_ns += by_ns
            stamps = {name: stamp_ns - by_ns for name in STAMPS
                      if (stamp_ns := getattr(self.reading, name)) is not UNSET and stamp_ns > 0}
            self.reading = replace(self.reading, **stamps)
            self._agreement = Agreement(self._lag_s)          # it measures times between stamps, which have just moved

    def _asked(self) -> tuple[Frame, ...]:
        """The question, in a tick in which it is due."""
        if not self._trip.is_due:
            return ()
        self._trip.asked()
        return (self._question,)


def older(frame: Frame, late_ns: int) -> Frame:
    """Return a device's data frame, stamped with when it was sent, given that the device's frames arrive this late."""
    return Frame(frame.t_ns - late_ns, frame.arbitration_id, frame.data, frame.is_extended)


# --- torque and duty

class DcMotor(Struct, frozen=True):
    """Data sheet values of a motor, at the shaft to which the torques refer."""

    stall_torque_nm: float
    free_speed_rad_s: float
    rated_v: float


def duty_for(motor: DcMotor, torque_nm: float, velocity_rad_s: float, bus_v: float) -> float:
    """Return the duty that gives this torque now, or the nearest in [-1, 1]; `bus_v` must be above 0."""
    share = torque_nm / motor.stall_torque_nm + velocity_rad_s / motor.free_speed_rad_s
    return min(max(share * motor.rated_v / bus_v, -1.0), 1.0)


def torque_of(motor: DcMotor, duty: float, velocity_rad_s: float, bus_v: float) -> float:
    """Return the torque, in Nm, that a duty gives; the inverse of `duty_for` unless that was clipped."""
    return motor.stall_torque_nm * (duty * bus_v / motor.rated_v - velocity_rad_s / motor.free_speed_rad_s)
