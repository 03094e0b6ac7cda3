"""A real NetworkTables server."""

from collections.abc import Iterator
from typing import Any

import ntcore
import pytest

from tests.frc.nt_server import free_port


@pytest.fixture
def nt_server() -> Iterator[tuple[Any, str]]:
    """(ntcore's instance, "127.0.0.1:port") of a server that runs meanwhile."""
    port, server = free_port(), ntcore.NetworkTableInstance.create()
    server.startServer("", "127.0.0.1", 0, port)
    yield server, f"127.0.0.1:{port}"
    server.stopServer()
