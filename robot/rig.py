"""Rigs, from which Inputs come and to which Commands go.

HardwareRig uses the wires of truearc.hw.protocols, and ReplayRig uses a recording. RecordingRig wraps a rig that is
being recorded and reports trouble with the recording, so that no shot is fired unless it is recorded.
"""

from collections.abc import Callable, Iterable, Iterator

from msgspec import UNSET
from msgspec.structs import replace

from truearc.hw import protocols as hw
from truearc.hw.devices.button_box import PressCount, parse_lines
from truearc.hw.devices.family import CHECK, Encoder
from truearc.hw.fault_codes import SPEED_JUMPED
from truearc.hw.protocols import NS_PER_S
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import Config
from truearc.robot.eyes import Eyes
from truearc.robot.motors import around_encoder, make_motors, name_axes, name_wheel
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import Command, Inputs, Sent, Sighting, Tick

BOX_SILENT_NS = 1_500_000_000         # three missed heartbeats of the button box
UNUSABLE = 3                          # frames in a row, of one kind; 30 ms of estimates at their usual rate
STALL_NS = 500_000_000                # for so long after ticks have stood still what comes in may have waited meanwhile


class HardwareRig:
    """Reads devices, writes commands, and keeps the tick's time.

    `over` tells, before each tick, whether to stop. `encoder`: None for the configuration's own.
    """

    def __init__(self, config: Config, bus: hw.Bus, box: hw.Stream, eyes: Eyes, clock: hw.Clock,
                 over: Callable[[], bool], encoder: Encoder | None = None) -> None:
        self._config, self._bus, self._box, self._eyes, self._clock = config, bus, box, eyes, clock
        self._over = over
        self._motors = make_motors(config)
        self._names = [name for name, _ in name_axes(config)]
        # a light screw or feeder changes its speed as fast as a wrong reading does
        self._wheels = {name_wheel(number) for number in range(1, len(config.axes.flywheels) + 1)}
        table = config.hood_encoder
        self._encoder = encoder or encoder_family_of(table).make(table, around_encoder(config))
        self._handlers = self._make_handlers()
        self._pending = b""
        self._heard_box_ns = 0
        self._presses = PressCount()
        self._missed: Reason | None = None
        self._garbled = False         # a press may have been in what was not understood: its next number will tell
        self._cycle = 0
        self._due_ns = clock.now_ns()
        self.late_ns = 0              # how long after its turn the newest tick came
        self._patience_ns = round(config.gate.reading_age_s * NS_PER_S)
        self._stood_ns = self._stalled_ns = 0     # for how long ticks have stood still, and until when
        self._read_ns = 0
        self._unsent = 0              # frames of the last tick that the bus did not take
        self._withheld: Reason | None = None      # why the ball that is being fed is not
        self._faults: list[Reason] = []
        self._frames = 0
        self._refused: dict[tuple[str, tuple[int, bool]], int] = {}     # frames in a row that could not be used
        self._is_lost = False         # the bus, when it was last read
        self._unseen: Reason | None = None        # why the newest image showed no target

    def read(self) -> Inputs | None:
        """Wait for the next tick, then gather what arrived since the last one."""
        if self._over():
            return None
        period = NS_PER_S // self._config.tick_hz
        turn_ns = self._due_ns + period
        missed = max(self._clock.now_ns() - turn_ns, 0) // period    # after a stall: skip, never burst, and keep step
        self._due_ns = turn_ns + missed * period
        self._clock.sleep_until_ns(self._due_ns)
        self.late_ns = self._clock.now_ns() - turn_ns
        self._faults = self._stall() + ([] if self._withheld is None else [self._withheld])
        self._read_bus()
        self._faults += self._bus.faults()
        sighting = self._read_eyes()
        self._read_ns = t_ns = self._clock.now_ns()       # nothing stamped on its way in is younger than the tick
        buttons = self._read_box(t_ns)
        for name, motor in zip(self._names, self._motors, strict=True):
            self._faults += [fault.about(motor=name) for fault in motor.faults(t_ns)
                             if fault.code != SPEED_JUMPED.name or name in self._wheels]
        angle = self._encoder.read(t_ns)
        self._faults += self._encoder.faults(t_ns)
        self._cycle += 1
        *flywheels, hood, feeder = (motor.reading for motor in self._motors)
        return Inputs(t_ns, self._cycle, tuple(flywheels), hood, feeder, angle, sighting, tuple(buttons),
                      tuple(self._faults), self._frames, self._unseen, self._missed)

    def write(self, command: Command) -> Sent:
        """Send each motor its command; return what was really sent."""
        t_ns = self._clock.now_ns()
        command = self._withhold(command, t_ns)
        frames = [] if self._is_lost else list(self._encoder.frames(t_ns))
        orders = [motor.order(torque_nm, t_ns)
                  for motor, torque_nm in zip(self._motors, self._torques_nm(command), strict=True)]
        for order in orders:
            frames += order.frames
        self._unsent = refused = sum(not self._send(frame) for frame in frames)
        return _sent(command, orders, refused)

    def picture(self) -> hw.CameraFrame | None:
        return self._eyes.picture()

    def release(self) -> None:
        """Leave every motor idle; called at the end, whatever caused it."""
        for motor in self._motors:
            for frame in motor.release():
                self._send(frame)

    def _stall(self) -> list[Reason]:
        """Ticks that stood still leave frames in queues, which are stamped when they are taken out: too young."""
        now_ns = self._clock.now_ns()
        if self.late_ns > self._patience_ns:
            self._stood_ns, self._stalled_ns = self.late_ns, now_ns + STALL_NS
        if now_ns >= self._stalled_ns:
            return []
        return [because.TICKS_STALLED(stall_s=self._stood_ns / NS_PER_S)]

    def _withhold(self, command: Command, t_ns: int) -> Command:
        """A tick that took too long knew its readings too long ago: its ball is not fed, now or in the next tick."""
        late_ns = t_ns - self._read_ns
        if command.feeder_torque_nm == 0.0:
            self._withheld = None
        elif self._withheld is None and late_ns > self._patience_ns:
            self._withheld = because.BALL_WITHHELD(late_s=late_ns / NS_PER_S)
        return command if self._withheld is None else replace(command, feeder_torque_nm=0.0)

    def _make_handlers(self) -> dict[tuple[int, bool], list[tuple[str, Callable[[hw.Frame], None]]]]:
        """What takes a frame, with its name: a motor, and the encoder that is on the same controller."""
        handlers: dict[tuple[int, bool], list[tuple[str, Callable[[hw.Frame], None]]]] = {}
        takers = [*((name, motor.ids(), motor.take) for name, motor in zip(self._names, self._motors, strict=True)),
                  (CHECK, self._encoder.ids(), self._encoder.take)]
        for name, keys, take in takers:
            for key in keys:
                handlers.setdefault(key, []).append((name, take))
        return handlers

    def _read_bus(self) -> None:
        self._frames = 0
        try:
            frames = self._bus.read()
        except hw.LinkLost as error:
            self._faults.append(because.CAN_LOST(cause=error.reason))
            self._is_lost = True
            return
        self._is_lost = False
        self._frames = len(frames)
        if self._unsent:
            self._faults.append(because.FRAMES_NOT_SENT(frames=self._unsent))
        handlers = self._handlers
        for frame in frames:
            key = (frame.arbitration_id, frame.is_extended)
            for name, take in () if frame.is_remote else handlers.get(key, ()):
                try:
                    take(frame)
                    if self._refused:
                        self._refused.pop((name, key), None)
                except hw.BadFrame as error:
                    self._refused[name, key] = self._refused.get((name, key), 0) + 1
                    self._faults.append(because.BAD_FRAME(cause=error.reason))
        self._faults += [because.FRAMES_UNUSABLE(motor=name, frames=count)
                         for (name, _), count in self._refused.items() if count >= UNUSABLE]

    def _read_box(self, t_ns: int) -> list[hw.ButtonEvent]:
        self._missed = None
        try:
            events, self._pending, faults = parse_lines(self._pending, self._box.read(), t_ns)
        except hw.LinkLost as error:
            self._pending, self._garbled = b"", True      # half a line was on its way when the plug was pulled
            self._faults.append(because.BOX_LOST(cause=error.reason))
            return []
        if events:
            self._heard_box_ns = t_ns
        presses, miscounted, self._missed = self._presses.take(events)
        self._garbled = bool(faults) or (self._garbled and not events)
        faults += [because.BOX_PRESS_UNCERTAIN()] if self._garbled and not faults else []
        self._faults += [*faults, *miscounted]
        if t_ns - self._heard_box_ns > BOX_SILENT_NS:
            self._faults.append(because.BOX_SILENT())
        return presses

    def _read_eyes(self) -> Sighting | None:
        try:
            sighting = self._eyes.read()
        except hw.LinkLost as error:
            self._unseen = None       # what an image showed before is no longer why
            self._faults.append(because.CAMERA_LOST(cause=error.reason))
            return None
        if sighting is not None:
            self._unseen = sighting.reason
        return sighting

    def _torques_nm(self, command: Command) -> list[float | None]:
        """Of each motor; None: released."""
        config = self._config
        wheel, hood, feeder = (min(max(torque_nm, -limit_nm), limit_nm) if enable else None
                               for enable, torque_nm, limit_nm in (
            (command.enable_flywheel, command.flywheel_torque_nm, abs(config.flywheel.pid.output_high)),
            (command.enable_hood, command.hood_torque_nm, abs(config.hood.pid.output_high)),
            (command.enable_feeder, command.feeder_torque_nm, abs(config.feeder.torque_nm))))
        return [*[wheel] * len(config.axes.flywheels), hood, feeder]

    def _send(self, frame: hw.Frame) -> bool:
        try:
            return self._bus.write(frame)
        except hw.LinkLost:
            return False              # the next read reports the lost bus


class ReplayRig:
    """Plays recorded inputs; a command returns what was sent when recording."""

    def __init__(self, ticks: Iterable[Tick]) -> None:
        self._ticks: Iterator[Tick] = iter(ticks)
        self.recorded: Tick | None = None

    def read(self) -> Inputs | None:
        self.recorded = next(self._ticks, None)
        return None if self.recorded is None else self.recorded.inputs

    def write(self, command: Command) -> Sent:
        assert self.recorded is not None and self.recorded.sent is not None
        return self.recorded.sent

    def picture(self) -> hw.CameraFrame | None:
        return None


class RecordingRig(RigLayer):
    """A rig whose inputs also report trouble with the recording; like any fault, it is a HOLD.

    `trouble`: why recorded data are not reaching the disk; None while they are.
    """

    def __init__(self, rig: RobotIo, trouble: Callable[[], Reason | None]) -> None:
        super().__init__(rig)
        self._trouble = trouble

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        trouble = self._trouble()
        if inputs is None or trouble is None:
            return inputs
        return replace(inputs, faults=(*inputs.faults, because.NOT_RECORDING(cause=trouble)))


def _sent(command: Command, orders: list[hw.Order], refused: int) -> Sent:
    *flywheels, hood, feeder = (order.torque_nm for order in orders)
    duties = tuple(order.duty for order in orders)
    return Sent(command.enable_flywheel, command.enable_hood, command.enable_feeder, sum(flywheels) / len(flywheels),
                hood, feeder, refused, UNSET if all(duty is None for duty in duties) else duties)
