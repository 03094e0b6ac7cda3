"""A byte stream through pyserial: a serial device, or any URL that pyserial knows (socket://, rfc2217://, ...)."""

import contextlib

import serial

from truearc.hw.fault_codes import SERIAL_ERROR
from truearc.hw.protocols import LinkLost

CHUNK = 4096                                      # bytes; more than a box says in a second


class SerialStream:
    """truearc.hw.protocols.Stream over an open port, which it owns. Neither call blocks."""

    def __init__(self, port: serial.SerialBase, name: str) -> None:
        self.name = name
        self._port = port

    def read(self) -> bytes:
        """All bytes received since the last call; LinkLost when the device is unplugged."""
        parts: list[bytes] = []
        try:
            while part := self._port.read(CHUNK):
                parts.append(part)
        except (serial.SerialException, OSError) as error:
            # Bytes from before the plug was pulled stay unread: half a line is useless, and the next call fails too.
            raise LinkLost(SERIAL_ERROR(port=self.name, detail=str(error))) from error
        return b"".join(parts)

    def close(self) -> None:
        with contextlib.suppress(serial.SerialException, OSError):      # an unplugged port may refuse even this
            self._port.close()


def open_serial(port: str, baud: int) -> SerialStream:
    """Open a port, for us alone where the system can promise that; LinkLost names the port when it cannot be."""
    try:
        stream = serial.serial_for_url(port, baudrate=baud, timeout=0, write_timeout=0, do_not_open=True)
        if "://" not in port:
            stream.exclusive = True
        stream.open()
    except (serial.SerialException, OSError, ValueError) as error:
        raise LinkLost(SERIAL_ERROR(port=port, detail=str(error))) from error
    return SerialStream(stream, port)
