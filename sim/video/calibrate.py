"""Metres, level and origin of a side view, each with its standard deviation.

Lengths come from the diameter of the ball, from two or more marks at known places, from an AprilTag of known size, from
truearc's sheet (`truearc track --guide`), or from several of them. The sheet is an AprilTag on the robot, in the plane
of the flight at a known place beside the exit, so that the exit is known wherever the robot stands. Nothing is assumed
silently: what was used is listed, and the standard deviations become the priors `[tracker]` of rig.toml, within which
discovery fits the tracker's scale, tilt and clock.
Frame: x toward the target, z up from the floor; origin on the floor below the exit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.errors import InputError
from truearc.sim.video.ballistics import Floats, fly
from truearc.sim.video.frames import Image
from truearc.sim.video.link import Flight, sigma_px

# Chosen: blur and coding make a diameter uncertain by this much, for all flights; drawn clips are within 1.5 %
DIAMETER_SD_PX, DIAMETER_SD = 0.4, 0.02
BLOB_SD_PX = 0.3                      # measured: of a single diameter, on rendered clips
MARK_SD_PX = 2.0                      # of a mark clicked on a picture
DEPTH_SD = 0.015                      # a mark a hand before or behind the flight, seen from 6 m
TAG_SD_PX = 0.3                       # of a corner of an AprilTag
LEVEL_SD_DEG = 2.0                    # a phone levelled by eye, and a tag or stick put up by eye
FILE_CLOCK_SD, STATED_CLOCK_SD = 0.002, 0.02      # times that a file states for each frame; a rate that the user states
SHEET = "the sheet"
SHEET_TAG, SHEET_M = 586, 0.24        # of the family 36h11; side of its black square on paper of size A3
SHEET_SD, SHEET_LEVEL_SD_DEG = 0.01, 1.0          # chosen: a sheet a hand off the plane of the flight; hung up by eye
FLOOR_SIDES, FLOOR_SD_DEG = 8.0, 0.4  # sides of the sheet between two places of the robot; chosen: a hall's floor
EXIT_FROM_SHEET_M = (0.40, 0.0)       # the exit, ahead of the sheet's centre and above it
TAG_CELLS, UP = 8, 2                  # of a tag's side; by which a picture is enlarged to align the tag
SHEET_S = 1.5                         # before a flight within which the sheet was where it is
SHEET_MOVED_PX = 4.0                  # farther apart, it was at two places
CLASH_SDS = 3.0                       # two sources farther apart are not both right
SAME_EXIT_M = 0.25                    # flights that begin farther apart leave from two launchers
# Measured: behind people a ball was first seen up to 0.2 s after its release
HIDDEN_S, HIDDEN_STEPS = 0.3, 16


class Mark(NamedTuple):
    """A place of the picture whose place in the world is known.

    Fields:
        x_px, y_px: In the picture, from its upper left corner.
        x_m, z_m: In the plane of the flight; of the launcher frame.
    """

    x_px: float
    y_px: float
    x_m: float
    z_m: float


class Sheet(NamedTuple):
    """truearc's sheet as it was seen.

    Fields:
        time_s: In the clip.
        x_px, y_px: Its centre.
        side_px: Side of its black square.
        tilt_rad: Angle by which the picture's x axis points up beside its upper edge.
    """

    time_s: float
    x_px: float
    y_px: float
    side_px: float
    tilt_rad: float


class Source(NamedTuple):
    """One measurement of the scale.

    Fields:
        name: What it was measured on.
        metres_per_px: Its value.
        sd: Standard deviation, as a share.
    """

    name: str
    metres_per_px: float
    sd: float


@dataclass(frozen=True)
class Calibration:
    """How pixels become metres.

    metres_per_px: In the plane of the flight; None if nothing known was in view.
    scale_sd: Its standard deviation, as a share.
    tilt_rad: Angle by which the picture's x axis points up in the world, as measured; 0 if it was not.
    tilt_sd_deg: Standard deviation of the level.
    clock_sd: Standard deviation of the rate of the clock, as a share.
    sources: What the scale was measured on.
    warnings: Sentences about sources that contradict each other.
    anchor: A mark that fixes the origin; None: flights begin at the exit.
    """

    metres_per_px: float | None
    scale_sd: float = float("nan")
    tilt_rad: float = 0.0
    tilt_sd_deg: float = LEVEL_SD_DEG
    clock_sd: float = FILE_CLOCK_SD
    sources: tuple[Source, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    anchor: Mark | None = None


def calibrate(flights: Sequence[Flight], picture: Image, *, diameter_m: float | None = None,
              marks: Sequence[Mark] = (), tag_m: float | None = None, sheets: Sequence[Sheet] = (),
              clock_sd: float = FILE_CLOCK_SD) -> Calibration:
    """Combine what is known of a clip's lengths.

    Args:
        flights: Of the clip.
        picture: Its background, in which tags are sought.
        diameter_m: Of the ball; None if unknown.
        marks: Known places; two or more give scale and level, one gives the origin.
        tag_m: Side of an AprilTag (36h11) in the plane of the flight; None if there is none.
        sheets: truearc's sheet, beside each flight where it was seen.
        clock_sd: Of the rate of the clip's clock.

    Raises:
        InputError: No tag is found, or all marks are at one place.
    """
    sources, tilts = [], []
    if diameter_m is not None and flights:
        unit_px = float(np.median([flight.unit_px for flight in flights]))
        sources.append(Source("the ball's diameter", diameter_m / unit_px,
                              float(np.hypot(DIAMETER_SD, DIAMETER_SD_PX / unit_px))))
    if tag_m is not None:
        source, tilt = _by_tag(picture, tag_m)
        sources.append(source)
        tilts.append(tilt)
    if sheets:
        side_px = float(np.median([sheet.side_px for sheet in sheets]))
        sources.append(Source(SHEET, SHEET_M / side_px, float(np.hypot(TAG_SD_PX / side_px, SHEET_SD))))
        tilts.append(_level_by(sheets))
    if len(marks) >= 2:
        source, tilt = _by_marks(marks)
        sources.append(source)
        tilts.append(tilt)
    tilt_rad, tilt_sd = tilts[-1] if tilts else (0.0, LEVEL_SD_DEG)
    anchor = marks[0] if marks else None
    if not sources:
        return Calibration(None, tilt_rad=tilt_rad, tilt_sd_deg=tilt_sd, clock_sd=clock_sd, anchor=anchor)
    logs, weights = np.log([one.metres_per_px for one in sources]), np.array([one.sd ** -2 for one in sources])
    mean = float((weights * logs).sum() / weights.sum())
    return Calibration(float(np.exp(mean)), float(weights.sum() ** -0.5), tilt_rad, tilt_sd, clock_sd,
                       tuple(sources), tuple(_clashes(sources)), anchor)


def _clashes(sources: list[Source]) -> list[str]:
    found = []
    for k, one in enumerate(sources):
        for other in sources[k + 1:]:
            off = float(np.log(one.metres_per_px / other.metres_per_px))
            if abs(off) > CLASH_SDS * np.hypot(one.sd, other.sd):
                found.append(f"{one.name} makes lengths {abs(np.expm1(off)):.0%} {'longer' if off > 0 else 'shorter'} "
                             f"than {other.name}: one of the two is stated wrong or not in the plane of the flight")
    return found


def _by_marks(marks: Sequence[Mark]) -> tuple[Source, tuple[float, float]]:
    """(scale, (tilt, its sd in degrees)) of the similarity that maps the marks' pixels to their places."""
    pixels = np.array([complex(mark.x_px, -mark.y_px) for mark in marks])
    places = np.array([complex(mark.x_m, mark.z_m) for mark in marks])
    spread = pixels - pixels.mean()
    if not (abs(spread) > 1.0).any() or not (abs(places - places.mean()) > 0.0).any():
        raise InputError("--mark: all marks are at one place; two apart give a scale")
    reach = float(np.sqrt((abs(spread) ** 2).sum()))
    ends = places - places.mean()
    # seen from the one side or the other of the flight: the one that needs less of a turn
    turns = ((np.conj(spread) * ends).sum() / reach ** 2, -(spread * ends).sum() / reach ** 2)
    turn, way = min(zip(turns, (1, -1), strict=True), key=lambda pair: abs(np.angle(pair[0])))
    tilt = way * float(np.angle(turn))
    return (Source(f"{len(marks)} marks", float(abs(turn)), float(np.hypot(MARK_SD_PX / reach, DEPTH_SD))),
            (tilt, float(np.degrees(MARK_SD_PX / reach))))


def _by_tag(picture: Image, side_m: float) -> tuple[Source, tuple[float, float]]:
    corners = [one for number, one in find_tags(picture) if number != SHEET_TAG]
    if not corners:
        raise InputError("--tag-size: no AprilTag (36h11) is in view")
    side_px, tilt = _measured(max(corners, key=lambda one: cv2.contourArea(one.astype(np.float32))))
    return (Source("the AprilTag", side_m / side_px, float(np.hypot(TAG_SD_PX / side_px, DEPTH_SD))),
            (tilt, LEVEL_SD_DEG / 2.0))


def find_tags(picture: Image) -> list[tuple[int, Floats]]:
    """Return number and corners [4, 2] (upper left, upper right, lower right, lower left) of each AprilTag (36h11).

    The corners that OpenCV finds on a small tag are wrong by up to a pixel. They are refined by aligning the whole
    pattern with the picture (Evangelidis and Psarakis 2008).
    """
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, numbers, _ = cv2.aruco.ArucoDetector(family).detectMarkers(picture)
    found = []
    for number, one in zip([] if numbers is None else np.ravel(numbers), corners, strict=True):
        ends = np.asarray(one, dtype=np.float32).reshape(4, 2)
        cell_px = max(round(UP * float(np.ptp(ends, axis=0).max()) / TAG_CELLS), 4)
        pattern = cv2.aruco.generateImageMarker(family, int(number), TAG_CELLS * cell_px)
        found.append((int(number), _aligned(picture, pattern, ends)))
    return found


def _aligned(picture: Image, pattern: Image, corners: npt.NDArray[np.float32]) -> Floats:
    """Corners of a tag by aligning its pattern, white edge included; those given if that does not converge."""
    side, reach = len(pattern), np.ptp(corners, axis=0).max() / 2.0
    (x0, y0), (x1, y1) = (corners.min(axis=0) - reach).clip(0).astype(int), (corners.max(axis=0) + reach).astype(int)
    # both at one scale, for alignment blurs both
    part = cv2.resize(picture[y0:y1, x0:x1], None, fx=UP, fy=UP, interpolation=cv2.INTER_CUBIC)
    edge = side // TAG_CELLS
    flat = edge - 0.5 + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    ends = ((corners - [x0, y0] + 0.5) * UP - 0.5).astype(np.float32)
    try:
        _, turn = cv2.findTransformECC(
            cv2.copyMakeBorder(pattern, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=255), part,
            cv2.estimateAffine2D(flat, ends)[0].astype(np.float32), cv2.MOTION_AFFINE,
            (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-5))
    except cv2.error:
        return corners.astype(np.float64)
    refined: Floats = ((flat @ turn[:, :2].T + turn[:, 2]) + 0.5) / UP - 0.5 + np.array([x0, y0], dtype=np.float64)
    return refined


def find_sheet(picture: Image, time_s: float) -> Sheet | None:
    """Return truearc's sheet; None if it is not in view."""
    for number, corners in find_tags(picture):
        if number == SHEET_TAG:
            (x_px, y_px), (side_px, tilt_rad) = corners.mean(axis=0).tolist(), _measured(corners)
            return Sheet(time_s, x_px, y_px, side_px, tilt_rad)
    return None


def _measured(corners: Floats) -> tuple[float, float]:
    """(side in pixels, tilt) of a tag. At a slant, width and height differ; the longer pair is nearer the truth."""
    edges = np.roll(corners, -1, axis=0) - corners
    sides = np.hypot(edges[:, 0], edges[:, 1])
    level = edges[0] - edges[2]       # from the upper left to the upper right corner
    return float(max(sides[0] + sides[2], sides[1] + sides[3]) / 2.0), float(np.arctan2(level[1], level[0]))


def _level_by(sheets: Sequence[Sheet]) -> tuple[float, float]:
    """(tilt, its sd in degrees) by where the sheet stood, if it stood far apart on one floor, else by its edges."""
    x_px, y_px, side_px, tilt = (np.array([getattr(sheet, name) for sheet in sheets])
                                 for name in ("x_px", "y_px", "side_px", "tilt_rad"))
    if np.ptp(x_px) > FLOOR_SIDES * np.median(side_px):
        return float(np.arctan(np.polyfit(x_px, y_px, 1)[0])), FLOOR_SD_DEG
    edges = np.degrees(TAG_SD_PX / np.median(side_px))
    return float(np.median(tilt)), float(np.hypot(SHEET_LEVEL_SD_DEG, edges))


def sheet_beside(flight: Flight, sheets: Sequence[Sheet]) -> Sheet | None:
    """Return where the sheet was during a flight: the median of what was seen since the robot stood there."""
    begin_s, end_s = flight.blobs[0].time_s, flight.blobs[-1].time_s
    near = [sheet for sheet in sheets if begin_s - SHEET_S <= sheet.time_s <= end_s]
    near = [sheet for sheet in near if np.hypot(sheet.x_px - near[-1].x_px, sheet.y_px - near[-1].y_px)
            < SHEET_MOVED_PX]
    return Sheet(*map(float, np.median(near, axis=0))) if near else None


# --- positions

class Placed(NamedTuple):
    """A flight in metres.

    Fields:
        metres_per_px: In its own plane.
        time_s: In the clip, corrected for the rolling shutter [n].
        x_m, z_m: Launcher frame [n].
        sigma_x_m, sigma_z_m: Standard deviations of the noise [n].
    """

    metres_per_px: float
    time_s: Floats
    x_m: Floats
    z_m: Floats
    sigma_x_m: Floats
    sigma_z_m: Floats


def exits_of(flights: Sequence[Flight], metres_per_px: float, exit_px: tuple[float, float] | None = None,
             sheets: Sequence[Sheet | None] = ()) -> list[list[int]]:
    """Group rows of flights by where, from the sheet if that is seen, and in which direction they begin: a group a
    launcher.

    A flight that was hidden at first, as behind a person, belongs to the launcher from which its motion comes. The
    largest group is first, or that which begins nearest to the exit if that is known.
    """
    began = np.array([(flight.blobs[0].x_px, flight.blobs[0].y_px) for flight in flights])
    stands = np.array([(0.0, 0.0) if sheet is None else (sheet.x_px, sheet.y_px)
                       for sheet in sheets or [None] * len(flights)])
    before = [_before(flight) - stand for flight, stand in zip(flights, stands, strict=True)]
    groups: list[list[int]] = []
    for row, flight in enumerate(flights):
        for group in groups:
            first = group[0]
            apart_px = min(float(np.hypot(*(before[one] - began[other] + stands[other]).T).min())
                           for one, other in ((row, first), (first, row)))
            if _forward(flight) == _forward(flights[first]) and apart_px < SAME_EXIT_M / metres_per_px:
                group.append(row)
                break
        else:
            groups.append([row])
    if exit_px is not None:
        return sorted(groups, key=lambda group: np.hypot(*(began[group[0]] - exit_px)))
    return sorted(groups, key=len, reverse=True)


def _before(flight: Flight) -> Floats:
    """Pixels [k, 2] of a flight where it begins and where it was before, if it flew then, as far as HIDDEN_S."""
    ways = fly(flight.fit.values[:, None], -np.linspace(0.0, HIDDEN_S, HIDDEN_STEPS))[:, :2, 0] * flight.unit_px
    return np.column_stack([ways[:, 0], -ways[:, 1]])


def _forward(flight: Flight) -> int:
    return 1 if flight.blobs[-1].x_px >= flight.blobs[0].x_px else -1


def place_flights(flights: Sequence[Flight], calibration: Calibration, readout_s: float, noise_px: tuple[float, float],
                  release_height_m: float, exit_px: tuple[float, float] | None = None,
                  sheets: Sequence[Sheet | None] = ()) -> list[Placed]:
    """Return the flights of one launcher in metres.

    Args:
        flights: Of one launcher.
        calibration: With a scale.
        readout_s: Of the rolling shutter.
        noise_px: Factors of `sigma_px` across and up.
        release_height_m: Height of the exit above the floor, where no mark fixes the origin.
        exit_px: The exit in the picture; None: the mean of where the flights begin.
        sheets: The sheet beside each flight, which gives the exit where no mark does; None where it was not seen.
    """
    common, mark = calibration.metres_per_px or 1.0, calibration.anchor
    way = 1 if sum(map(_forward, flights)) >= 0 else -1
    begin = exit_px or tuple(np.median([(one.blobs[0].x_px, one.blobs[0].y_px) for one in flights], axis=0))
    origin = (mark.x_px, mark.y_px, mark.x_m, mark.z_m) if mark else (*begin, 0.0, release_height_m)
    cosine, sine = np.cos(calibration.tilt_rad), np.sin(calibration.tilt_rad)
    placed = []
    for flight, sheet, far in zip(flights, sheets or [None] * len(flights), depths(flights), strict=True):
        scale = common * float(far)
        if sheet is not None and not mark and exit_px is None:
            ahead, above = (one / scale for one in EXIT_FROM_SHEET_M)
            origin = (sheet.x_px + way * ahead * cosine + above * sine,
                      sheet.y_px + way * ahead * sine - above * cosine, 0.0, release_height_m)
        across = np.array([blob.x_px for blob in flight.blobs]) - origin[0]
        up = origin[1] - np.array([blob.y_px for blob in flight.blobs])
        sigma = np.array([sigma_px(blob) for blob in flight.blobs]) * scale
        placed.append(Placed(scale, np.array([blob.time_s + readout_s * blob.row for blob in flight.blobs]),
                             origin[2] + way * scale * (across * cosine - up * sine),
                             origin[3] + scale * (up * cosine + across * sine),
                             sigma * noise_px[0], sigma * noise_px[1]))
    return placed


def depths(flights: Sequence[Flight]) -> Floats:
    """Return how much farther away than usual each flight is, as a ratio, by how large its ball seems.

    Robots do not all stand in one plane. What diameters differ by chance is taken off: flights are as far apart as the
    variance between them that is left says (empirical Bayes).
    """
    logs = np.log([flight.unit_px for flight in flights])
    # of the median of a third of a flight's diameters
    own = np.array([1.25 * BLOB_SD_PX / flight.unit_px / np.sqrt(max(len(flight.blobs) / 3.0, 3.0))
                    for flight in flights])
    off = logs - np.median(logs)
    between = max(float((off ** 2 - own ** 2).mean()), 0.0)
    found: Floats = np.exp(-off * between / (between + own ** 2))
    return found


def noise_factors(flights: Sequence[Flight]) -> tuple[float, float]:
    """Return how much larger than `sigma_px` the residuals of flights are, across and up (root mean square)."""
    squares, free = np.zeros(2), 0.0
    for flight in flights:
        sigma = np.array([sigma_px(blob) for blob in flight.blobs]) / flight.unit_px
        squares += ((flight.fit.residual / sigma[:, None]) ** 2).sum(axis=0)
        free += max(len(flight.blobs) - 3.0, 1.0)         # six numbers of a flight, three an axis
    across, up = np.sqrt(squares / max(free, 1.0))
    return max(float(across), 0.25), max(float(up), 0.25)
