"""Emulated devices on the CAN bus, the interface to the world that they measure, and the clock that advances both.

`truearc.sim.world` implements this interface, `Plant`; the devices only quantise its values, delay them and put them on
the wire.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol

from truearc.hw.codec import Codec, Values
from truearc.hw.protocols import BadFrame, Bus, Frame

if TYPE_CHECKING:                     # every command loads this module, and most use no arrays
    import numpy as np
    import numpy.typing as npt



class MotorTruth(NamedTuple):
    """One motor as its own encoder and driver see it (a wrong encoder scale is already applied)."""

    position_rad: float
    velocity_rad_s: float
    torque_nm: float                  # really produced, after the torque-speed curve and the supply
    current_a: float


class View(NamedTuple):
    """Pose and lighting of the target before the camera. Camera axes: x right, y down, z along the optical axis
    (OpenCV).

    Target axes: x right and y up as the viewer sees them, z towards the viewer, origin in the tape's centre.
    """

    camera_from_target: "npt.NDArray[np.float64]" # (4, 4) rigid transform
    focal_scale: float                # 1.0; a camera whose focal length is not what its calibration says has another
    brightness: float                 # 1.0 = nominal ring light on the tape


class Scene(Protocol):
    """The surroundings of a camera."""

    def view(self) -> View: ...


class Plant(Scene, Protocol):
    """The physical robot and its surroundings, advanced by whoever owns the clock."""

    motors: tuple[str, ...]           # "flywheel_a", "flywheel_b", "hood", "feeder"

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        """Bring the world to `t_ns` with these motor torques (missing = 0, released)."""

    def motor(self, name: str) -> MotorTruth: ...

    def bus_v(self) -> float:
        """Supply voltage at the motor drivers now."""

    def hood_encoder_rad(self) -> float:
        """Elevation above horizontal at the hood pivot's magnet, plus its mounting error."""

    def hood_at_limit(self) -> bool:
        """Whether the limit switch at the hood's lowest elevation is closed."""


class Node(Protocol):
    """One device on the emulated bus. Times are the world's, in ns."""

    motor: str | None                             # the plant's motor that it drives, if any

    def ids(self) -> tuple[tuple[int, bool], ...]:
        """Return (arbitration id, is extended) of every frame that it receives."""

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Take one frame from the bus; return its immediate answer."""

    def due_ns(self) -> int:
        """Return when it next has something to do."""

    def step(self, t_ns: int) -> list[Frame]:
        """Do what is due by `t_ns`; return the frames to send."""

    def torque_nm(self) -> float:
        """Return the torque that it requests of its motor now; positive launches a ball or raises the hood."""

    def restart(self, t_ns: int) -> None:
        """Restore power: forget what was not stored, and count turns from 0 again."""


class Report:
    """One cyclic frame: every `period_ns`, first at `phase_ns`; 0 = never."""

    def __init__(self, period_ns: int, phase_ns: int, make: Callable[[], Frame]) -> None:
        self.make = make
        self.period_ns = period_ns
        self.due_ns = phase_ns if period_ns else NEVER_NS

    def set_period(self, period_ns: int, t_ns: int) -> None:
        """Report every `period_ns` from now on."""
        self.period_ns = period_ns
        self.due_ns = t_ns + period_ns if period_ns else NEVER_NS

    def take(self, t_ns: int) -> bool:
        """Return whether it is due, and then count it as sent; missed reports are skipped, never sent in a burst."""
        if self.due_ns > t_ns:
            return False
        self.due_ns += self.period_ns * (1 + (t_ns - self.due_ns) // self.period_ns)
        return True


NEVER_NS = 1 << 62


def take_reports(reports: tuple[Report, ...], t_ns: int) -> list[Frame]:
    """Return the frames that are due by `t_ns`, in the order of the tuple."""
    return [report.make() for report in reports if report.due_ns <= t_ns and report.take(t_ns)]


class ReportingNode:
    """The part of a Node that sends cyclic frames and counts malformed ones."""

    motor: str | None = None
    bad_frames = 0
    _reports: tuple[Report, ...]
    _torque_nm = 0.0
    _due_ns = 0

    def due_ns(self) -> int:
        return self._due_ns

    def torque_nm(self) -> float:
        return self._torque_nm

    def _plan(self, *other_ns: int) -> None:
        """Be due with the next report, or at the first of these times."""
        self._due_ns = min(*other_ns, NEVER_NS, *(report.due_ns for report in self._reports))

    def _parse(self, codec: Codec, message: str, frame: Frame) -> Values | None:
        """The frame's values; None for a malformed one, which is counted."""
        try:
            return codec.parse(message, frame.data)
        except BadFrame:
            self.bad_frames += 1
            return None


# --- all of them together

Stepper = Callable[[int], None]


class Twin:
    """Emulated devices on `bus`, and the plant to which they are attached.

    Within one `advance` the world stops whenever a device has something to do, so every frame says what was true when
    it was due, whatever the robot's own cadence. `steppers` (button box, camera, driver) run at its end, in order.
    """

    def __init__(self, plant: Plant, bus: Bus, nodes: tuple[Node, ...], steppers: tuple[Stepper, ...] = ()) -> None:
        self._plant, self._bus, self._nodes, self._steppers = plant, bus, nodes, steppers
        self._drives = tuple((node.motor, node) for node in nodes if node.motor is not None)
        self._t_ns = 0
        self._listeners: dict[tuple[int, bool], list[Node]] = {}
        for node in nodes:
            for key in node.ids():
                self._listeners.setdefault(key, []).append(node)

    def advance(self, t_ns: int) -> None:
        """Deliver what was sent to the devices, bring the world to `t_ns`, and let the devices send when they are
        due."""
        self._hear()
        self._speak()
        while self._t_ns < t_ns:
            due_ns = min((node.due_ns() for node in self._nodes), default=t_ns)
            self._t_ns = min(t_ns, max(due_ns, self._t_ns + 1))
            self._plant.advance(self._t_ns, {motor: node.torque_nm() for motor, node in self._drives})
            self._speak()
        for step in self._steppers:
            step(t_ns)

    def _hear(self) -> None:
        for frame in self._bus.read():
            for node in self._listeners.get((frame.arbitration_id, frame.is_extended), ()):
                for answer in node.receive(frame, self._t_ns):
                    self._bus.write(answer)

    def _speak(self) -> None:
        for node in self._nodes:
            if node.due_ns() <= self._t_ns:
                for frame in node.step(self._t_ns):
                    self._bus.write(frame)


class StepClock:
    """truearc.hw.protocols.Clock of a twin: sleeping advances the emulated world as fast as it can be computed."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        self._advance = advance
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Bring the world, and then the clock, to `t_ns`; do nothing if that is past."""
        if t_ns > self._now_ns:
            self._advance(t_ns)
            self._now_ns = t_ns
