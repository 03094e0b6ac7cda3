"""Aim files that come while the robot runs: each is checked, kept in the session, and offered to the driver.

Nothing is aimed by an offered file until the driver presses "accept" while disarmed (truearc.robot.button_logic).
"""

import sys
import threading
from pathlib import Path

from msgspec import UNSET
from msgspec.structs import replace

from truearc.errors import InputError, load_bytes
from truearc.robot.aim_file import AimFile, load_aim_for
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui.aim_orders import ACCEPT
from truearc.robot.recording.files import save_synced
from truearc.robot.recording.session import AIMS
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import AimOffer, Inputs

LOOK_S = 1.0


class AimInbox:
    """Looks into a folder for the newest aim file. `aims`: every file that may be aimed by; those offered are added.

    `offer` is None as long as none has come but the one that the robot started with; an earlier file that is put there
    again is offered again. A file that is refused is named on stderr, and the last offer stays.
    """

    def __init__(self, folder: Path, config: Config, session: Path, aims: dict[str, AimFile]) -> None:
        self.offer: AimOffer | None = None
        self.accepted: str | None = None          # on the page, and not told to a tick yet
        self._folder, self._config, self._session, self._aims = folder, config, session, aims
        self._seen: tuple[str, int, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="aim inbox", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._over.set()

    def look(self) -> None:
        """Offer the newest file, if it is another than the last time, and take what was accepted on the page."""
        self._look_for_acceptance()
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
            if self.offer is None and "" in self._aims and self._aims[""].sha256 == aim.sha256:
                return
            if aim.sha256 not in self._aims:
                (self._session / AIMS).mkdir(exist_ok=True)
                save_synced(self._session / AIMS / f"{aim.sha256}.json", path.read_bytes())
        except (InputError, OSError) as error:
            print(f"truearc run: not offered: {error}", file=sys.stderr)
            return
        self._aims[aim.sha256] = aim
        self.offer = AimOffer(aim.sha256, aim.content.note)

    def _look_for_acceptance(self) -> None:
        path = self._folder / ACCEPT
        try:
            said = load_bytes(path).decode("ascii")[:64]
            path.unlink()
        except (InputError, OSError, UnicodeDecodeError):
            return
        self.accepted = said

    def _watch(self) -> None:
        while not self._over.wait(LOOK_S):
            self.look()


class OfferingRig(RigLayer):
    """A RobotIo whose inputs say which aim file is on offer."""

    def __init__(self, rig: RobotIo, inbox: AimInbox) -> None:
        super().__init__(rig)
        self._inbox = inbox

    def read(self) -> Inputs | None:
        inputs, offer = self._rig.read(), self._inbox.offer
        if inputs is None or offer is None:
            return inputs
        accepted, self._inbox.accepted = self._inbox.accepted, None
        return replace(inputs, aim_offer=offer, aim_accept=UNSET if accepted is None else accepted)
