"""Pages for the people at this robot, served by the standard library alone; all that they load comes from here."""

import socketserver
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from socket import AF_INET, AF_INET6, gethostname, socket
from typing import Any
from urllib.parse import urlsplit

MOST_CONNECTIONS = 24                 # at once; one more is hung up on
PATIENCE_S = 2.0                      # with whoever neither speaks nor listens
# A page loads nothing from anywhere, and other sites' pages get nothing from here.
POLICY = ("default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' data:; "
          "connect-src 'self'")
WILD = ("", "0.0.0.0", "::")


class LocalServer(ThreadingHTTPServer):
    """Listens on one address; OSError when it cannot."""

    daemon_threads = True

    def __init__(self, host: str, port: int, handler: type["LocalHandler"]) -> None:
        self.address_family = AF_INET6 if ":" in host else AF_INET
        self._room = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__((host, port), handler)
        shown = f"[{host}]" if ":" in host else host
        # a page of another site may make its own name point here; it cannot make its name one of these
        self.names = {f"{name}:{self.server_port}" for name in (shown, "localhost", "127.0.0.1", "[::1]")}
        self.anywhere = host in WILD
        self.url = f"http://{'localhost' if self.anywhere else shown}:{self.server_port}/"

    def answers_to(self, host: str) -> bool:
        """Whether a Host header may stand for this server; where everybody may look, any name will do."""
        return self.anywhere or host in self.names

    def is_own_name(self, host: str) -> bool:
        """Whether a Host header names this machine by an address or its own name, which no other site can take."""
        name, own = urlsplit(f"//{host}").hostname or "", gethostname().lower()
        try:
            return host in self.names or name in (own, f"{own.partition('.')[0]}.local") or bool(ip_address(name))
        except ValueError:
            return False

    def server_bind(self) -> None:
        """As in the base class, without a look-up of this machine's name, which takes long where no server answers."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        """Ignore a browser that went away in the middle of an answer."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class LocalHandler(BaseHTTPRequestHandler):
    """What every page's handler needs; the answers are its own."""

    server: LocalServer
    timeout = PATIENCE_S

    def is_ours(self) -> bool:
        """Whether a page from here asks, rather than one of another site under a name that was made to point here."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        return self.server.answers_to(host) and (origin is None or urlsplit(origin).netloc == host)

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
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")

    def log_message(self, format: str, *args: object) -> None:
        """A line for each picture is of no use to anyone."""
