"""The SPARK as a Motor: its identification, setup and verification, and its heartbeat, which only the tick sends."""

from collections.abc import Mapping
from functools import partial

from msgspec.structs import replace

from truearc.hw import fault_codes as codes
from truearc.hw.devices.drivers import AskedMotor, DcMotor, duty_for, torque_of
from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import BadFrame, Frame, Order
from truearc.hw.reason import Reason

RETRY_NS = 100 * MS                   # how often a question without an answer is asked again
STALE_NS = 100 * MS                   # what is older than this is not driven by; a status frame that is on is younger


class SparkSetup:
    """The required status frames and parameters of one device.

    statuses: bit n: STATUS_n. settings: parameter -> value. takers: message -> handler of its frame, which may raise
    BadFrame.
    """

    def __init__(self, axis: spark.SparkAxis, statuses: int, settings: Mapping[int, float]) -> None:
        self.takers = {"GET_FIRMWARE_VERSION": self.take_version, "PARAMETER_WRITE_RESPONSE": self.take_setting,
                       "SET_STATUSES_ENABLED_RESPONSE": self._take_statuses}
        self._axis, self._statuses, self._settings = axis, statuses, settings
        self._asked_ns = -RETRY_NS
        self._statuses_ns = 0                     # since then a status frame has had a chance to come
        self.forget()

    def forget(self) -> None:
        """Treat everything that was confirmed as possibly lost."""
        self._version: tuple[int, int, int] | None = None
        self._statuses_on = False
        self._unset = dict(self._settings)        # settings that the device has not confirmed

    @property
    def is_ready(self) -> bool:
        return self._speaks_our_frames() and self._statuses_on and not self._unset

    def frames(self, t_ns: int, heard_ns: int) -> list[Frame]:
        """Return, once a tick, the next query towards a device that is ready; none while an answer may still arrive.

        heard_ns: when a status frame of those last came. Where they were on and stay away the device has been reset.
        """
        if self._statuses_on and t_ns - max(heard_ns, self._statuses_ns) > STALE_NS:
            self.forget()
        if self.is_ready or t_ns - self._asked_ns < RETRY_NS:
            return []
        self._asked_ns = t_ns
        if not self._speaks_our_frames():         # a refused one too: it may be exchanged or updated
            return [spark.make_version_query(self._axis)]
        if not self._statuses_on:
            return [spark.make_statuses(self._axis, self._statuses)]
        return [spark.make_setting(self._axis, parameter, value) for parameter, value in self._unset.items()]

    def fault(self) -> Reason | None:
        """Return why the device is not ready."""
        device = self._axis.device
        if self._version is None:
            return codes.SPARK_FIRMWARE_UNKNOWN(spark=device)
        if not self._speaks_our_frames():
            return codes.SPARK_FIRMWARE_UNSUPPORTED(spark=device, version=".".join(map(str, self._version)),
                                              oldest=spark.OLDEST_FIRMWARE, newest=spark.NEWEST_FIRMWARE)
        if not self._statuses_on:
            return codes.SPARK_STATUS_OFF(spark=device)
        if self._unset:
            return codes.SPARK_SETTINGS_UNCONFIRMED(spark=device, parameters=tuple(self._unset))
        return None

    def _speaks_our_frames(self) -> bool:
        return self._version is not None and (spark.OLDEST_FIRMWARE <= self._version[0] <= spark.NEWEST_FIRMWARE)

    def take_version(self, frame: Frame) -> None:
        """Take an answer to the version query; BadFrame for anything else."""
        spoke, self._version = self._speaks_our_frames(), spark.parse_version(self._axis, frame)
        if self._speaks_our_frames() and not spoke:
            self._asked_ns = -RETRY_NS            # the next question need not wait

    def _take_statuses(self, frame: Frame) -> None:
        were_on = self._statuses_on
        self._statuses_on = spark.parse_statuses(self._axis, frame) & self._statuses == self._statuses
        self._statuses_ns = frame.t_ns
        if self._statuses_on and not were_on:
            self._asked_ns = -RETRY_NS

    def take_setting(self, frame: Frame) -> tuple[int, float] | None:
        """Take an answer to a parameter write; raises as spark.parse_setting does."""
        answer = spark.parse_setting(self._axis, frame)
        if answer is None or answer[0] not in self._unset:
            return answer
        parameter, value = answer
        if spark.setting_bits(parameter, self._unset[parameter]) == spark.setting_bits(parameter, value):
            del self._unset[parameter]
        return answer


FEED_NS = 25 * MS                     # an unchanged duty is repeated this often, in case a frame was lost
HEARTBEAT_NS = 20 * MS                # a device's patience is five times this
LET_GO_NS = 100 * MS                  # how often the order to let go is repeated after a drive: a frame may be lost
FAULTS_STALE_NS = 1000 * MS           # STATUS_1 comes every 0.25 s
DEAF_NS = 150 * MS                    # a device that applies nothing for this long does not do as it is asked
LEAST_DUTY = 0.01                     # one smaller may be rounded away
LEAST_BUS_V = 5.5                     # below, a SPARK MAX does not work (REV's data sheet): the reading is wrong


class SparkHeartbeat:
    """The secondary heartbeat of all SPARKs on one bus: a single frame names every device that may drive.

    Whoever changes that has the frame sent at once; otherwise the first motor of a tick in which it is due sends it.
    """

    def __init__(self) -> None:
        self._devices: frozenset[int] = frozenset()
        self._sent_ns = -HEARTBEAT_NS

    def frames(self, device: int, enabled: bool, t_ns: int) -> tuple[Frame, ...]:
        devices = self._devices | {device} if enabled else self._devices - {device}
        if devices == self._devices and (not devices or t_ns - self._sent_ns < HEARTBEAT_NS):
            return ()                             # without a heartbeat no device is enabled either
        return (self._make(devices, t_ns),)

    def drop(self, device: int, t_ns: int) -> Frame:
        """Disable one device now, whether or not that was already sent."""
        return self._make(self._devices - {device}, t_ns)

    def _make(self, devices: frozenset[int], t_ns: int) -> Frame:
        self._devices, self._sent_ns = devices, t_ns
        return spark.make_heartbeat(devices)


class SparkMotor(AskedMotor):
    """A Motor that converts torques to duties.

    It drives only a device whose firmware it knows, whose status frames and settings it has seen confirmed, whose
    readings are fresh and which has no error. A reset loses all of that: it shows as status frames that stop, whereupon
    everything is asked for again, and as a warning. Errors, that warning among them, stand until the motor is wanted
    again: arming is the operator's re-arm. settings: parameter -> value, see spark.settings.
    """

    def __init__(self, axis: spark.SparkAxis, motor: DcMotor, heartbeat: SparkHeartbeat,
                 settings: Mapping[int, float]) -> None:
        self._setup = SparkSetup(axis, spark.STATUSES, settings)
        takers = {"STATUS_0": self._take_status_0, "STATUS_1": super().take, "STATUS_2": super().take,
                  **self._setup.takers, "GET_FIRMWARE_VERSION": self._take_version}
        self._messages = tuple(takers)
        self._takers = {spark.frame_id(axis, name): take for name, take in takers.items()}
        super().__init__(spark.name_of(axis), self._takers, True, partial(spark.parse, axis),
                         spark.make_version_query(axis))
        self._axis, self._motor, self._heartbeat = axis, motor, heartbeat
        self._wanted = False
        self._duty: float | None = None           # what the device was last sent; None: it is not to drive
        self._fed_ns = 0
        self._let_go_ns = 0                       # when it was last told to let go; 0: it has not been driven
        self._applied = 0.0
        self._heeded_ns = 0                       # when it last did as it was asked
        self._drove_ns = 0
        self._deaf = False                        # it did not; stands until it does, or is wanted again

    def take(self, frame: Frame) -> None:
        taker = self._takers.get(frame.arbitration_id)
        if taker is None:
            raise BadFrame(codes.FRAME_UNEXPECTED(device=self._device, frame=frame.name, wanted=self._messages))
        taker(frame)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        others = super().faults(t_ns)
        if self._trip.is_measured and not self._trip.is_timely:
            return others                         # late frames would have it look as if it had been reset
        fault = self._setup.fault() or self._driving_fault(t_ns)
        return others if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        frames = self._rearm() if torque_nm is not None and not self._wanted else []
        self._wanted = torque_nm is not None
        frames += self._ask(t_ns)
        order = self._stop(t_ns) if torque_nm is None or not self._may_drive(t_ns) else self._drive(torque_nm, t_ns)
        return order._replace(frames=(*frames, *order.frames))

    def release(self) -> tuple[Frame, ...]:
        return spark.make_duty(self._axis, 0.0), self._heartbeat.drop(self._axis.device, 0)

    def _ask(self, t_ns: int) -> list[Frame]:
        """Questions of the setup, and how late the device comes; the version answers both, and is asked once a time."""
        frames = self._setup.frames(t_ns, self.reading.t_ns + self._trip.late_ns)
        if self._trip.is_due or self._question not in frames:
            return [*(frame for frame in frames if frame != self._question), *self._asked()]
        if self._trip.is_open:
            return []
        self._trip.asked()
        return frames

    # --- what comes

    def _take_version(self, frame: Frame) -> None:
        self._setup.take_version(frame)
        self._take_answer(frame)

    def _take_status_0(self, frame: Frame) -> None:
        super().take(frame)
        self._applied = spark.parse_applied(self._axis, frame)

    def _rearm(self) -> list[Frame]:
        if self.reading.axis_error & spark.HAS_RESET:
            self._setup.forget()                  # whatever it may have lost is set again before it drives
        self._deaf = False
        return [spark.make_clear_faults(self._axis)]

    # --- driving

    def _may_drive(self, t_ns: int) -> bool:
        reading = self.reading
        return (self._trip.is_timely and self._setup.is_ready and not reading.axis_error
                and reading.bus_v >= LEAST_BUS_V and _is_young(reading.t_ns, t_ns, STALE_NS)
                and _is_young(reading.bus_t_ns, t_ns, STALE_NS)
                and _is_young(reading.errors_t_ns or 0, t_ns, FAULTS_STALE_NS))

    def _drive(self, torque_nm: float, t_ns: int) -> Order:
        velocity_rad_s, bus_v = self.reading.velocity_rad_s, self.reading.bus_v
        duty = duty_for(self._motor, torque_nm, velocity_rad_s, bus_v)
        frames: list[Frame] = []
        heeds = not self._deaf and (duty != 0.0 or self._applied == 0.0)
        if duty != self._duty or not heeds or t_ns - self._fed_ns >= FEED_NS:
            self._fed_ns = t_ns
            frames.append(spark.make_duty(self._axis, duty))      # before the heartbeat: an old one may still stand
        self._note_whether_it_heeds(t_ns)
        self._duty = duty
        self._note_state(spark.IDLE if self._deaf else spark.DRIVEN)
        frames += self._heartbeat.frames(self._axis.device, True, t_ns)
        return Order(tuple(frames), torque_of(self._motor, duty, velocity_rad_s, bus_v), duty)

    def _stop(self, t_ns: int) -> Order:
        self._note_state(spark.IDLE if self._setup.is_ready else spark.UNKNOWN)
        again = self._let_go_ns and t_ns - self._let_go_ns >= LET_GO_NS
        if self._duty is None and not again:
            return Order()
        self._duty, self._let_go_ns = None, t_ns
        return Order((spark.make_duty(self._axis, 0.0), self._heartbeat.drop(self._axis.device, t_ns)))

    def _note_whether_it_heeds(self, t_ns: int) -> None:
        """Note whether the device applies its duty; the note outlasts the moment for which a feeder is driven."""
        asked = self._duty or 0.0
        stalled, self._drove_ns = t_ns - self._drove_ns > STALE_NS, t_ns     # it got no duty, so it coasted
        if abs(asked) < LEAST_DUTY or stalled:
            self._heeded_ns = t_ns
        elif self._applied * asked > 0.0 or (self.reading.endstop and asked < 0.0):
            self._heeded_ns, self._deaf = t_ns, False
        elif t_ns - self._heeded_ns > DEAF_NS:
            self._deaf = True

    def _driving_fault(self, t_ns: int) -> Reason | None:
        if not _is_young(self.reading.errors_t_ns or 0, t_ns, FAULTS_STALE_NS):
            return codes.SPARK_FAULTS_STALE(spark=self._axis.device)
        return codes.SPARK_NOT_DRIVING(spark=self._axis.device) if self._deaf else None

    def _note_state(self, state: int) -> None:
        if self.reading.axis_state != state:
            self.reading = replace(self.reading, axis_state=state)


def _is_young(stamp_ns: int, t_ns: int, limit_ns: int) -> bool:
    """Whether something was heard, and not longer ago than that."""
    return stamp_ns > 0 and t_ns - stamp_ns <= limit_ns
