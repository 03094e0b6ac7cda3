"""NetworkTables for tests: a free port, and keys that are simply there."""

import socket
from collections.abc import Mapping

from truearc_frc.keys import Reading


def free_port() -> int:
    """A port of 127.0.0.1 that nothing listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class Table:
    """Keys with these readings; nothing is published."""

    def __init__(self, found: Mapping[str, Reading]) -> None:
        self.found, self.connected = found, True

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        return self.found

    def publish(self, values: object) -> None: ...
