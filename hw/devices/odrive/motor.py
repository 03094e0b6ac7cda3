"""An ODrive axis as a Motor: kept in closed loop while it is driven, its watchdog fed, and told to let go otherwise."""

from functools import partial

from truearc.hw.devices.heard_motor import AskedMotor
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.protocols import Frame, Order

RETRY_NS = 100_000_000                # how often orders to come up or to let go are repeated: a frame may be lost
ENDSTOP_NS = 50_000_000               # how often the limit switch is read
FEED_NS = 25_000_000                  # an unchanged torque is repeated this often: the watchdog wants to hear it


class OdriveMotor(AskedMotor):
    """A Motor that is given torques. Its errors stand until it is wanted again: arming is the operator's re-arm.

    Released, or while its readings come too late, it is ordered to give no torque and to go idle, whatever it says of
    itself. limits: its own, set before it is driven (odrive.make_limits); none where they are not known.
    """

    def __init__(self, axis: odrive.OdriveAxis, limits: Frame | None = None) -> None:
        super().__init__(odrive.name_of(axis), odrive.frame_ids(axis), False, partial(odrive.parse, axis),
                         odrive.make_version_query(axis))
        self._axis = axis
        self._ids = (*self._ids, (self._question.arbitration_id, False))
        mode = odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH)
        self._start = (mode, *(() if limits is None else (limits,)), odrive.make_state(axis, odrive.CLOSED_LOOP))
        self._stop = (odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE))
        self._wanted = self._driven = False
        self._asked_ns = -RETRY_NS
        self._endstop_ns = self._fed_ns = 0
        self._asked_nm = 0.0

    def take(self, frame: Frame) -> None:
        if frame.arbitration_id == self._question.arbitration_id:
            odrive.parse_version(self._axis, frame)
            self._take_answer(frame)
        else:
            super().take(frame)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        wanted = torque_nm is not None
        frames: tuple[Frame, ...] = (odrive.make_clear_errors(self._axis),) if wanted and not self._wanted else ()
        self._wanted = wanted
        driven_nm = torque_nm if self._trip.is_timely else None
        frames += self._keep_state(driven_nm is not None, t_ns) + self._asked()
        if self._axis.endstop_endpoint and t_ns - self._endstop_ns >= ENDSTOP_NS:
            self._endstop_ns = t_ns
            frames += (odrive.make_endstop_query(self._axis),)
        return Order(frames) if driven_nm is None else Order(frames + self._feed(driven_nm, t_ns), driven_nm)

    def release(self) -> tuple[Frame, ...]:
        return self._stop

    def _keep_state(self, driven: bool, t_ns: int) -> tuple[Frame, ...]:
        changed, self._driven = driven != self._driven, driven
        if not changed and ((driven and self.reading.axis_state == odrive.CLOSED_LOOP)
                            or t_ns - self._asked_ns < RETRY_NS):
            return ()
        self._asked_ns = t_ns
        if changed:
            self._fed_ns = t_ns - FEED_NS         # its torque is said at once
        return self._start if driven else self._stop

    def _feed(self, torque_nm: float, t_ns: int) -> tuple[Frame, ...]:
        if torque_nm == self._asked_nm and t_ns - self._fed_ns < FEED_NS:
            return ()
        self._asked_nm, self._fed_ns = torque_nm, t_ns
        return (odrive.make_torque(self._axis, torque_nm),)
