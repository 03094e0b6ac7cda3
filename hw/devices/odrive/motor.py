"""An ODrive axis as a Motor: kept in closed loop while it is wanted, its watchdog fed."""

from functools import partial

from truearc.hw.devices.heard_motor import HeardMotor
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.encoder_plausibility import OWN_LAG_S
from truearc.hw.protocols import Frame, Order

RETRY_NS = 100_000_000                # how often an axis that will not come up is asked again
ENDSTOP_NS = 50_000_000               # how often the limit switch is read
FEED_NS = 25_000_000                  # an unchanged torque is repeated this often: the watchdog wants to hear it


class OdriveMotor(HeardMotor):
    """A Motor that is given torques. Its errors stand until it is wanted again: arming is the operator's re-arm."""

    def __init__(self, axis: odrive.OdriveAxis) -> None:
        super().__init__(odrive.name_of(axis), odrive.frame_ids(axis), False, partial(odrive.parse, axis),
                         OWN_LAG_S)
        self._axis = axis
        self._wanted = False
        self._asked_ns = self._endstop_ns = self._fed_ns = 0
        self._asked_nm = 0.0

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        wanted = torque_nm is not None
        frames = [odrive.make_clear_errors(self._axis)] if wanted and not self._wanted else []
        self._wanted = wanted
        frames += self._keep_state(odrive.CLOSED_LOOP if wanted else odrive.IDLE, t_ns)
        if self._axis.endstop_endpoint and t_ns - self._endstop_ns >= ENDSTOP_NS:
            self._endstop_ns = t_ns
            frames.append(odrive.make_endstop_query(self._axis))
        if torque_nm is None:
            return Order(tuple(frames))
        return Order((*frames, *self._feed(torque_nm, t_ns)), torque_nm)

    def release(self) -> tuple[Frame, ...]:
        return (odrive.make_state(self._axis, odrive.IDLE),)

    def _keep_state(self, state: int, t_ns: int) -> list[Frame]:
        if self.reading.axis_state == state or t_ns - self._asked_ns < RETRY_NS:
            return []
        self._asked_ns = t_ns
        mode = [odrive.make_controller_mode(self._axis, odrive.TORQUE, odrive.PASSTHROUGH)]
        return [*(mode if state == odrive.CLOSED_LOOP else []), odrive.make_state(self._axis, state)]

    def _feed(self, torque_nm: float, t_ns: int) -> list[Frame]:
        if torque_nm == self._asked_nm and t_ns - self._fed_ns < FEED_NS:
            return []
        self._asked_nm, self._fed_ns = torque_nm, t_ns
        return [odrive.make_torque(self._axis, torque_nm)]
