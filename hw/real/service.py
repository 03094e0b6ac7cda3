"""What systemd hears of a service that it started: one datagram a message (sd_notify(3))."""

import contextlib
import socket
import sys


class ServiceManager:
    """The sender to NOTIFY_SOCKET. Never blocks and never raises: a deaf manager must not stop the robot."""

    def __init__(self, address: str | None) -> None:
        self._socket: socket.socket | None = None
        if address and sys.platform != "win32":
            self._address = "\0" + address[1:] if address.startswith("@") else address     # @: an abstract socket
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def say(self, message: str) -> None:
        """Such as "READY=1"; nothing happens without a service manager."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)

    def close(self) -> None:
        """Say that the end has begun, whoever wanted it."""
        self.say("STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None
