"""Local HTTP server for pages at the robot: standard library only, and pages load nothing from elsewhere.

No client can block the others, not even from a shared address (a tunnel, the robot's own screen). A connection too many
ends the oldest one whose request is still being read or answered; long answers have a limited number of places.
"""

import socketserver
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedReader, RawIOBase
from ipaddress import ip_address
from socket import AF_INET, AF_INET6, SHUT_RDWR, gethostname, socket
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from truearc.hw.real.clock import MonotonicClock

MAX_CONNECTIONS = 96                  # of all clients; each is a thread, together 5 MB
MAX_OF_ADDRESS = 48                   # far more than all its places: a request has 0.1 s before 48 later ones end it
CROWDED_NS = 2_000_000                # between two clients when there are too many: no more than 500 threads a second
REQUEST_NS = 5_000_000_000            # for a whole request: an aim file of 256 KiB at half a megabit per second
PATIENCE_S = 2.0                      # for a client to accept each part of an answer
# A page loads nothing from anywhere, and other sites' pages get nothing from here.
POLICY = ("default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' data:; "
          "connect-src 'self'")
WILD = ("", "0.0.0.0", "::")
CLOCK = MonotonicClock()


class Places(NamedTuple):
    """Places for clients whose answers last: `most` in all, `of_address` for one; the last is a known client's."""

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
        """Whether a Host header names this machine: by an address, by its name or by the one that it serves.

        Another site can make its own name point here (DNS rebinding), and cannot make its name one of these.
        """
        machine = gethostname().lower()
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in self._own | {machine, f"{machine.partition('.')[0]}.local"} or bool(ip_address(name))
        except ValueError:
            return False

    def server_bind(self) -> None:
        """As in the base class, without a look-up of this machine's name, which takes long where no server answers."""
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
    def place(self, client: socket, places: Places, is_known: bool | None = False) -> Iterator[bool]:
        """Whether there is one of these places for `client`, which then keeps it meanwhile.

        is_known: None where no client can be known; the last place is then for an address that has none yet.
        """
        with self._lock:
            address = self._clients.get(client)   # None: it has been replaced
            taken = [self._clients[one] for one, kind in self._placed.items() if kind is places]
            is_known = address not in taken if is_known is None else is_known
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
        """Ignore a browser that disconnects in the middle of an answer."""
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
    """What every page's handler needs; the answers are its own."""

    server: LocalServer

    def setup(self) -> None:
        super().setup()
        self.rfile.close()
        self.rfile = BufferedReader(_Request(self.connection))

    def is_ours(self) -> bool:
        """Whether a page from here asks, rather than one of another site under a name that was made to point here."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        return self.server.is_own_name(host) and (origin is None or origin.partition("://")[2] == host)

    def give(self, code: int, kind: str, body: bytes, **headers: str) -> None:
        """Answer; `headers`: further ones, their names with _ for -."""
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
        """A line for each picture is of no use to anyone."""
