"""The page of `truearc vision-tune`, which measures pictures or the live camera's images with changed settings.

The page loads nothing from other machines.
"""

import argparse
import json
import secrets
import sys
import threading
from collections.abc import Callable
from hmac import compare_digest
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import cv2
import msgspec
from msgspec.structs import replace

from truearc.cli.common import load_camera
from truearc.cli.vision_images import load_image, why_not
from truearc.errors import InputError, make_toml, reworded, save_whole
from truearc.hw.protocols import Camera, CameraFrame, LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.wires import open_camera
from truearc.robot.config.schema import CameraFile, Vision
from truearc.robot.operator_ui.server import LocalHandler, LocalServer
from truearc.robot.vision import detect, draw_mask, draw_regions
from truearc.robot.vision.marks import Image

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
PIECE = 25                            # pictures replayed for one answer; a page asks on until it has them all
KEPT = 16                             # live pictures that a page may still ask for
MAX_REQUEST_BYTES = 10_000


def serve_tuner(args: argparse.Namespace) -> int:
    """Serve the page until interrupted; args: those of `truearc vision-tune`."""
    file = load_camera(args.camera)
    source = Recorded(find_pictures(args.sources)) if args.sources else open_live(file)
    try:
        server = TuneServer(Tuner(file, source, Path(args.out)), args.host, args.port)
    except (OSError, OverflowError) as error:
        raise InputError(f"--host {args.host} --port {args.port}: {error}") from error
    print(f"{server.url}  (interrupt to end)", file=sys.stderr)
    with server:
        server.serve_forever()
    return 0


class Recorded:
    """Pictures from files to tune on."""

    live = False

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths
        self.names = tuple(str(path) for path in paths)

    def take(self) -> int:
        """Return the frame of `image`; files have no other."""
        return 0

    def image(self, index: int, frame: int) -> Image:
        return load_image(str(self._paths[index]))


class Live:
    """Pictures of a camera to tune on."""

    names: tuple[str, ...] = ("live",)
    live = True

    def __init__(self, camera: Camera) -> None:
        self._camera, self._lock = camera, threading.Lock()
        self._kept: dict[int, Image] = {}
        self._taken = 0

    def take(self) -> int:
        """Return the number of the newest picture, so that its text and its views are all of the same one."""
        with self._lock:
            try:
                newest = self._camera.read()
            except LinkLost as error:
                raise InputError(str(error)) from error
            if newest is not None:
                self._taken += 1
                self._kept[self._taken] = newest.image
                self._kept.pop(self._taken - KEPT, None)
            if not self._taken:
                raise InputError("the camera has given no picture yet")
            return self._taken

    def image(self, index: int, frame: int) -> Image:
        with self._lock:
            if frame not in self._kept:
                raise InputError(f"live picture {frame} is no longer kept")
            return self._kept[frame]


def find_pictures(sources: list[str]) -> list[Path]:
    """Find picture files by name, in folders, and in the frames of recorded sessions; InputError names what has
    none."""
    found: list[Path] = []
    for source in sources:
        path = Path(source)
        folder = path / "frames" if (path / "frames").is_dir() else path
        here = sorted(entry for entry in folder.iterdir() if entry.suffix.lower() in PICTURES) if folder.is_dir() else [
            path]
        if not here or not here[0].is_file():
            raise InputError(f"{source}: no pictures there")
        found += here
    return found


def open_live(file: CameraFile) -> Live:
    camera = file.camera
    try:
        return Live(open_camera(camera.device, camera.width_px, camera.height_px, camera.fps, MonotonicClock(),
                                camera.exposure_s))
    except LinkLost as error:
        raise InputError(f"{error}; name pictures to tune on instead") from error


class Tuner:
    """Answers to the page's requests, each from its own arguments and the last saved settings."""

    def __init__(self, file: CameraFile, source: Recorded | Live, out: Path, piece: int = PIECE) -> None:
        """`piece`: pictures replayed for one answer."""
        self._file, self._source, self._out, self._piece = file, source, out, piece

    def state(self) -> dict[str, Any]:
        return {"names": self._source.names, "live": self._source.live, "out": str(self._out),
                "settings": msgspec.to_builtins(self._file.vision)}

    def picture(self, index: int, view: str, settings: dict[str, Any], frame: int) -> bytes:
        """Return a JPEG of the image, the mask or the regions; `frame` is the number from `look`."""
        image, file = self._image(index, frame), self._with(settings)
        if view == "mask":
            image = draw_mask(image, file)
        elif view == "regions":
            image, _ = draw_regions(image, file)
        return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()

    def look(self, index: int, settings: dict[str, Any]) -> dict[str, Any]:
        file, frame = self._with(settings), self._source.take()
        image = self._image(index, frame)
        return {"frame": frame, "regions": draw_regions(image, file)[1], **_words(image, file)}

    def replay(self, settings: dict[str, Any], begin: int) -> list[dict[str, Any]]:
        """Measure some pictures from `begin` on, each with the last saved and with these settings."""
        if begin < 0:
            raise InputError(f"there is no picture {begin}")
        after = self._with(settings)
        rows = []
        for index, name in enumerate(self._source.names[begin:begin + self._piece], begin):
            try:
                image = self._image(index, 0)
            except InputError as error:
                rows.append({"name": name, "before": str(error), "after": str(error)})
                continue
            before, now = (_words(image, file)["said"] for file in (self._file, after))
            rows.append({"name": name, "before": before, "after": now})
        return rows

    def save(self, settings: dict[str, Any]) -> dict[str, Any]:
        file = self._with(settings)
        save_whole(self._out, make_toml(msgspec.to_builtins(file)).encode())
        self._file = file
        return {"said": f"saved to {self._out}"}

    def _image(self, index: int, frame: int) -> Image:
        if not 0 <= index < len(self._source.names):
            raise InputError(f"there is no picture {index}")
        return self._source.image(index, frame)

    def _with(self, settings: dict[str, Any]) -> CameraFile:
        try:
            return replace(self._file, vision=msgspec.convert(settings, Vision))
        except msgspec.ValidationError as error:
            raise InputError(f"settings: {reworded(str(error), settings)}") from error


def _words(image: Image, file: CameraFile) -> dict[str, Any]:
    seen = detect(CameraFrame(0, image), file.camera, file.tape, file.vision)
    if seen.distance_m is None or seen.sigma_m is None:
        return {"found": False, "said": why_not(seen)}
    return {"found": True, "said": f"{seen.distance_m:.3f} m ± {seen.sigma_m:.3f}"}


class TuneServer(LocalServer):
    """Server of the page; OSError when the port is taken. Only requests with its token, as in `url`, are answered."""

    def __init__(self, tuner: Tuner, host: str, port: int) -> None:
        super().__init__(host, port, _Page)
        self.token = secrets.token_urlsafe(16)
        self.url += f"?token={self.token}"
        self.answers: dict[str, Callable[[dict[str, Any]], Any]] = {
            "GET /state": lambda ask: tuner.state(),
            "GET /picture": lambda ask: tuner.picture(int(ask["index"]), ask["view"], json.loads(ask["settings"]),
                                                      int(ask.get("frame", 0))),
            "POST /look": lambda ask: tuner.look(ask["index"], ask["settings"]),
            "POST /replay": lambda ask: tuner.replay(ask["settings"], ask.get("begin", 0)),
            "POST /save": lambda ask: tuner.save(ask["settings"]),
        }


class _Page(LocalHandler):
    server: TuneServer

    def do_GET(self) -> None:
        where = urlsplit(self.path)
        query = dict(parse_qsl(where.query))
        size, answer = self.headers.get("Content-Length", "0"), self.server.answers.get(f"{self.command} {where.path}")
        if not (self.is_ours() and compare_digest(query.get("token", "").encode(), self.server.token.encode())):
            self.give(403, "text/plain", b"open the address that truearc vision-tune printed, with its token")
        elif (self.command, where.path) == ("GET", "/"):
            self.give(200, "text/html; charset=utf-8", (files("truearc.cli") / "tune.html").read_bytes())
        elif answer is None or not size.isdecimal() or int(size) > MAX_REQUEST_BYTES:
            self.give(404, "text/plain", b"there is nothing of this name to do, or too much is said with it")
        else:
            self._answer(lambda: answer(query if self.command == "GET" else json.loads(self.rfile.read(int(size)))))

    do_POST = do_GET

    def _answer(self, make: Callable[[], Any]) -> None:
        """Answer with the result of `make`, or with 400 and its complaint."""
        try:
            made = make()
        except (InputError, OSError, KeyError, TypeError, ValueError, RecursionError) as error:
            self.give(400, "text/plain; charset=utf-8", str(error).encode())
            return
        if isinstance(made, bytes):
            self.give(200, "image/jpeg", made)
        else:
            self.give(200, "application/json", json.dumps(made).encode())
