"""The button box's cable in a run: it may be pulled out, chatter, or say what no box says."""

import os
from pathlib import Path

from truearc.hw.devices.button_box import ButtonBox
from truearc.hw.emulated.serial_link import Cable, open_cable

NOISE_NS = 20_000_000                 # between two lines of garbage, or two presses of a stuck button
NOISE = b"\x00\xffq$B,7,fi\xfe*3\n$B,8,fire*00\r\n"
MUTE = ("unplugged", "silent", "no power")
LOST = 3                              # presses


class CrookedCable:
    """A cable that may carry less than it is given, or more."""

    def __init__(self, cable: Cable) -> None:
        self.port = cable.port
        self.what = ""
        self._cable = cable

    def write(self, data: bytes) -> bool:
        if self.what in MUTE:
            return True
        lines = {"all twice": data + data, "half lines": data[:7]}
        return self._cable.write(lines.get(self.what, data))

    def read(self) -> bytes:
        return self._cable.read()

    def close(self) -> None:
        self._cable.close()


class BrokenBox:
    """A ButtonBox behind `port`, a link that leads to its cable. `prompt` as
    truearc.hw.emulated.serial_link.open_cable has it."""

    def __init__(self, link: Path, prompt: bool) -> None:
        self.port = str(link)
        self._link, self._prompt = link, prompt
        self._due_ns = self._stuck = 0
        self._plug_in()

    def press(self, button: str) -> None:
        self._box.press(button)
        if self._cable.what == "bounces":
            self._box.press(button)

    def step(self, t_ns: int) -> None:
        if self._cable.what == "unplugged":
            return
        self._box.step(t_ns)
        if t_ns >= self._due_ns:
            self._due_ns = t_ns + NOISE_NS
            if self._cable.what == "garbage":
                self._cable.write(NOISE)
            elif self._cable.what.startswith("stuck "):
                self._box.press(self._cable.what.removeprefix("stuck "))
                self._stuck += 1

    def begin(self, what: str) -> None:
        self._cable.what = "silent" if what == "loses presses" else what
        if what == "unplugged":
            self._link.unlink()
            self._box.unplug()
        elif what == "loses presses":
            for _ in range(LOST):
                self._box.press("two")
            self._cable.what = ""

    def end(self) -> None:
        what, self._cable.what = self._cable.what, ""
        if what == "unplugged":
            self._plug_in()
        elif what == "stuck arm" and self._stuck % 2:
            self._box.press("arm")                # the driver sees that the robot is disarmed
        elif what == "no power":
            self.restart()

    def restart(self) -> None:
        """Count from the start again."""
        self._box = ButtonBox(self._cable)

    def close(self) -> None:
        self._box.unplug()

    def _plug_in(self) -> None:
        self._cable = CrookedCable(open_cable(self._prompt))
        self._link.unlink(missing_ok=True)
        os.symlink(self._cable.port, self._link)
        self._box = ButtonBox(self._cable)
