"""The emulated robot's body: devices on a bus, attached to a world, advanced by the clock."""

from collections.abc import Callable

from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.protocols import Bus

Stepper = Callable[[int], None]


class Twin:
    """Emulated devices on `bus`, and the plant that they are attached to.

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
        """Let the devices hear what was sent, bring the world to `t_ns`, and let them speak when they are due."""
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
