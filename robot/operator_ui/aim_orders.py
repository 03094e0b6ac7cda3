"""The two orders that the operator's page takes: keep an aim file for the driver, and accept the one on offer.

Both need the token in the inbox's file `token`. An order is a file in the inbox, which the control process looks into
(truearc.robot.processes.aim_inbox); it takes effect there, only while disarmed.
"""

import hashlib
import hmac
import os
import secrets
from pathlib import Path

import msgspec

from truearc.errors import InputError, load_bytes, reworded
from truearc.robot.aim_file import load_aim_for
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui.what_if import Answer, QuestionError, make_answer
from truearc.robot.recording.files import DISK_ERRNOS

TOKEN, ACCEPT = "token", "accept"
MAX_AIM_BYTES = 1 << 18


class _Accept(msgspec.Struct, forbid_unknown_fields=True):
    sha256: str


class AimOrders:
    """Takes orders for the inbox `folder`, where it makes the token if there is none.

    On a disk that is full the token stays unknown until the next start. OSError when it cannot be made otherwise.
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
        """Put an aim file into the inbox: 201. QuestionError says why not."""
        self._check_token(authorization)
        half = self._folder / f".{secrets.token_hex(8)}"
        try:
            half.write_bytes(body)
            load_aim_for(half, self._config)
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
