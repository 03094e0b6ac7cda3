"""Frames of a clip: a video file, through PyAV, or a folder of pictures, through OpenCV.

Times are the presentation times of the container, so that a variable frame rate and dropped frames do no harm. The
rotation that a phone notes is applied. A clip can be read any number of times, one frame in memory at a time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.errors import InputError, load_bytes

Image = npt.NDArray[np.uint8]
PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")
FORMAT = "yuv420p"                    # what cameras record; others, such as ten bits of HDR, are converted
MAX_PIXELS = 4096 * 2304              # a frame of 4K; larger ones would need gigabytes
LONG_SHARE = 0.02                     # of a clip's stated duration that may be missing at its end


class Frame(NamedTuple):
    """One picture of a clip, as it is to be looked at.

    Fields:
        time_s: Time since the first frame.
        luma: Brightness [rows, columns].
        chroma: The two colour differences at half the resolution [2, rows / 2, columns / 2].
    """

    time_s: float
    luma: Image
    chroma: Image

    def to_bgr(self) -> Image:
        """Return the picture in colours, for drawing on it."""
        planar = np.concatenate([self.luma.ravel(), self.chroma.ravel()])
        return np.asarray(cv2.cvtColor(planar.reshape(-1, self.luma.shape[1]), cv2.COLOR_YUV2BGR_I420), dtype=np.uint8)


@dataclass(frozen=True)
class Clip:
    """A clip that can be read.

    path: Video file or folder of pictures.
    rate_hz: Stored frames a second on average, as stated by the file or by the user; 0 if unknown.
    duration_s: As stated; 0 if unknown.
    quarter_turns: Counterclockwise turns that make the picture upright.
    slow_motion: How many seconds of the file are one true second (4: filmed at 240, stored at 60 frames a second).
    first_s: Time of the first frame in the file.
    """

    path: Path
    rate_hz: float
    duration_s: float
    quarter_turns: int = 0
    slow_motion: float = 1.0
    first_s: float = 0.0

    @property
    def name(self) -> str:
        """Name without folders and ending, for shots and pictures."""
        return self.path.stem

    def frames(self, begin_s: float = 0.0) -> Iterator[Frame]:
        """Yield the frames from a time on, in order; stop where a damaged file cannot be read on.

        Raises:
            InputError: The file's frames have no times or differ in size, or a picture cannot be read.
        """
        skipped_s = begin_s * self.slow_motion
        stored = (_pictures(self.path, self.rate_hz) if self.path.is_dir() else
                  _decoded(self.path, self.first_s + skipped_s if begin_s > 0.0 else None))
        last_s, size = -np.inf, None
        for time_s, planar, width in stored:
            if time_s <= last_s or time_s - self.first_s < skipped_s - 1e-6:      # a frame that comes twice, or before
                continue
            last_s = time_s
            luma, chroma = _planes(planar, width)
            if self.quarter_turns:
                luma = np.ascontiguousarray(np.rot90(luma, self.quarter_turns))
                chroma = np.ascontiguousarray(np.rot90(chroma, self.quarter_turns, axes=(1, 2)))
            size = size or luma.shape
            if luma.shape != size:    # as of clips that were joined
                raise InputError(f"{self.path}: its pictures change their size after {time_s - self.first_s:.1f} s; "
                                 "cut it there")
            yield Frame((time_s - self.first_s) / self.slow_motion, luma, chroma)

    def is_cut_short(self, last_s: float) -> bool:
        """Whether a clip whose last frame is at `last_s` lacks more of its end than rounding explains."""
        return self.duration_s > 0.0 and last_s < (1.0 - LONG_SHARE) * self.duration_s - 0.5 / self.slow_motion


def open_clip(path: str | Path, rate_hz: float | None = None, slow_motion: float = 1.0) -> Clip:
    """Open a video file or a folder of pictures, and decode its first frame.

    Args:
        path: File or folder.
        rate_hz: Pictures a second in a folder; a file states its own times.
        slow_motion: As in Clip.

    Raises:
        InputError: It cannot be read; the message says why.
    """
    path = Path(path)
    if path.is_dir():
        if rate_hz is None:
            raise InputError(f"{path}: a folder of pictures has no times; state its rate with --rate")
        clip = Clip(path, rate_hz, len(_listed(path)) / rate_hz / slow_motion, 0, slow_motion)
    else:
        if not path.is_file():
            load_bytes(path)          # says what there is instead
        clip = _opened(path, slow_motion)
    if next(clip.frames(), None) is None:
        raise InputError(f"{path}: no frame of it can be decoded")
    return clip


# --- files

def _opened(path: Path, slow_motion: float) -> Clip:
    av = _av()
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            stream = _video(container, path)
            rate = float(stream.average_rate or stream.guessed_rate or 0.0)
            length = stream.duration * stream.time_base if stream.duration and stream.time_base else (
                container.duration / av.time_base if container.duration else 0.0)
            frame = next(container.decode(stream), None)
    except (av.error.FFmpegError, UnicodeError) as error:
        raise InputError(f"{path}: cannot be read as a video: {_why(error, path)}") from error
    if frame is None:
        raise InputError(f"{path}: no frame of it can be decoded")
    first_s = float(frame.pts * frame.time_base) if frame.pts is not None and frame.time_base else 0.0
    return Clip(path, rate, float(length) / slow_motion, round(frame.rotation / 90.0) % 4, slow_motion, first_s)


def _decoded(path: Path, begin_s: float | None = None) -> Iterator[tuple[float, Image, int]]:
    """(time, planar picture, its width) of the frames of a file, from the last key frame before `begin_s` on."""
    av = _av()
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            stream = _video(container, path)
            stream.thread_type = "AUTO"
            if begin_s is not None:
                container.seek(int(begin_s / stream.time_base), stream=stream)
            for frame in container.decode(stream):
                if frame.pts is None or frame.time_base is None:
                    raise InputError(f"{path}: its frames have no times, as in a raw stream; put it into an MP4 file")
                even = (frame.width - frame.width % 2, frame.height - frame.height % 2)
                if frame.format.name not in (FORMAT, "yuvj420p") or even != (frame.width, frame.height):
                    frame = frame.reformat(width=even[0], height=even[1], format=FORMAT)
                yield float(frame.pts * frame.time_base), frame.to_ndarray(), even[0]
    except av.error.FFmpegError:      # damaged from here on: what came before is good
        return


def _video(container: Any, path: Path) -> Any:
    stream = next(iter(container.streams.video), None)
    if stream is None:
        raise InputError(f"{path}: has no pictures; name a video")
    # decoding without a codec ends the process (PyAV #2344)
    if stream.codec_context is None or not stream.codec_context.width:
        raise InputError(f"{path}: is damaged or cut short: nothing says how its pictures are coded")
    if stream.codec_context.width * stream.codec_context.height > MAX_PIXELS:
        raise InputError(f"{path}: its pictures have {stream.codec_context.width} x {stream.codec_context.height} "
                         "pixels; at most 4K is read")
    return stream


def _av() -> Any:
    try:
        import av
    except ImportError as error:
        raise InputError("reading videos needs PyAV: pip install 'truearc[video]'") from error
    return av


def _why(error: Exception, path: Path) -> str:
    text = getattr(error, "strerror", None) or str(error)
    if "Invalid data" not in text:
        return text
    with path.open("rb") as file:
        is_movie = file.read(8)[4:] == b"ftyp"        # MP4 and MOV, which have their index at the end
    return text + ("; the index at its end is missing, as in a recording that was cut short" if is_movie else "")


# --- folders

def _listed(folder: Path) -> list[Path]:
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    if not paths:
        raise InputError(f"{folder}: holds no pictures ({', '.join(PICTURES)})")
    return paths


def _pictures(folder: Path, rate_hz: float) -> Iterator[tuple[float, Image, int]]:
    size = None
    for number, path in enumerate(_listed(folder)):
        picture = cv2.imdecode(np.frombuffer(load_bytes(path), np.uint8), cv2.IMREAD_COLOR)
        if picture is None:
            raise InputError(f"{path}: cannot be read as a picture")
        rows, columns = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
        size = size or (rows, columns)
        if (rows, columns) != size:
            raise InputError(f"{path}: has {columns} x {rows} pixels, the pictures before it {size[1]} x {size[0]}")
        yield number / rate_hz, cv2.cvtColor(picture[:rows, :columns], cv2.COLOR_BGR2YUV_I420), columns


def _planes(planar: Image, width: int) -> tuple[Image, Image]:
    rows = planar.shape[0] * 2 // 3
    return planar[:rows], planar[rows:].reshape(2, rows // 2, width // 2)
