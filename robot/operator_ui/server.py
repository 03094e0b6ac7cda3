"""The HTTP server for the operator page and other pages at the robot, using only the standard library.

The page receives the newest tick by Server-Sent Events. It also receives the gate's answers to queries (`POST
/predict`), which do not reach the robot. Sending an aim file (`PUT /aim`) and accepting it (`POST /accept`) require a
token (truearc.robot.operator_ui.aim_inbox).

No client can block the others, not even from a shared address (a tunnel, the robot's own screen). When the limit on the
number of connections is exceeded, the oldest connection whose request is still being read or answered is closed. The
number of long responses is limited as well.
"""

import gzip
import hmac
import secrets
import socketserver
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from io import BufferedReader, RawIOBase
from ipaddress import ip_address
from pathlib import Path
from socket import AF_INET, AF_INET6, SHUT_RDWR, SO_SNDBUF, SOL_SOCKET, gethostname, socket
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from truearc.hw.protocols import Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui import parse_page
from truearc.robot.operator_ui import what_if as asking
from truearc.robot.operator_ui.aim_inbox import MAX_AIM_BYTES, AimOrders
from truearc.robot.operator_ui.view import Glance, describe, look
from truearc.robot.operator_ui.what_if import WhatIfProcess
from truearc.robot.reasons import text
from truearc.robot.types import Sighting, Tick

MAX_CONNECTIONS = 96                  # of all clients; each is a thread, together 5 MB
MAX_OF_ADDRESS = 48                   # far more than all its places: a request has 0.1 s before 48 later ones end it
CROWDED_NS = 2_000_000                # between two clients when there are too many: no more than 500 threads a second
REQUEST_NS = 5_000_000_000            # for a whole request: an aim file of 256 KiB at half a megabit per second
PATIENCE_S = 2.0                      # for a client to accept each part of an answer
# A page loads nothing from anywhere, and other sites' pages get nothing from here.
POLICY = ("default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' data: blob:; "
          "connect-src 'self'")
WILD = ("", "0.0.0.0", "::")
CLOCK = MonotonicClock()


class Places(NamedTuple):
    """Places for clients with long responses: `most` in all, `of_address` per address; the last is for a known
    client."""

    most: int
    of_address: int


class LocalServer(ThreadingHTTPServer):
    """Listens on one address; OSError when it cannot."""

    daemon_threads = True
    request_queue_size = 128          # that wait to be accepted, 0.3 s in a crowd; one more asks again after a second

    def __init__(self, host: str, port: int, handler: type["LocalHandler"]) -> None:
        self.address_family = AF_INET6 if ":" in host else AF_INET
        self._lock = threading.Lock()
        self._clients: dict[socket, str] = {}     # address of each, in the order in which they came
        self._placed: dict[socket, Places] = {}   # of these, the clients that no other replaces
        super().__init__((host, port), handler)
        shown = f"[{host}]" if ":" in host else host
        self._own = {"localhost"} if host in WILD else {"localhost", host.lower()}
        self.url = f"http://{'localhost' if host in WILD else shown}:{self.server_port}/"

    def is_own_name(self, host: str) -> bool:
        """Return whether a Host header names this machine: by an address, its name or the name that it serves.

        Another site can make its own name point here (DNS rebinding), but cannot make its name one of these.
        """
        machine = gethostname().lower()
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in self._own | {machine, f"{machine.partition('.')[0]}.local"} or bool(ip_address(name))
        except ValueError:
            return False

    def server_bind(self) -> None:
        """Bind as the base class does, but without looking up this machine's name, which is slow without a name
        server."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        assert isinstance(request, socket)
        with self._lock:
            near = [one for one, address in self._clients.items() if address == client_address[0]]
            crowd = (near if len(near) >= MAX_OF_ADDRESS
                     else list(self._clients) if len(self._clients) >= MAX_CONNECTIONS else [])
            if crowd:                             # more than there are places
                oldest = next(one for one in crowd if one not in self._placed)
                del self._clients[oldest]
                with suppress(OSError):           # its thread ends by that
                    oldest.shutdown(SHUT_RDWR)
            self._clients[request] = client_address[0]
        if crowd:
            CLOCK.sleep_until_ns(CLOCK.now_ns() + CROWDED_NS)
        super().process_request(request, client_address)

    def shutdown_request(self, request: socket | tuple[bytes, socket]) -> None:
        assert isinstance(request, socket)
        with self._lock:              # not closed while it is being replaced: its number may be another file's then
            self._clients.pop(request, None)
            super().shutdown_request(request)

    @contextmanager
    def place(self, client: socket, places: Places, is_known: bool = False) -> Iterator[bool]:
        """Return whether `client` gets one of these places, which it then holds."""
        with self._lock:
            address = self._clients.get(client)   # None: it has been replaced
            taken = [self._clients[one] for one, kind in self._placed.items() if kind is places]
            is_free = address is not None and len(taken) < places.most and (
                is_known or (len(taken) < places.most - 1 and taken.count(address) < places.of_address))
            if is_free:
                self._placed[client] = places
        try:
            yield is_free
        finally:
            with self._lock:
                self._placed.pop(client, None)

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        """Ignore a browser that disconnects in the middle of a response."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Request(RawIOBase):
    """A client's request as it arrives; TimeoutError when reading all of it takes longer than REQUEST_NS."""

    def __init__(self, connection: socket) -> None:
        self._connection, self._until_ns = connection, CLOCK.now_ns() + REQUEST_NS

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left_ns = self._until_ns - CLOCK.now_ns()
        if left_ns <= 0:
            raise TimeoutError
        self._connection.settimeout(left_ns / 1e9)
        return self._connection.recv_into(buffer)


class LocalHandler(BaseHTTPRequestHandler):
    """Base of every page's handler; subclasses give the answers."""

    server: LocalServer

    def setup(self) -> None:
        super().setup()
        self.rfile.close()
        self.rfile = BufferedReader(_Request(self.connection))

    def is_ours(self) -> bool:
        """Return whether the request comes from our page, not from another site whose name was made to point here."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        return self.server.is_own_name(host) and (origin is None or origin.partition("://")[2] == host)

    def give(self, code: int, kind: str, body: bytes, **headers: str) -> None:
        """Send a response; `headers`: further headers, with _ for - in their names."""
        self.give_head(code, kind)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def give_head(self, code: int, kind: str) -> None:
        """Send the status and the headers, except those of the body."""
        self.connection.settimeout(PATIENCE_S)
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing: a line for each picture is of no use."""


PERIOD_S = 0.05                       # between two events for one browser
QUIET = 20                            # periods without a tick, then a comment: a browser that has gone shows by it
LOOKING = Places(12, 4)               # for browsers that look
REFUSED_S = 0.2                       # before a browser hears that it has no place: it may ask again at once
ASKING = Places(8, 2)                 # for questions to the gate, which answers one at a time
BEHIND_BYTES = 16384                  # of events that may wait for a slow browser; the system doubles it
DISCARD_BYTES = 1 << 16               # of a question that is too long; who sends more may not see why it was refused
PICTURE_S = 0.2                       # between two camera pictures, for all browsers together
SHARPNESS = 70                        # of their JPEG
FOUND_BGR, NOTE_BGR = (94, 201, 98), (77, 77, 239)
ASKED, KEPT, ACCEPTED, KIND = "/predict", "/aim", "/accept", "application/json"
LIMITS = {("POST", ASKED): asking.MAX_BODY_BYTES, ("POST", ACCEPTED): asking.MAX_BODY_BYTES,
          ("PUT", KEPT): MAX_AIM_BYTES}


Look = Callable[[], tuple[Sighting, npt.NDArray[np.uint8]] | None]


def look_nowhere() -> None:
    """Stand in for a camera that is not there."""


class OperatorPage:
    """Serves the ticks passed to `show` to every browser at `url`; OSError when it cannot listen there.

    `show` only keeps a tick. The threads of the connected browsers do the rest, each at the rate that its browser
    accepts, and always with the newest tick. `clock` stamps what is sent, so that a browser can tell how old it is.
    `recording`: where ticks are recorded, "" = nowhere. `what_if`: answers the page's questions to the gate. `orders`:
    takes aim files.
    """

    def __init__(self, config: Config, recording: str, host: str, port: int, clock: Clock,
                 what_if: asking.Answerer | None = None, orders: AimOrders | None = None) -> None:
        self._config, self._recording, self._clock = config, recording, clock
        self._glance = Glance()
        self._telling = threading.Lock()          # among browsers alone
        self._seeing = threading.Lock()
        self._look: Look = look_nowhere
        self._picture: tuple[int, bytes] = (0, b"")
        self._told: tuple[int, bytes] = (0, b"")
        self.over = threading.Event()
        self._server = PageServer(host, port, self, what_if, orders)
        self.url, self.token = self._server.url, self._server.token
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()

    def show(self, tick: Tick) -> None:
        """Keep the newest tick. Called by one thread; never blocks."""
        self._glance = look(self._glance, tick)

    def newest(self) -> tuple[int, bytes]:
        """Return the number and event of the newest tick; 0 before the first."""
        glance = self._glance
        if glance.tick is None:
            return self._told
        with self._telling:
            if self._told[0] < glance.seq:
                view = describe(glance, glance.tick, self._config, self._recording)
                data = b'{"t_sent_s":%.3f,"view":%b}' % (self._clock.now_ns() * 1e-9, msgspec.json.encode(view))
                self._told = glance.seq, b"data: " + data + b"\n\n"
            return self._told

    def see(self, look: Look) -> None:
        """Take camera pictures from there, whenever a browser asks for one."""
        self._look = look

    def picture(self) -> bytes:
        """Return the newest camera image with the detection drawn, as JPEG, new every PICTURE_S; empty without one."""
        with self._seeing:
            now_ns = self._clock.now_ns()
            if not self._picture[1] or now_ns - self._picture[0] >= PICTURE_S * 1e9:
                seen = self._look()
                self._picture = now_ns, self._picture[1] if seen is None else draw_sighting(*seen)
            return self._picture[1]

    def close(self) -> None:
        self.over.set()
        self._server.shutdown()
        self._server.server_close()
        if isinstance(self._server.what_if, WhatIfProcess):
            self._server.what_if.close()


def draw_sighting(sighting: Sighting, image: npt.NDArray[np.uint8]) -> bytes:
    """Return the image as JPEG, with the target's outline and distance, or why it was not found."""
    drawn = image.copy()
    if sighting.corners_px:
        outline = np.rint(np.array(sighting.corners_px)).astype(np.int32)
        cv2.polylines(drawn, [outline.reshape(-1, 1, 2)], True, FOUND_BGR, 2, cv2.LINE_AA)
    note = "" if sighting.reason is None else text(sighting.reason)
    if sighting.distance_m is not None:
        note = f"{sighting.distance_m:.2f} m"
    cv2.putText(drawn, note, (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, NOTE_BGR if sighting.reason else FOUND_BGR, 2,
                cv2.LINE_AA)
    return bytes(cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, SHARPNESS])[1])


def open_page(text: str, config: Config, recording: str, clock: Clock,
              gate_command: tuple[str, ...] = (), inbox: Path | None = None) -> OperatorPage | None:
    """Open the page that `--page` names; None for "off" or, with a warning, if it cannot be served: the robot runs
    on.

    `gate_command`: starts the process that answers questions to the gate; empty: the page has no gate.
    `inbox`: folder for aim files; None: the page takes none.
    """
    where = parse_page(text)
    if where is None:
        return None
    try:
        what_if = WhatIfProcess(gate_command) if gate_command else None
        orders = None if inbox is None else AimOrders(inbox, config)
        page = OperatorPage(config, recording, *where, clock, what_if, orders)
    except OSError as error:
        print(f"truearc: cannot serve the operator's page on {text} ({error.strerror or error}); choose another port "
              "with --page", file=sys.stderr)
        return None
    print(f"operator's page: {page.url}" + ("" if orders else f"; for the driver: {page.url}#token={page.token}"),
          file=sys.stderr)
    return page


class PageServer(LocalServer):
    """Serves the page; without `page` there is no robot and only the gate answers, without `what_if` it does not."""

    def __init__(self, host: str, port: int, page: OperatorPage | None, what_if: asking.Answerer | None,
                 orders: AimOrders | None = None) -> None:
        super().__init__(host, port, _Handler)
        self.page, self.what_if, self.orders = page, what_if, orders
        self.token = secrets.token_urlsafe(18)    # where there are no orders, which have one that stays

    def is_known(self, token: str) -> bool:
        """Return whether a client has the token."""
        if self.orders is not None:
            return self.orders.is_token(token)
        return hmac.compare_digest(token.encode(), self.token.encode())


class _Handler(LocalHandler):
    server: PageServer

    def do_GET(self) -> None:
        path = self._path()
        if not self.is_ours():
            self.give(403, "text/plain", f"this page is opened as {self.server.url}, or by this machine's "
                                         "address".encode())
        elif path == "/":
            self.give(200, "text/html; charset=utf-8", make_page(self.server.page is not None))
        elif path == "/events" and self.server.page is not None:
            self._admit(self.server.page)
        elif path == "/picture" and self.server.page is not None:
            picture = self.server.page.picture()
            self.give(*((200, "image/jpeg", picture) if picture else (404, "text/plain", b"no camera picture here")))
        elif path == "/gate":
            self._give_answer(asking.make_answer({}) if self.server.what_if is None
                              else self._ask(self.server.what_if.facts))
        elif path in (ASKED, KEPT, ACCEPTED):
            self._refuse_method()
        else:
            self.give(404, "text/plain", b"there is no such page")

    def do_POST(self) -> None:
        try:
            self._give_answer(self._answer(self._read_body()))
        except asking.QuestionError as error:
            self._give_answer(asking.make_refusal(error), **({"Allow": self._allowed()} if error.status == 405 else {}))

    do_PUT = do_POST

    def _answer(self, body: bytes) -> asking.Answer:
        path, server = self._path(), self.server
        if path == ASKED:
            if server.what_if is None:
                raise asking.QuestionError(404, "this page has no gate")
            return self._ask(partial(server.what_if.answer, body))
        if server.orders is None:
            raise asking.QuestionError(404, "this page takes no aim files; start with --aim-inbox")
        order = server.orders.keep if path == KEPT else server.orders.accept
        return order(self.headers.get("Authorization", ""), body)

    def _ask(self, question: Callable[[], asking.Answer]) -> asking.Answer:
        with self.server.place(self.connection, ASKING) as is_free:
            return question() if is_free else asking.make_refusal(
                asking.QuestionError(429, "too many questions at once", retry_s=1))

    def _path(self) -> str:
        return self.path.partition("?")[0]

    def _allowed(self) -> str:
        return next((method for method, at in LIMITS if at == self._path()), "GET")

    def _refuse_method(self) -> None:
        allowed = self._allowed()
        error = asking.QuestionError(405, f"{self.command}: expected {allowed}")
        self._give_answer(asking.make_refusal(error), Allow=allowed)

    do_DELETE = do_PATCH = do_OPTIONS = _refuse_method

    def _read_body(self) -> bytes:
        """The body of what may be answered; QuestionError with the status of the first objection."""
        most = LIMITS.get((self.command, self._path()))
        size = self.headers.get("Content-Length", "")
        length = int(size) if size.isdecimal() and len(size) < 10 else None
        # also of a refused one, which must hear of it
        body = self.rfile.read(min(length or 0, max(most or 0, DISCARD_BYTES)))
        if not self.is_ours():
            raise asking.QuestionError(403, f"requested from another site; open {self.server.url}, or this machine's "
                                       "address")
        if most is None:
            ways = ", ".join(f"{method} {at}" for method, at in LIMITS)
            raise asking.QuestionError(405, f"{self.command}: expected GET, or {ways}")
        if self.headers.get_content_type() != KIND:
            raise asking.QuestionError(415, f"got {self.headers.get('Content-Type')}; expected {KIND}", "Content-Type")
        if length is None:
            raise asking.QuestionError(411 if not size else 400, "expected the number of bytes", "Content-Length")
        if length > most:
            raise asking.QuestionError(413, f"{length} bytes; expected at most {most}")
        return body

    def _give_answer(self, answer: asking.Answer, **headers: str) -> None:
        body = answer.text
        if answer.retry_s:
            headers["Retry_After"] = str(answer.retry_s)
        if answer.is_compressed and "gzip" in self.headers.get("Accept-Encoding", ""):
            headers["Content_Encoding"] = "gzip"
        elif answer.is_compressed:
            body = gzip.decompress(body)
        self.give(answer.status, KIND, body, **headers)

    def _admit(self, page: OperatorPage) -> None:
        # the page's own script can only name the token in the address
        token = parse_qs(self.path.partition("?")[2]).get("token", [""])[0]
        with self.server.place(self.connection, LOOKING, self.server.is_known(token)) as is_free:
            if is_free:
                self._tell(page)
            else:
                page.over.wait(REFUSED_S)
                self.give(503, "text/plain", b"too many browsers are connected; one with the token may still connect")

    def _tell(self, page: OperatorPage) -> None:
        """Send events of ticks from now on, for as long as the browser takes them."""
        (told, _), quiet = page.newest(), 0
        self.connection.setsockopt(SOL_SOCKET, SO_SNDBUF, BEHIND_BYTES)
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


def make_page(has_robot: bool) -> bytes:
    """Return the page with the what-if part; without a robot it shows only that part."""
    here = files("truearc.robot.operator_ui")
    page = (here / "page.html").read_bytes().replace(b"<!--what_if.html-->", (here / "what_if.html").read_bytes())
    return page if has_robot else page.replace(b"<html ", b'<html data-robot="none" ', 1)
