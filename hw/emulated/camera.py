"""The emulated camera: its lens, images of the retro-reflective half hexagon under a ring light, or of an AprilTag, and
image server.

The camera shares no code with the vision module. To save time, the background (lights, reflections) is drawn once, the
noise comes from one tile that is shifted at random, and the tape is drawn only within its bounding box. What is drawn
is the share of each pixel that lies between the projected edges, blurred by the lens and surrounded by a halo, in the
colours of photographs of real tape. All randomness comes from the seed.
"""

import math
import threading
from dataclasses import dataclass
from functools import reduce
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.emulated.nodes import Scene, View
from truearc.hw.protocols import CameraFrame

# --- lens

Array = npt.NDArray[np.float64]
Plane = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Lens:
    """Image size, pinhole and Brown distortion (k1 k2 p1 p2 k3), in pixels."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


def project(points_m: Array, camera_from_points: Array, lens: Lens, focal_scale: float = 1.0) -> tuple[Array, Array]:
    """Project points (n, 3) with a perfect pinhole to pixels (n, 2), and return their distances ahead (n,)."""
    seen_m = points_m @ camera_from_points[:3, :3].T + camera_from_points[:3, 3]
    focal_px = np.array([lens.fx_px, lens.fy_px]) * focal_scale
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = seen_m[:, :2] / seen_m[:, 2:] * focal_px + np.array([lens.cx_px, lens.cy_px])
    return pixels, seen_m[:, 2]


def distort(ideal_px: Array, lens: Lens) -> Array:
    """Apply a lens's distortion to ideal pixels (n, 2)."""
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = (ideal_px[:, 0] - lens.cx_px) / lens.fx_px, (ideal_px[:, 1] - lens.cy_px) / lens.fy_px
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([u * lens.fx_px + lens.cx_px, v * lens.fy_px + lens.cy_px])


def ideal_pixels(lens: Lens) -> tuple[Plane, Plane]:
    """Return the columns and rows, in ideal pixels, of every pixel: (1, w) and (h, 1) without distortion, else two (h,
    w)."""
    columns, rows = np.arange(lens.width_px, dtype=np.float64), np.arange(lens.height_px, dtype=np.float64)
    if not any(lens.distortion):
        return columns[None, :].astype(np.float32), rows[:, None].astype(np.float32)
    seen = np.column_stack([part.ravel() for part in np.meshgrid(columns, rows)])
    ideal = seen.copy()
    for _ in range(50):                               # fixed point of distort(ideal) = seen
        miss = seen - distort(ideal, lens)
        ideal += miss
        if np.abs(miss).max() < 1e-4:
            break
    both = ideal.reshape(lens.height_px, lens.width_px, 2).astype(np.float32)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])


# --- picture

Image = npt.NDArray[np.uint8]

TAPE_BGR = (113.0, 213.0, 6.0)        # of the tape under a green ring light, well exposed
DARK_BGR = (4.0, 6.0, 1.5)            # mean of an unlit pixel
HALO_BLUR_PX = 6.0
HALO_MARGIN_PX = 16                   # kept around what shines, for its halo and blur
UNEVEN = 0.1                          # the ring light is this much dimmer at one end of the tape
EXPOSURE_JITTER = 0.04                # from frame to frame, one standard deviation
SHAKES = 2.0                          # flywheels shake the lens; a rolling shutter bends the picture in waves
NEAREST_M = 0.2
SHRINK = 4                            # the halo is computed this much coarser
TILE_SPARE_PX = (97, 131)             # by how much the noise tile may be shifted


NOTHING = View(np.diag([1.0, -1.0, -1.0, 1.0]), 1.0, 1.0)     # the target is at the lens: it is not drawn


class Stage:
    """The part of Plant that a camera sees; its owner changes `now`."""

    def __init__(self, now: View) -> None:
        self.now = now

    def view(self) -> View:
        return self.now


@dataclass(frozen=True)
class TapeSize:
    """Outer outline of the target: the lower half of a hexagon, open at the top."""

    top_width_m: float
    bottom_width_m: float
    height_m: float
    tape_width_m: float


@dataclass(frozen=True)
class TagSize:
    """A tag of the family 36h11 on a white plate; side_m: of its black square."""

    number: int
    side_m: float


@dataclass(frozen=True)
class Look:
    """Blur, bloom, noise and exposure of a picture."""

    noise: float = 2.2                # standard deviation of a channel, of 255
    blur_px: float = 0.6              # of the lens, one standard deviation
    halo_share: float = 0.1           # bloom: light that strays HALO_BLUR_PX far
    shake_px: float = 0.3
    gain: float = 1.0                 # exposure: light times this, before the sensor clips


class EmulatedCamera:
    """Pictures of an emulated world, one for each request."""

    glints: ClassVar[tuple[int, ...]] = (2, 6)        # small and green: the first die of each

    def __init__(self, scene: Scene, lens: Lens, tape: TapeSize, seed: int, look: Look | None = None) -> None:
        self._scene, self._lens, self._look = scene, lens, look or Look()
        self._outline_m = outline_m(tape)
        self._columns, self._rows = ideal_pixels(lens)
        self._random = np.random.default_rng(seed)
        self._background = _draw_background(lens, self._random)
        self._noise = _make_noise(lens, self._look.noise, self._random)

    def expose(self, t_ns: int) -> CameraFrame:
        """Return the image at this moment."""
        height, width = self._lens.height_px, self._lens.width_px
        dice = self._random.integers(0, 1 << 30, 10)
        exposure = 1.0 + EXPOSURE_JITTER * float(self._random.standard_normal())
        top, left = int(dice[0] % TILE_SPARE_PX[0]), int(dice[1] % TILE_SPARE_PX[1])
        return CameraFrame(t_ns, self._draw(self._noise[top:top + height, left:left + width], dice, exposure))

    def _draw(self, noise: Image, dice: npt.NDArray[np.int64], exposure: float) -> Image:
        """The picture over the sensor's `noise`, the light times `exposure`; `dice` place the glints."""
        image: Image = cv2.add(self._background, noise)
        view = self._scene.view()
        edges = self._edges(view)
        if edges is not None and (box := self._box(edges)) is not None:
            part = slice(box[1], box[3]), slice(box[0], box[2])
            self._show_target(image[part], noise[part], edges, box, view.brightness, exposure)
        for k in self.glints:
            at = int(dice[k] % self._lens.width_px), int(dice[k + 1] % self._lens.height_px)
            shade = 0.3 + 0.7 * float(dice[k + 2] % 1000) / 1000
            cv2.circle(image, at, 1 + int(dice[k + 3] % 2), tuple(shade * part for part in TAPE_BGR), -1)
        return image

    def _show_target(self, image: Image, noise: Image, edges: Array, box: tuple[int, int, int, int], brightness: float,
               exposure: float) -> None:
        """Paint the target over its `box` of the picture: the goal's wall hides the lights."""
        lit = self._lit(edges, box) * np.float32(brightness * self._look.gain * exposure)
        cv2.add(cv2.merge([cv2.convertScaleAbs(lit, alpha=level) for level in TAPE_BGR]), noise, dst=image)

    def _project(self, view: View) -> tuple[Array, Array]:
        """The outline in ideal pixels (8, 2), and how far ahead it is (8,) [m]; the proof overrides it."""
        return project(self._outline_m, view.camera_from_target, self._lens, view.focal_scale)

    def _edges(self, view: View) -> Array | None:
        """The outline (8, 2) in ideal pixels, or None when it is not wholly before the camera."""
        lens = self._lens
        pixels, ahead_m = self._project(view)
        if ahead_m.min() < NEAREST_M:
            return None
        phase, *push_px = self._random.standard_normal(3)
        bend = np.sin(2 * np.pi * (SHAKES * pixels[:, 1:] / lens.height_px + phase))
        pixels += self._look.shake_px * bend * np.array(push_px)
        return pixels

    def _box(self, edges: Array) -> tuple[int, int, int, int] | None:
        """(x0, y0, x1, y1) around the tape and its halo, inside the image; None when there is nothing to draw."""
        lens = self._lens
        seen = edges if not any(lens.distortion) else distort(edges, lens)
        x0, y0 = np.maximum(np.floor(seen.min(axis=0)).astype(int) - HALO_MARGIN_PX, 0)
        x1, y1 = np.ceil(seen.max(axis=0)).astype(int) + HALO_MARGIN_PX
        x1, y1 = min(x1, lens.width_px), min(y1, lens.height_px)
        return (int(x0), int(y0), int(x1), int(y1)) if x1 - x0 >= SHRINK and y1 - y0 >= SHRINK else None

    def _lit(self, edges: Array, box: tuple[int, int, int, int]) -> Plane:
        """Light on the pixels of the box, 1 = a pixel full of well lit tape."""
        x0, y0, x1, y1 = box
        tape = self._tape(edges, box)
        small = cv2.resize(tape, (-(-(x1 - x0) // SHRINK), -(-(y1 - y0) // SHRINK)), interpolation=cv2.INTER_AREA)
        halo = cv2.resize(cv2.GaussianBlur(small, (0, 0), HALO_BLUR_PX / SHRINK), (x1 - x0, y1 - y0))
        lit: Plane = cv2.addWeighted(self._spread(tape), 1.0, halo, self._look.halo_share, 0.0)
        return lit

    def _tape(self, edges: Array, box: tuple[int, int, int, int]) -> Plane:
        """Light on the pixels of the box before the lens spreads it."""
        x0, y0, x1, y1 = box
        columns = self._columns[:, x0:x1] if len(self._columns) == 1 else self._columns[y0:y1, x0:x1]
        rows = self._rows[y0:y1] if self._rows.shape[1] == 1 else self._rows[y0:y1, x0:x1]
        return _covered(edges, columns, rows) * np.linspace(1.0, 1.0 - UNEVEN, x1 - x0, dtype=np.float32)

    def _spread(self, plane: Plane) -> Plane:
        """Light as the lens spreads it."""
        side = 2 * math.ceil(3 * self._look.blur_px) + 1
        blurred: Plane = cv2.GaussianBlur(plane, (side, side), self._look.blur_px)
        return blurred


TAG_CELLS, CELL_PX, TAG_FINER = 8, 32, 4          # of a black square; of the drawn tag; parts of a pixel, each way
WHITE, BLACK = 200.0, 18.0            # of the plate and of the tag, in the light of the hall


class TagCamera(EmulatedCamera):
    """Pictures of an AprilTag."""

    glints = ()

    def __init__(self, scene: Scene, lens: Lens, tag: TagSize, seed: int, look: Look | None = None) -> None:
        super().__init__(scene, lens, TapeSize(1.0, 1.0, 1.0, 0.1), seed, look)
        half, (x, y) = tag.side_m * (0.5 + 1.0 / TAG_CELLS), (np.array([-1, 1, 1, -1]), np.array([1, 1, -1, -1]))
        self._outline_m = half * np.column_stack([x, y, np.zeros(4)])
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._sheet = np.full((CELL_PX * (TAG_CELLS + 2),) * 2, WHITE, np.float32)
        inside = slice(CELL_PX, -CELL_PX)
        self._sheet[inside, inside] = np.where(
            cv2.aruco.generateImageMarker(family, tag.number, CELL_PX * TAG_CELLS) > 0, WHITE, BLACK)

    def _show_target(self, image: Image, noise: Image, edges: Array, box: tuple[int, int, int, int], brightness: float,
               exposure: float) -> None:
        x0, y0, x1, y1 = box
        seen = distort(edges, self._lens) if any(self._lens.distortion) else edges
        size, side = ((x1 - x0) * TAG_FINER, (y1 - y0) * TAG_FINER), len(self._sheet)
        flat = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - np.float32(0.5)
        turn = cv2.getPerspectiveTransform(flat, ((seen - [x0, y0] + 0.5) * TAG_FINER - 0.5).astype(np.float32))
        lit, cover = (cv2.resize(cv2.warpPerspective(part, turn, size, flags=cv2.INTER_LINEAR), (x1 - x0, y1 - y0),
                                 interpolation=cv2.INTER_AREA) for part in (self._sheet, np.ones_like(self._sheet)))
        lit = self._spread(lit) * np.float32(self._look.gain * exposure)
        behind = image * (1.0 - self._spread(cover))[..., None] + lit[..., None]
        cv2.add(np.clip(np.rint(behind), 0, 255).astype(np.uint8), noise, dst=image)


def outline_m(tape: TapeSize) -> Array:
    """Return (8, 3) corners in the target's frame (truearc.hw.emulated.nodes.View): outer bottom right, bottom left,
    top left, top right, then the same four of the tape's inner edge."""
    top, bottom, high, wide = tape.top_width_m / 2, tape.bottom_width_m / 2, tape.height_m / 2, tape.tape_width_m
    slope = (top - bottom) / tape.height_m
    across = wide * np.hypot(1.0, slope)              # the tape's width measured horizontally on its sloping sides
    inner_bottom = bottom + slope * wide - across
    half = np.array([[bottom, -high], [top, high], [inner_bottom, wide - high], [top - across, high]])
    left, right = np.column_stack([-half[:, 0], half[:, 1]]), half
    flat = np.array([right[0], left[0], left[1], right[1], right[2], left[2], left[3], right[3]])
    return np.column_stack([flat, np.zeros(8)])


def _covered(edges: Array, columns: Plane, rows: Plane) -> Plane:
    """The share of each pixel that lies on the tape: inside its outer edge and not inside its inner edge."""
    top = _inside(edges[2], edges[3], columns, rows)
    outer = [_inside(edges[a], edges[b], columns, rows) for a, b in ((0, 1), (1, 2), (3, 0))]
    inner = [_inside(edges[a], edges[b], columns, rows) for a, b in ((4, 5), (5, 6), (7, 4))]
    within = [reduce(lambda a, b: np.minimum(a, b, out=a), sides) for sides in (outer, inner)]
    for part in within:
        np.minimum(part, top, out=part)
        np.clip(part, 0.0, 1.0, out=part)
    covered: Plane = np.subtract(within[0], within[1], out=within[0])
    return covered


def _inside(begin: Array, end: Array, columns: Plane, rows: Plane) -> Plane:
    """0.5 + distance in pixels to the right of the line from begin to end, as seen in the image (y down)."""
    along = (end - begin) / np.hypot(*(end - begin))
    level = 0.5 + along[1] * begin[0] - along[0] * begin[1]
    plane: Plane = columns * np.float32(-along[1]) + (rows * np.float32(along[0]) + np.float32(level))
    return plane


def _make_noise(lens: Lens, level: float, random: np.random.Generator) -> Image:
    size = (lens.height_px + TILE_SPARE_PX[0], lens.width_px + TILE_SPARE_PX[1], 3)
    noise: Image = np.clip(np.rint(random.normal(DARK_BGR, level, size)), 0, 255).astype(np.uint8)
    return noise


def _draw_background(lens: Lens, random: np.random.Generator) -> Image:
    """Ceiling lights, coloured strips and dim reflections of other colours, out of focus."""
    width, height = lens.width_px, lens.height_px
    image = np.zeros((height, width, 3), np.uint8)
    colours = ((255, 255, 250), (250, 255, 255), (190, 60, 20), (40, 70, 150), (30, 20, 140), (60, 60, 20), (18, 32, 8))
    for colour in colours:
        x, y = int(random.integers(0, width)), int(random.integers(0, height))
        long, wide = (int(side * width / 640) + 1 for side in (random.integers(12, 60), random.integers(3, 14)))
        lean = int(random.integers(-8, 9))
        corners = np.array([[x, y], [x + long, y + lean], [x + long, y + lean + wide], [x, y + wide]], np.int32)
        cv2.fillPoly(image, [corners], colour)
    blurred: Image = cv2.GaussianBlur(image, (0, 0), 1.2)
    return blurred


# --- pictures over HTTP

QUALITY = 95
SETTINGS = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


class PictureServer:
    """Serves every viewer the newest picture, on the loopback interface only."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._count, self._picture = 0, b""
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _make_handler(self))
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, name="pictures", daemon=True)
        self._thread.start()

    def show(self, image: npt.NDArray[np.uint8]) -> None:
        """Set the newest picture, (height, width, 3) BGR."""
        _, data = cv2.imencode(".jpg", image, SETTINGS)
        self._put(data.tobytes())

    def close(self) -> None:
        self._put(b"")                            # there will be no more
        self._server.shutdown()
        self._server.server_close()

    def wait(self, count: int) -> tuple[int, bytes]:
        """Return the number of the newest picture and the picture, once it is not number `count`."""
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
