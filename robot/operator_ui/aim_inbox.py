"""The inbox for aim files that arrive while the robot runs: the page's requests, and the offer to the driver.

The page accepts two requests: to keep an aim file and to accept the offered one. Both require the token in the inbox's
`token` file. Each request becomes a file in the inbox. The control process reads the inbox, checks each aim file, keeps
it in the session and offers it to the driver. An offered file is not used until the driver accepts it while disarmed
(truearc.robot.aim).
"""

import hashlib
import hmac
import os
import secrets
import sys
import threading
from pathlib import Path

import msgspec
from msgspec import UNSET
from msgspec.structs import replace

from truearc.errors import InputError, load_bytes, reworded
from truearc.robot import aim_file, runtime, types
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui.what_if import Answer, QuestionError, make_answer
from truearc.robot.recording.files import DISK_ERRNOS, save_synced
from truearc.robot.recording.session import AIMS

LOOK_S = 1.0
TOKEN, ACCEPT = "token", "accept"
MAX_AIM_BYTES = 1 << 18


class AimInbox:
    """Watches a folder for the newest aim file. `aims`: all files that may be used; offered ones are added.

    `offer` is None until a file other than the initial one arrives; an earlier file that is stored again is offered
    again. A refused file is named on stderr, and the last offer remains.
    """

    def __init__(self, folder: Path, config: Config, session: Path, aims: dict[str, aim_file.AimFile]) -> None:
        self.offer: types.AimOffer | None = None
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
        """Offer the newest file if it has changed, and apply what was accepted on the page."""
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
            aim = aim_file.load_aim_for(path, self._config)
            if self.offer is None and "" in self._aims and self._aims[""].sha256 == aim.sha256:
                return
            if aim.sha256 not in self._aims:
                (self._session / AIMS).mkdir(exist_ok=True)
                save_synced(self._session / AIMS / f"{aim.sha256}.json", path.read_bytes())
        except (InputError, OSError) as error:
            print(f"truearc run: not offered: {error}", file=sys.stderr)
            return
        self._aims[aim.sha256] = aim
        self.offer = types.AimOffer(aim.sha256, aim.content.note)

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


class OfferingRig(runtime.RigLayer):
    """A RobotIo whose inputs include the offered aim file."""

    def __init__(self, rig: runtime.RobotIo, inbox: AimInbox) -> None:
        super().__init__(rig)
        self._inbox = inbox

    def read(self) -> types.Inputs | None:
        inputs, offer = self._rig.read(), self._inbox.offer
        if inputs is None or offer is None:
            return inputs
        accepted, self._inbox.accepted = self._inbox.accepted, None
        return replace(inputs, aim_offer=offer, aim_accept=UNSET if accepted is None else accepted)


class _Accept(msgspec.Struct, forbid_unknown_fields=True):
    sha256: str


class AimOrders:
    """Accepts requests for the inbox `folder`, where it creates the token if there is none.

    On a full disk the token stays unknown until the next start. OSError if it cannot be created for another reason.
    """

    def __init__(self, folder: Path, config: Config) -> None:
        self._folder, self._config = folder, config
        path, self._token = folder / TOKEN, secrets.token_urlsafe(18)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not path.exists() or not path.stat().st_size:             # empty: the disk was full
                path.unlink(missing_ok=True)
                with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
                    file.write(self._token + "\n")
            self._token = load_bytes(path).decode("ascii").strip()
        except OSError as error:
            if error.errno not in DISK_ERRNOS:
                raise

    def keep(self, authorization: str, body: bytes) -> Answer:
        """Put an aim file into the inbox: 201. QuestionError gives the reason otherwise."""
        self._check_token(authorization)
        half = self._folder / f".{secrets.token_hex(8)}"
        try:
            half.write_bytes(body)
            aim_file.load_aim_for(half, self._config)
            half.replace(self._folder / f"{hashlib.sha256(body).hexdigest()}.json")
        except InputError as error:
            raise QuestionError(400, str(error).replace(f"{half}: ", "")) from error
        except OSError as error:
            raise QuestionError(507, f"cannot be kept: {error.strerror or error}") from error
        finally:
            half.unlink(missing_ok=True)
        return make_answer({"said": "offered to the driver"}, 201)

    def accept(self, authorization: str, body: bytes) -> Answer:
        """Accept the file with that hash, {"sha256": ...}: 202. It takes effect if it is on offer.

        QuestionError says why not.
        """
        self._check_token(authorization)
        try:
            asked = msgspec.json.decode(body, type=_Accept)
        except (msgspec.MsgspecError, RecursionError) as error:
            raise QuestionError(400, reworded(str(error))) from error
        if not any(hashlib.sha256(one.read_bytes()).hexdigest() == asked.sha256 for one in self._folder.glob("*.json")):
            raise QuestionError(404, "sha256: no such aim file in the inbox")
        try:
            (self._folder / ACCEPT).write_text(asked.sha256, encoding="ascii")
        except (OSError, UnicodeEncodeError) as error:
            raise QuestionError(507, f"cannot be kept: {error}") from error
        return make_answer({"said": "taken if the launcher is disarmed and this file is on offer"}, 202)

    def is_token(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    def _check_token(self, authorization: str) -> None:
        if not self.is_token(authorization.removeprefix("Bearer ")):
            raise QuestionError(401, f"the token in the inbox's file {TOKEN!r} is needed")
