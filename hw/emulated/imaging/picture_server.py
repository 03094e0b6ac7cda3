"""An emulated camera's pictures over HTTP, as network cameras give them: motion JPEG, which OpenCV opens by its URL."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import numpy.typing as npt

QUALITY = 95
SETTINGS = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


class PictureServer:
    """Shows every viewer the newest picture, on the loopback interface alone."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._count, self._picture = 0, b""
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _make_handler(self))
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, name="pictures", daemon=True)
        self._thread.start()

    def show(self, image: npt.NDArray[np.uint8]) -> None:
        """The newest picture, (height, width, 3) BGR."""
        _, data = cv2.imencode(".jpg", image, SETTINGS)
        self._put(data.tobytes())

    def close(self) -> None:
        self._put(b"")                            # there will be no more
        self._server.shutdown()
        self._server.server_close()

    def wait(self, count: int) -> tuple[int, bytes]:
        """The number of the newest picture and the picture, once it is not number `count`."""
        with self._changed:
            while self._count == count:
                self._changed.wait()
            return self._count, self._picture

    def _put(self, picture: bytes) -> None:
        with self._changed:
            self._count += 1
            self._picture = picture
            self._changed.notify_all()


def _make_handler(server: PictureServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=picture")
            self.end_headers()
            count = 0
            while True:
                count, picture = server.wait(count)
                if not picture:
                    return
                head = f"--picture\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode("ascii") + picture + b"\r\n")
                except OSError:                   # the viewer has gone
                    return

        def log_message(self, format: str, *args: object) -> None:
            return

    return Handler
