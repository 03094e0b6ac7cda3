"""HardwareRig: any wires that keep hw.link's promises, real or emulated. ReplayRig: a recording."""

from collections.abc import Callable, Iterable, Iterator

from hw import canandmag, odrive
from hw.buttons import SEQ_COUNT, lost_presses, parse_lines
from hw.link import BadFrame, Bus, Clock, Frame, LinkLost, Stream
from hw.reading import AngleReading, ButtonEvent, CameraFrame, MotorReading
from robot.config import Axis, BadInput, Config
from robot.eyes import Eyes
from robot.types import Command, Inputs, Sent, Sighting, Tick

NS_PER_S = 1_000_000_000
RETRY_NS = 100_000_000                # how often an axis that will not come up is asked again
ENDSTOP_NS = 50_000_000               # how often the limit switch is read
FEED_NS = 25_000_000                  # an unchanged torque is repeated this often: the axes' watchdogs want to hear it
BOX_SILENT_NS = 1_500_000_000         # three missed heartbeats of the button box
CAN_LOST = "CAN lost: "               # how that fault begins


class HardwareRig:
    """Reads devices, writes commands, keeps the tick's time.

    `over` says, before each tick, whether there will be no more.
    """

    def __init__(self, config: Config, bus: Bus, box: Stream, eyes: Eyes, clock: Clock,
                 over: Callable[[], bool]) -> None:
        self._config, self._bus, self._box, self._eyes, self._clock = config, bus, box, eyes, clock
        self._over = over
        self._axes = [make_axis(axis) for axis in (*config.axes.flywheels, config.axes.hood, config.axes.feeder)]
        self._motors = [MotorReading() for _ in self._axes]
        self._encoder = canandmag.Encoder(config.hood_encoder.device)
        self._angle: AngleReading | None = None
        self._handlers = self._make_handlers()
        self._pending = b""
        self._heard_box_ns = 0
        self._box_seq: int | None = None
        self._cycle = 0
        self._due_ns = clock.now_ns()
        self._asked_ns = [0] * len(self._axes)
        self._asked_nm = [0.0] * len(self._axes)
        self._fed_ns = [0] * len(self._axes)
        self._endstop_ns = 0
        self._enabled = False
        self._started = False
        self._faults: list[str] = []
        self._frames = 0

    def read(self) -> Inputs | None:
        """Wait for the next tick, then gather what came in since the last one."""
        if self._over():
            return None
        period = NS_PER_S // self._config.tick_hz
        self._due_ns = max(self._due_ns + period, self._clock.now_ns())   # after a stall: skip, never burst
        self._clock.sleep_until_ns(self._due_ns)
        self._faults = []
        self._read_bus()
        t_ns = self._clock.now_ns()       # after the frames have their stamps: none may be from the tick's future
        buttons = self._read_box(t_ns)
        sighting = self._read_eyes()
        self._cycle += 1
        count = len(self._config.axes.flywheels)
        return Inputs(t_ns, self._cycle, tuple(self._motors[:count]), self._motors[count], self._motors[count + 1],
                      self._angle, sighting, tuple(buttons), tuple(self._faults), self._frames)

    def write(self, command: Command) -> Sent:
        """Send what keeps the axes in the asked state, then the torques; says what really went out."""
        t_ns = self._clock.now_ns()
        frames = self._housekeeping(command, t_ns)
        flywheel = self._clamp(command.flywheel_torque_nm, self._config.flywheel.pid.output_high)
        hood = self._clamp(command.hood_torque_nm, self._config.hood.pid.output_high)
        feeder = self._clamp(command.feeder_torque_nm, self._config.feeder.torque_nm)
        if command.enable:
            torques = [flywheel] * len(self._config.axes.flywheels) + [hood, feeder]
            frames += self._make_torques(torques, t_ns)
        refused = sum(not self._send(frame) for frame in frames)
        return Sent(command.enable, flywheel, hood, feeder, refused)

    def picture(self) -> CameraFrame | None:
        return self._eyes.picture()

    def release(self) -> None:
        """Leave every motor idle; for the end, whatever brought it."""
        for axis in self._axes:
            self._send(odrive.make_state(axis, odrive.IDLE))

    def _make_handlers(self) -> dict[int, Callable[[Frame], None]]:
        handlers: dict[int, Callable[[Frame], None]] = {}
        for index, axis in enumerate(self._axes):
            for frame_id in odrive.frame_ids(axis):
                handlers[frame_id] = self._make_motor_handler(index, axis)
        for frame_id in canandmag.frame_ids(self._encoder):
            handlers[frame_id] = self._take_angle
        return handlers

    def _make_motor_handler(self, index: int, axis: odrive.Axis) -> Callable[[Frame], None]:
        def take(frame: Frame) -> None:
            self._motors[index] = odrive.parse(axis, frame, self._motors[index])
        return take

    def _take_angle(self, frame: Frame) -> None:
        self._angle = canandmag.parse(self._encoder, frame, self._angle)

    def _read_bus(self) -> None:
        self._frames = 0
        try:
            frames = self._bus.read()
        except LinkLost as error:
            self._faults.append(f"{CAN_LOST}{error}")
            return
        self._frames = len(frames)
        handlers = self._handlers
        for frame in frames:
            handler = handlers.get(frame.arbitration_id)
            if handler is None or frame.is_remote:
                continue
            try:
                handler(frame)
            except BadFrame as error:
                self._faults.append(f"bad frame: {error}")

    def _read_box(self, t_ns: int) -> list[ButtonEvent]:
        try:
            events, self._pending, faults = parse_lines(self._pending, self._box.read(), t_ns)
        except LinkLost as error:
            self._pending = b""       # half a line that was on its way when the plug was pulled
            self._faults.append(f"button box lost: {error}")
            return []
        for event in events:
            self._heard_box_ns = t_ns
            # A press counts itself; a heartbeat repeats the number of the newest press.
            expected = event.seq if isinstance(event, ButtonEvent) else event.seq + 1
            if self._box_seq is not None and (lost := lost_presses(self._box_seq, expected)):
                # Half the count ahead is behind: a box that was without power counts from the start again.
                faults.append(f"{lost} presses lost" if lost < SEQ_COUNT // 2 else "restarted")
            self._box_seq = event.seq
        self._faults += [f"button box: {fault}" for fault in faults]
        if t_ns - self._heard_box_ns > BOX_SILENT_NS:
            self._faults.append("button box silent: outcomes cannot be marked")
        return [event for event in events if isinstance(event, ButtonEvent)]

    def _read_eyes(self) -> Sighting | None:
        try:
            return self._eyes.read()
        except LinkLost as error:
            self._faults.append(f"camera lost: {error}")
            return None

    def _housekeeping(self, command: Command, t_ns: int) -> list[Frame]:
        frames: list[Frame] = []
        if not self._started:
            self._started = True
            frames.append(canandmag.make_position_period(self._encoder, self._config.hood_encoder.period_ms))
        if command.enable and not self._enabled:
            frames += [odrive.make_clear_errors(axis) for axis in self._axes]   # arming is the operator's re-arm
        self._enabled = command.enable
        wanted = odrive.CLOSED_LOOP if command.enable else odrive.IDLE
        for index, axis in enumerate(self._axes):
            if self._motors[index].axis_state != wanted and t_ns - self._asked_ns[index] >= RETRY_NS:
                self._asked_ns[index] = t_ns
                frames += _make_state(axis, wanted)
        if t_ns - self._endstop_ns >= ENDSTOP_NS:
            self._endstop_ns = t_ns
            frames += [odrive.make_endstop_query(axis) for axis in self._axes if axis.endstop_endpoint]
        return frames

    def _make_torques(self, torques_nm: list[float], t_ns: int) -> list[Frame]:
        """A frame for each axis whose torque changed or whose watchdog wants feeding."""
        frames = []
        for index, torque_nm in enumerate(torques_nm):
            if torque_nm != self._asked_nm[index] or t_ns - self._fed_ns[index] >= FEED_NS:
                self._asked_nm[index], self._fed_ns[index] = torque_nm, t_ns
                frames.append(odrive.make_torque(self._axes[index], torque_nm))
        return frames

    def _send(self, frame: Frame) -> bool:
        try:
            return self._bus.write(frame)
        except LinkLost:
            return False              # the next read reports the lost bus

    @staticmethod
    def _clamp(torque_nm: float, limit_nm: float) -> float:
        return min(max(torque_nm, -abs(limit_nm)), abs(limit_nm))


class ReplayRig:
    """Plays recorded inputs; a command is answered by what was sent then."""

    def __init__(self, ticks: Iterable[Tick]) -> None:
        self._ticks: Iterator[Tick] = iter(ticks)
        self.recorded: Tick | None = None

    def read(self) -> Inputs | None:
        self.recorded = next(self._ticks, None)
        return None if self.recorded is None else self.recorded.inputs

    def write(self, command: Command) -> Sent:
        assert self.recorded is not None and self.recorded.sent is not None
        return self.recorded.sent

    def picture(self) -> CameraFrame | None:
        return None


def make_axis(axis: Axis) -> odrive.Axis:
    """The driver of one axis line of the configuration."""
    if axis.driver != "odrive":
        raise BadInput(f"axes: no driver called {axis.driver!r} (there is: odrive)")
    return odrive.Axis(axis.node, axis.direction, axis.endstop_endpoint)


def _make_state(axis: odrive.Axis, state: int) -> list[Frame]:
    if state == odrive.CLOSED_LOOP:
        return [odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH),
                odrive.make_state(axis, state)]
    return [odrive.make_state(axis, state)]
