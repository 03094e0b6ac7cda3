"""Messages from one process of ours to another, over a pair of sockets: whole, in order, and sent without waiting."""

import socket
from collections import deque

from truearc.hw.fault_codes import PIPE_CLOSED, PIPE_ENDED
from truearc.hw.protocols import LinkLost

LENGTH_BYTES = 4
CHUNK = 1 << 20
ROOM = 4 << 20                        # bytes requested from the system for messages on their way; it may give less


class Outbox:
    """Sends what the system takes, and keeps the rest for the next `push`.

    Bytes that the system has taken reach the other end whatever becomes of this process. `waiting`: those it has not.
    """

    def __init__(self, end: socket.socket) -> None:
        self.waiting = 0
        self._end = end
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        self._parts: deque[memoryview] = deque()

    def put(self, message: bytes) -> None:
        part = memoryview(len(message).to_bytes(LENGTH_BYTES, "little") + message)
        self._parts.append(part)
        self.waiting += len(part)
        self.push()

    def push(self) -> None:
        """Send on; nothing happens once the reader has gone."""
        while self._parts:
            try:
                taken = self._end.send(self._parts[0])
            except OSError:           # full, or broken: what became of the reader others know
                return
            self.waiting -= taken
            rest = self._parts.popleft()[taken:]
            if rest:
                self._parts.appendleft(rest)

    def close(self) -> None:
        self._end.close()


class Inbox:
    """The other end."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._pending = bytearray()

    def read(self, wait_s: float) -> list[bytes]:
        """Messages that have come whole, waiting so long for the first bytes; LinkLost when there will be no more."""
        self._end.settimeout(wait_s)
        try:
            data = self._end.recv(CHUNK)
        except TimeoutError:
            return []
        except OSError as error:
            raise LinkLost(PIPE_CLOSED(detail=str(error))) from error
        if not data:
            raise LinkLost(PIPE_ENDED())
        self._pending += data
        return self._whole()

    def close(self) -> None:
        self._end.close()

    def _whole(self) -> list[bytes]:
        messages, at = [], 0
        while (begin := at + LENGTH_BYTES) <= len(self._pending):
            end = begin + int.from_bytes(self._pending[at:begin], "little")
            if end > len(self._pending):
                break
            messages.append(bytes(self._pending[begin:end]))
            at = end
        del self._pending[:at]
        return messages
