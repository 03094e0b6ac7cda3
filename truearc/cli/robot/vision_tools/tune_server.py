"""The page of `truearc vision tune` over HTTP, by the standard library alone; all that it loads comes from here."""

import json
from collections.abc import Callable
from importlib.resources import files
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from truearc.robot.config.schema import InputError
from truearc.robot.operator_ui.serving import LocalHandler, LocalServer

if TYPE_CHECKING:
    from truearc.cli.robot.vision_tools.tuner import Tuner

MOST_BYTES = 10_000                   # of what a page may send


class TuneServer(LocalServer):
    """Serves one tuner; OSError when the port is taken."""

    def __init__(self, tuner: "Tuner", host: str, port: int) -> None:
        super().__init__(host, port, _Page)
        self.tuner = tuner


class _Page(LocalHandler):
    server: TuneServer

    def do_GET(self) -> None:
        where, tuner = urlsplit(self.path), self.server.tuner
        query = {key: values[0] for key, values in parse_qs(where.query).items()}
        if not self.is_ours():
            self.give(403, "text/plain", b"this page is for this machine")
        elif where.path == "/":
            page = files("truearc.cli.robot") / "pages" / "tune.html"
            self.give(200, "text/html; charset=utf-8", page.read_bytes())
        elif where.path == "/state":
            self._answer(tuner.state)
        elif where.path == "/picture":
            self._answer(lambda: tuner.picture(int(query["index"]), query["view"], json.loads(query["settings"]),
                                               int(query.get("frame", 0))))
        else:
            self.give(404, "text/plain", b"there is no such page")

    def do_POST(self) -> None:
        tuner = self.server.tuner
        asked: dict[str, Callable[[dict[str, Any]], Any]] = {
            "/look": lambda said: tuner.look(said["index"], said["settings"]),
            "/replay": lambda said: tuner.replay(said["settings"], said.get("begin", 0)),
            "/save": lambda said: tuner.save(said["settings"]),
        }
        size = self.headers.get("Content-Length", "")
        if not self.is_ours():
            self.give(403, "text/plain", b"another site's page may not tune this robot")
        elif self.path not in asked or not size.isdecimal() or not 0 < int(size) <= MOST_BYTES:
            self.give(404, "text/plain", b"there is nothing of this name to do, or no settings with it")
        else:
            body = self.rfile.read(int(size))
            self._answer(lambda: asked[self.path](json.loads(body)))

    def _answer(self, make: Callable[[], Any]) -> None:
        """What `make` gives, or 400 with its complaint."""
        try:
            said = make()
        except (InputError, OSError, KeyError, TypeError, ValueError, RecursionError) as error:
            self.give(400, "text/plain; charset=utf-8", str(error).encode())
            return
        if isinstance(said, bytes):
            self.give(200, "image/jpeg", said)
        else:
            self.give(200, "application/json", json.dumps(said).encode())
