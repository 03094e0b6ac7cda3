"""The operator's page over HTTP: one page, and Server-Sent Events that tell it the newest tick. It takes no orders."""

import socket
import sys
import threading
from importlib.resources import files
from urllib.parse import urlsplit

import msgspec

from truearc.hw.protocols import Clock
from truearc.hw.readings import CameraFrame
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui.page_option import parse_page
from truearc.robot.operator_ui.page_state import Glance, look
from truearc.robot.operator_ui.serving import LocalHandler, LocalServer
from truearc.robot.operator_ui.view import describe
from truearc.robot.runtime import Recorder
from truearc.robot.types import Sent, Tick

PERIOD_S = 0.05                       # between two events for one browser
QUIET = 20                            # periods without a tick, then a comment: a browser that has gone shows by it
MOST_BROWSERS = 12
BEHIND_BYTES = 16384                  # of events that may wait for a slow browser; the system doubles it


class OperatorPage:
    """Shows whoever opens `url` the ticks that it is shown; OSError when it cannot listen there.

    `show` only keeps a tick; all else is done by the threads of the browsers that look, each as often as it can take
    it, from whatever is newest then. `clock` stamps what is sent, so that a browser can tell how old it is.
    `recording`: where ticks are recorded, "" = nowhere.
    """

    def __init__(self, config: Config, recording: str, host: str, port: int, clock: Clock) -> None:
        self._config, self._recording, self._clock = config, recording, clock
        self._glance = Glance()
        self._telling = threading.Lock()          # among browsers alone
        self._told: tuple[int, bytes] = (0, b"")
        self.over = threading.Event()
        self.room = threading.BoundedSemaphore(MOST_BROWSERS)
        self._server = _Server(host, port, self)
        self.url = self._server.url
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()

    def show(self, tick: Tick) -> None:
        """The newest tick. Called by one thread; never blocks."""
        self._glance = look(self._glance, tick)

    def newest(self) -> tuple[int, bytes]:
        """Number and event of the newest tick; 0 before the first."""
        glance = self._glance
        if glance.tick is None:
            return self._told
        with self._telling:
            if self._told[0] < glance.seq:
                view = describe(glance, glance.tick, self._config, self._recording)
                data = b'{"t_sent_s":%.3f,"view":%b}' % (self._clock.now_ns() * 1e-9, msgspec.json.encode(view))
                self._told = glance.seq, b"data: " + data + b"\n\n"
            return self._told

    def close(self) -> None:
        self.over.set()
        self._server.shutdown()
        self._server.server_close()


class ShowingRecorder:
    """A Recorder that also shows each tick on a page."""

    def __init__(self, recorder: Recorder, page: OperatorPage) -> None:
        self._recorder, self._page = recorder, page

    def record(self, tick: Tick, sent: Sent) -> None:
        self._recorder.record(tick, sent)
        self._page.show(tick)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._recorder.keep_picture(picture)


def open_page(text: str, config: Config, recording: str, clock: Clock) -> OperatorPage | None:
    """The page that `--page` names; None for "off", and with a warning where it cannot be served: the robot runs on."""
    where = parse_page(text)
    if where is None:
        return None
    try:
        page = OperatorPage(config, recording, *where, clock)
    except OSError as error:
        print(f"truearc: no operator's page on {text} ({error.strerror or error}); --page takes another port",
              file=sys.stderr)
        return None
    print(f"operator's page: {page.url}", file=sys.stderr)
    return page


def with_page(recorder: Recorder, page: OperatorPage | None) -> Recorder:
    """`recorder`, shown on the page if there is one."""
    return recorder if page is None else ShowingRecorder(recorder, page)


class _Server(LocalServer):
    def __init__(self, host: str, port: int, page: OperatorPage) -> None:
        super().__init__(host, port, _Handler)
        self.page = page


class _Handler(LocalHandler):
    server: _Server

    def do_GET(self) -> None:
        path = urlsplit(self.path).path
        if not self.is_ours():
            self.give(403, "text/plain", f"this page is opened as {self.server.url}".encode())
        elif path == "/":
            self.give(200, "text/html; charset=utf-8", (files("truearc.robot.operator_ui") / "page.html").read_bytes())
        elif path == "/events":
            self._admit()
        else:
            self.give(404, "text/plain", b"there is no such page")

    def _admit(self) -> None:
        room = self.server.page.room
        if not room.acquire(blocking=False):
            self.give(503, "text/plain", b"too many browsers look already")
            return
        try:
            self._tell()
        except OSError:
            pass                                  # it went away, or did not listen
        finally:
            room.release()

    def _tell(self) -> None:
        """Send events of ticks from now on, for as long as the browser takes them."""
        page = self.server.page
        (told, _), quiet = page.newest(), 0
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BEHIND_BYTES)
        self.give_head(200, "text/event-stream")
        self.end_headers()
        self.wfile.write(b"retry: 500\n\n")
        while not page.over.wait(PERIOD_S):
            seq, event = page.newest()
            quiet = 0 if seq != told else quiet + 1
            if seq != told:
                told = seq
                self.wfile.write(event)
            elif quiet % QUIET == 0:
                self.wfile.write(b": nothing new\n\n")
