"""NetworkTables for tests: a free port, a real server on it, and keys that are simply there."""

import socket
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import ntcore
import pytest

from truearc_frc.keys import Reading


def free_port() -> int:
    """A port of 127.0.0.1 that nothing listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def nt_server() -> Iterator[tuple[Any, str]]:
    """(ntcore's instance, "127.0.0.1:port") of a server that runs meanwhile."""
    port, server = free_port(), ntcore.NetworkTableInstance.create()
    server.startServer("", "127.0.0.1", 0, port)
    yield server, f"127.0.0.1:{port}"
    server.stopServer()


class Table:
    """Keys with these readings; what is published is kept."""

    def __init__(self, found: Mapping[str, Reading] | None = None, connected: bool = True) -> None:
        self.found, self.connected = found or {}, connected
        self.said: list[dict[str, float | str | Sequence[str]]] = []
        self.closed = False

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        return self.found

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None:
        self.said.append(dict(values))

    def close(self) -> None:
        self.closed = True
