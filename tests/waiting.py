"""A clock that is set by hand, waits that end, and servers of pages with questions to them."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPMessage

PATIENCE_S = 30.0                     # of a loaded machine; usually a few milliseconds


class SetClock:
    """truearc.hw.protocols.Clock whose time is whatever the test says."""

    def __init__(self, t_ns: int = 0) -> None:
        self.t_ns = t_ns

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self.t_ns = max(self.t_ns, t_ns)


def wait_until(true, limit_s: float = PATIENCE_S) -> None:
    """Threads and processes take the time that they take."""
    end = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)


def ask(port: int, path: str, method: str = "GET", body: object = None, headers: dict[str, str] | None = None,
        host: str = "127.0.0.1") -> tuple[int, HTTPMessage, bytes]:
    """Status, headers and body of the answer."""
    line = HTTPConnection(host, port, timeout=20)
    try:
        line.request(method, path, body, headers or {})
        answer = line.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        line.close()


@contextmanager
def serving(server) -> Iterator:
    """A page's server that answers meanwhile."""
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()
