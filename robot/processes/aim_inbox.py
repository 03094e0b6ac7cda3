"""Aim files that come while the robot runs: each is checked, kept in the session, and offered to the driver.

Nothing is aimed by an offered file until the driver presses "accept" while disarmed (truearc.robot.button_logic).
"""

import sys
import threading
from pathlib import Path

from msgspec.structs import replace

from truearc.hw.readings import CameraFrame
from truearc.robot.aim_file import AimFile, load_aim_for
from truearc.robot.config.schema import Config, InputError
from truearc.robot.recording.files import save_synced
from truearc.robot.recording.session import AIMS
from truearc.robot.runtime import RobotIo
from truearc.robot.types import AimOffer, Command, Inputs, Sent

LOOK_S = 1.0


class AimInbox:
    """Looks into a folder for the newest aim file. `aims`: every file that may be aimed by; those offered are added.

    `offer` is None as long as none has come. A file that is refused is named on stderr, and the last offer stays.
    """

    def __init__(self, folder: Path, config: Config, session: Path, aims: dict[str, AimFile]) -> None:
        self.offer: AimOffer | None = None
        self._folder, self._config, self._session, self._aims = folder, config, session, aims
        self._seen: tuple[str, int, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="aim inbox", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._over.set()

    def look(self) -> None:
        """Offer the newest file, if it is another than the last time; a file that is half there comes next time."""
        try:
            found = sorted((one.stat().st_mtime_ns, one.name, one.stat().st_size)
                           for one in self._folder.glob("*.json"))
        except OSError:
            return
        if not found or (now := (found[-1][1], found[-1][0], found[-1][2])) == self._seen:
            return
        self._seen, path = now, self._folder / now[0]
        try:
            aim = load_aim_for(path, self._config)
            if aim.sha256 in (one.sha256 for one in self._aims.values()):
                return
            (self._session / AIMS).mkdir(exist_ok=True)
            save_synced(self._session / AIMS / f"{aim.sha256}.json", path.read_bytes())
        except (InputError, OSError) as error:
            print(f"truearc run: not offered: {error}", file=sys.stderr)
            return
        self._aims[aim.sha256] = aim
        self.offer = AimOffer(aim.sha256, aim.content.note)

    def _watch(self) -> None:
        while not self._over.wait(LOOK_S):
            self.look()


class OfferingRig:
    """A RobotIo whose inputs say which aim file is on offer."""

    def __init__(self, rig: RobotIo, inbox: AimInbox) -> None:
        self._rig, self._inbox = rig, inbox

    def read(self) -> Inputs | None:
        inputs, offer = self._rig.read(), self._inbox.offer
        return inputs if inputs is None or offer is None else replace(inputs, aim_offer=offer)

    def write(self, command: Command) -> Sent:
        return self._rig.write(command)

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()
