"""The serial port, the camera, and supervised wires, which a thread reopens after a loss.

A camera is read through OpenCV, over V4L2 or the network. A thread of its own reads it and keeps only the newest image.
"""

import contextlib
import threading
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

import cv2
import numpy as np
import numpy.typing as npt
import serial

from truearc.hw import fault_codes, reason
from truearc.hw.protocols import NS_PER_MS, Camera, CameraFrame, Clock, LinkLost, Stream

CHUNK = 4096                                      # bytes; more than a box says in a second


class SerialStream:
    """truearc.hw.protocols.Stream over an open port, which it owns. Neither call blocks."""

    def __init__(self, port: serial.SerialBase, name: str) -> None:
        self.name = name
        self._port = port

    def read(self) -> bytes:
        """Return all bytes received since the last call; LinkLost when the device is unplugged."""
        parts: list[bytes] = []
        try:
            while part := self._port.read(CHUNK):
                parts.append(part)
        except (serial.SerialException, OSError) as error:
            # Bytes from before the plug was pulled stay unread: half a line is useless, and the next call fails too.
            raise LinkLost(fault_codes.SERIAL_ERROR(port=self.name, detail=str(error))) from error
        return b"".join(parts)

    def close(self) -> None:
        with contextlib.suppress(serial.SerialException, OSError):      # an unplugged port may refuse even this
            self._port.close()


def open_serial(port: str, baud: int) -> SerialStream:
    """Open a port, exclusively if the system supports that; LinkLost names the port if it cannot be opened."""
    try:
        stream = serial.serial_for_url(port, baudrate=baud, timeout=0, write_timeout=0, do_not_open=True)
        if "://" not in port:
            stream.exclusive = True
        stream.open()
    except (serial.SerialException, OSError, ValueError) as error:
        raise LinkLost(fault_codes.SERIAL_ERROR(port=port, detail=str(error))) from error
    return SerialStream(stream, port)


PAUSE_S = 0.5                                     # between tries; an open camera takes about as long
LONGEST_S = 4.0                                   # before one that can be opened, but stays silent, is opened again


class Closable(Protocol):
    def close(self) -> None: ...


Wire = TypeVar("Wire", bound=Closable)
Answer = TypeVar("Answer")
Image = npt.NDArray[np.uint8]


class Mended(Generic[Wire]):
    """A wire opened by `open_wire` and reopened whenever it is lost or was absent at first; use raises LinkLost
    meanwhile.

    A wire that is lost before it has answered anything is reopened after increasing pauses, since opening does not fix
    it.
    """

    def __init__(self, open_wire: Callable[[], Wire], pause_s: float = PAUSE_S) -> None:
        self._wire: Wire | None = None
        self._open_wire, self._first_s, self._pause_s = open_wire, pause_s, pause_s
        self._why: reason.Reason | None = None
        self._stop = threading.Event()
        self._mender: threading.Thread | None = None
        try:
            self._wire = open_wire()
        except LinkLost as error:
            self._why = error.reason
            self._start(None)

    @property
    def lost(self) -> reason.Reason | None:
        """Why it is not open; None while it is."""
        return self._why if self._wire is None else None

    def ask(self, question: Callable[[Wire], Answer]) -> Answer:
        """Return `question(wire)`; LinkLost, every time, from when it is lost until it is open again."""
        wire = self._wire
        if wire is None:
            assert self._why is not None
            raise LinkLost(self._why)
        try:
            answer = question(wire)
        except LinkLost as error:
            self._why, self._wire = error.reason, None
            self._start(wire)
            raise
        if answer is not None:
            self._pause_s = self._first_s
        return answer

    def close(self) -> None:
        self._stop.set()
        if self._mender is not None:
            self._mender.join()
        if self._wire is not None:
            self._wire.close()

    def _start(self, lost: Wire | None) -> None:
        self._mender = threading.Thread(target=self._mend, args=(lost,), name="reopen", daemon=True)
        self._mender.start()

    def _mend(self, lost: Wire | None) -> None:
        if lost is not None:
            lost.close()
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_S)
        while not self._stop.wait(pause_s):
            try:
                self._wire = self._open_wire()
                return
            except LinkLost as error:
                self._why, pause_s = error.reason, self._first_s


class MendedStream(Mended[Stream]):
    """truearc.hw.protocols.Stream that is reopened when lost."""

    def read(self) -> bytes:
        return self.ask(lambda stream: stream.read())


class MendedCamera(Mended[Camera]):
    """truearc.hw.protocols.Camera that is reopened when lost.

    The last image before the loss is ignored if it is repeated: a driver that hangs may return its last one forever,
    even after it was reopened.
    """

    def __init__(self, open_camera: Callable[[], Camera], pause_s: float = PAUSE_S) -> None:
        self._newest: Image | None = None
        self._stale: Image | None = None          # what it was lost with, until there is another
        super().__init__(open_camera, pause_s)

    def read(self) -> CameraFrame | None:
        try:
            return self.ask(lambda camera: self._look(camera.read()))
        except LinkLost:
            self._stale = self._newest
            raise

    def _look(self, frame: CameraFrame | None) -> CameraFrame | None:
        if frame is None or (self._stale is not None and np.array_equal(frame.image, self._stale)):
            return None
        self._newest, self._stale = frame.image, None
        return frame


# --- the camera

SILENT_NS = 2_000_000_000                         # without an image for this long the camera is lost
FAILURES = 10                                     # refused images in a row
MANUAL = 1.0                                      # V4L2_EXPOSURE_MANUAL
EXPOSURE_UNIT_S = 1e-4                            # of V4L2_CID_EXPOSURE_ABSOLUTE
SETTLE_FRAMES = 20                                # some cameras obey only after several images
EXPOSURE_SHARE = 0.1                              # what is read back may differ by this much: cameras round
ERRORS_ONLY = 2                                   # of OpenCV's own log: cv2.utils.logging.LOG_LEVEL_ERROR
STALE_NS = 1_000_000_000                          # a driver's stamp older than this is on another clock


class CameraThread:
    """truearc.hw.protocols.Camera over an open capture, which it owns.

    `capture`: what cv2.VideoCapture offers (read, get, release). `exposure_s`: length of one exposure; images are
    stamped with its middle, from the driver's own start-of-frame stamp when it is on the machine's monotonic clock
    (which a network camera's is not: not `stamped`), else from when they came.
    """

    def __init__(self, capture: Any, clock: Clock, name: str, exposure_s: float = 0.0, *, stamped: bool = True) -> None:
        self.name = name
        self._stamped = stamped
        self._capture, self._clock = capture, clock
        self._half_exposure_ns = int(exposure_s * 5e8)
        self._lock = threading.Lock()
        self._newest: CameraFrame | None = None
        self._last: np.ndarray[Any, np.dtype[np.uint8]] | None = None
        self._frozen = False
        self._heard_ns = clock.now_ns()
        self._lost: reason.Reason | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._keep_newest, name=f"camera {name}", daemon=True)
        self._thread.start()

    def read(self) -> CameraFrame | None:
        """Return the newest image not yet read, or None; LinkLost if the camera has given nothing for two seconds."""
        with self._lock:
            newest, self._newest = self._newest, None
            lost, heard_ns = self._lost, self._heard_ns
        if newest is not None:
            return newest
        if lost or self._clock.now_ns() - heard_ns > SILENT_NS:
            silent = fault_codes.CAMERA_FROZEN if self._frozen else fault_codes.CAMERA_SILENT
            raise LinkLost(lost or silent(camera=self.name))
        return None

    def close(self) -> None:
        """Stop the thread and release the device."""
        self._stop.set()
        self._thread.join(timeout=1.0)

    def _keep_newest(self) -> None:
        failures = 0
        try:
            while not self._stop.is_set() and failures < FAILURES:
                ok, image = self._capture.read()
                if not ok or image is None:
                    failures += 1
                    self._stop.wait(0.01)
                    continue
                failures = 0
                self._keep(np.asarray(image, dtype=np.uint8))
            if failures:
                self._lost = fault_codes.CAMERA_STOPPED(camera=self.name)
        except cv2.error as error:
            self._lost = fault_codes.CAMERA_ERROR(camera=self.name, detail=str(error))
        finally:
            self._capture.release()

    def _keep(self, image: np.ndarray[Any, np.dtype[np.uint8]]) -> None:
        # Noise makes every image another one; a driver that hangs may hand out its last one for ever.
        self._frozen = self._last is not None and np.array_equal(image, self._last)
        if self._frozen:
            return
        self._last = image
        now_ns = self._clock.now_ns()
        driver_ns = int(self._capture.get(cv2.CAP_PROP_POS_MSEC) * NS_PER_MS) if self._stamped else 0
        began_ns = driver_ns if now_ns - STALE_NS < driver_ns <= now_ns else now_ns
        with self._lock:
            self._newest = CameraFrame(min(began_ns + self._half_exposure_ns, now_ns), image)
            self._heard_ns = now_ns


def lock_exposure(capture: Any, exposure_s: float, camera: str) -> reason.Reason | None:
    """Set a fixed exposure and read it back over a few images; return None, or the camera's actual setting."""
    wanted = exposure_s / EXPOSURE_UNIT_S
    mode = exposure = 0.0
    for _ in range(SETTLE_FRAMES):
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL)
        capture.set(cv2.CAP_PROP_EXPOSURE, wanted)
        mode, exposure = capture.get(cv2.CAP_PROP_AUTO_EXPOSURE), capture.get(cv2.CAP_PROP_EXPOSURE)
        if mode == MANUAL and abs(exposure - wanted) <= max(EXPOSURE_SHARE * wanted, 1.0):
            return None
        capture.read()
    if mode != MANUAL:
        return fault_codes.CAMERA_EXPOSURE_AUTOMATIC(camera=camera)
    return fault_codes.CAMERA_EXPOSURE_WRONG(camera=camera, exposure_s=exposure * EXPOSURE_UNIT_S, wanted_s=exposure_s)


def open_camera(device: str, width_px: int, height_px: int, fps: float, clock: Clock,
                exposure_s: float = 0.0) -> CameraThread:
    """Open a V4L2 device (path or index) or a network camera (URL).

    LinkLost names it if it is absent or does not give that size or, if `exposure_s` is above 0, does not keep that
    exposure. A calibration is valid for one size only, so another size is an error. With an exposure chosen by the
    camera the surroundings drown the tape; `truearc.robot.vision.marks` checks whether pictures look like that.
    """
    is_stream = "://" in device
    cv2.utils.logging.setLogLevel(ERRORS_ONLY)      # each attempt to open a camera that is away would print a warning
    capture = cv2.VideoCapture(int(device) if device.isdecimal() else device,
                               cv2.CAP_FFMPEG if is_stream else cv2.CAP_V4L2)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, width_px)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height_px)
    capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    refused = None
    if not capture.isOpened():
        refused = fault_codes.CAMERA_NOT_OPENED(camera=device)
    elif size != (width_px, height_px):
        refused = fault_codes.CAMERA_WRONG_SIZE(camera=device, width_px=size[0], height_px=size[1],
                                                wanted_width_px=width_px, wanted_height_px=height_px)
    elif exposure_s > 0.0 and not is_stream:
        refused = lock_exposure(capture, exposure_s, device)
    if refused is not None:
        capture.release()
        raise LinkLost(refused)
    return CameraThread(capture, clock, device, exposure_s, stamped=not is_stream)
