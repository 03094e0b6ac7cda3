"""An emulated button box on a serial cable."""

from truearc.hw.devices.button_box import frames as buttons
from truearc.hw.emulated.serial_link import Cable, open_cable


class ButtonBox:
    """The box: counts presses, and says every half second that it is there."""

    def __init__(self, cable: Cable, start_ns: int = 0) -> None:
        self.port = cable.port
        self._cable: Cable | None = cable
        self._seq = 0
        self._due_ns = start_ns

    def press(self, button: str) -> None:
        """One press of a button, at once; ValueError for an unknown one. Nothing is said once unplugged."""
        self._seq = (self._seq + 1) % buttons.SEQ_COUNT
        self._say(buttons.make_press(self._seq, button))

    def step(self, t_ns: int) -> None:
        """Say the heartbeat that is due by `t_ns`; those missed meanwhile are skipped."""
        if t_ns >= self._due_ns:
            self._due_ns += buttons.HEARTBEAT_NS * (1 + (t_ns - self._due_ns) // buttons.HEARTBEAT_NS)
            self._say(buttons.make_heartbeat(self._seq))

    def unplug(self) -> None:
        """Pull the cable out, for good; the robot's next read says so."""
        if self._cable is not None:
            self._cable.close()
            self._cable = None

    def _say(self, line: bytes) -> None:
        if self._cable is not None:
            self._cable.write(line)


def open_button_box(prompt: bool = True) -> ButtonBox:
    """A box on a cable; `prompt` as truearc.hw.emulated.serial_link.open_cable has it."""
    return ButtonBox(open_cable(prompt))
