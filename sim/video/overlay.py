"""Pictures of what was found.

A flight as a stroboscope would show it, with its positions and the fitted curve; and all flights of a clip, coloured by
outcome, beside those of a simulation.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from truearc.errors import InputError
from truearc.sim.video.ballistics import LONGEST_STEP_S, Floats, X, Z, fly
from truearc.sim.video.calibrate import Placed
from truearc.sim.video.frames import Image
from truearc.sim.video.link import Flight
from truearc.sim.video.track import TrackedClip

FOUND, FITTED, TEXT = (0, 220, 255), (255, 160, 0), (255, 255, 255)         # blue, green, red
MOST_COLUMNS = 1280                   # of a picture that is saved
OUTCOME_BGR = {"three": (63, 180, 40), "two": (0, 190, 240), "hit": (63, 180, 40), "miss": (50, 50, 230)}
UNKNOWN, SIMULATED = (170, 170, 170), (255, 255, 255)
DASH, LEFT_OUT = 3, 1                 # points of a simulated flight that are joined, and left out
SLACK_S = 1e-4                        # between a time and the same time read again


def draw_flight(tracked: TrackedClip, number: int) -> Image:
    """Return a picture of a flight: the ball of every frame in one, circles where it was found, and the fit.

    Args:
        tracked: A clip with its flights.
        number: Of the flight, from 0.
    """
    flight, blobs = tracked.flights[number], {blob.frame: blob for blob in tracked.flights[number].blobs}
    times = {round(blob.time_s, 4): blob for blob in blobs.values()}
    picture: Image | None = None
    for frame in tracked.clip.frames(max(flight.blobs[0].time_s - SLACK_S, 0.0)):
        if frame.time_s > flight.blobs[-1].time_s + SLACK_S:
            break
        colours = frame.to_bgr()
        picture = colours if picture is None else picture
        blob = times.get(round(frame.time_s, 4))
        if blob is not None:
            reach = 0.5 * (blob.diameter_px + blob.length_px) + 3.0
            (left, right), (top, bottom) = ((max(int(place - reach), 0), int(place + reach) + 1)
                                            for place in (blob.x_px, blob.y_px))
            picture[top:bottom, left:right] = colours[top:bottom, left:right]
    if picture is None:
        raise InputError(f"{tracked.clip.path}: flight {number + 1} cannot be read again")
    return _annotated(picture, tracked, number)


def draw_clip(tracked: TrackedClip, outcomes: Sequence[str], simulated: Sequence[Floats | None] = ()) -> Image:
    """Return the clip's first picture with every flight drawn on it.

    Args:
        tracked: A clip with its flights.
        outcomes: Of each flight; "" where it is not known.
        simulated: Places [k, 2] in m, ahead of the exit and above the floor, of each flight by a simulation; drawn as
            dashed lines. None: there is none.

    Raises:
        InputError: The clip cannot be read again.
    """
    first = next(tracked.clip.frames(), None)
    if first is None:
        raise InputError(f"{tracked.clip.path}: cannot be read again")
    scale = min(1.0, MOST_COLUMNS / first.luma.shape[1])
    picture = np.asarray(cv2.resize(first.to_bgr(), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    picture = np.asarray(cv2.addWeighted(picture, 0.75, np.zeros_like(picture), 0.0, 0.0), dtype=np.uint8)
    for number, flight in enumerate(tracked.flights):
        colour = OUTCOME_BGR.get(outcomes[number], UNKNOWN)
        pixels = scale * np.array([(blob.x_px, blob.y_px) for blob in flight.blobs])
        cv2.polylines(picture, [_fine(pixels)], False, colour, 2, cv2.LINE_AA, shift=4)
        for x_px, y_px in pixels[::2]:
            cv2.circle(picture, (round(16 * x_px), round(16 * y_px)), 40, colour, -1, cv2.LINE_AA, shift=4)
        path = simulated[number] if number < len(simulated) else None
        if path is not None and number < len(tracked.placed):
            points = scale * _plane(path) @ to_pixel(flight, tracked.placed[number])
            for k in range(0, len(points) - DASH, DASH + LEFT_OUT):
                cv2.polylines(picture, [_fine(points[k:k + DASH + 1])], False, SIMULATED, 1, cv2.LINE_AA, shift=4)
    _legend(picture, tracked, outcomes, any(path is not None for path in simulated))
    return picture


def to_pixel(flight: Flight, placed: Placed) -> Floats:
    """Return the matrix [3, 2] from (metres ahead of the exit, above the floor, 1) to the pixels of a flight."""
    pixels = np.array([(blob.x_px, blob.y_px) for blob in flight.blobs])
    found: Floats = np.linalg.lstsq(_plane(np.column_stack([placed.x_m, placed.z_m])), pixels, rcond=None)[0]
    return found


def _plane(places_m: Floats) -> Floats:
    return np.column_stack([places_m, np.ones(len(places_m))])


def _fine(points: Floats) -> npt.NDArray[np.int32]:
    return np.asarray(np.round(16.0 * points.clip(-4000.0, 8000.0)), dtype=np.int32)


def _legend(picture: Image, tracked: TrackedClip, outcomes: Sequence[str], is_simulated: bool) -> None:
    rows = [(f"{tracked.clip.name}: {len(tracked.flights)} flights", TEXT)]
    for name in dict.fromkeys([*OUTCOME_BGR, ""]):
        if count := sum(one == name for one in outcomes):
            rows.append((f"{count} {name or 'without a recorded shot'}", OUTCOME_BGR.get(name, UNKNOWN)))
    if is_simulated:
        rows.append(("dashed: the simulation without corrections", SIMULATED))
    cv2.rectangle(picture, (4, 4), (400, 12 + 22 * len(rows)), (20, 20, 20), -1)
    for row, (text, colour) in enumerate(rows):
        cv2.putText(picture, text, (12, 22 + 22 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.55, colour, 1, cv2.LINE_AA)


def _annotated(picture: Image, tracked: TrackedClip, number: int) -> Image:
    flight = tracked.flights[number]
    scale = min(1.0, MOST_COLUMNS / picture.shape[1])
    picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    span_s = flight.blobs[-1].time_s - flight.blobs[0].time_s
    curve = fly(flight.fit.values[:, None], np.linspace(0.0, span_s, int(2.0 * span_s / LONGEST_STEP_S) + 8))
    points = scale * flight.unit_px * np.stack([curve[:, X, 0], -curve[:, Z, 0]], axis=1)
    cv2.polylines(picture, [np.round(16.0 * points).astype(np.int32)], False, FITTED, 1, cv2.LINE_AA, shift=4)
    for blob in flight.blobs:
        centre = (round(16.0 * scale * blob.x_px), round(16.0 * scale * blob.y_px))
        cv2.circle(picture, centre, round(8.0 * scale * blob.diameter_px), FOUND, 1, cv2.LINE_AA, shift=4)
        cv2.circle(picture, centre, 16, FOUND, -1, cv2.LINE_AA, shift=4)
    said = tracked.line(number).replace(", ", "\n", 2).split("\n")
    for row, text in enumerate(said):
        place = (10, 24 + 22 * row)
        (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
        corners = (place[0] - 3, place[1] - height - 3), (place[0] + width + 3, place[1] + below)
        cv2.rectangle(picture, *corners, (0, 0, 0), -1)
        cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, TEXT, 1, cv2.LINE_AA)
    return picture
