"""Pictures of what was found: a flight as a stroboscope would show it, with its positions and the fitted curve."""

import cv2
import numpy as np

from truearc.errors import InputError
from truearc.sim.video.ballistics import LONGEST_STEP_S, X, Z, fly
from truearc.sim.video.frames import Image
from truearc.sim.video.track import TrackedClip

FOUND, FITTED, TEXT = (0, 220, 255), (255, 160, 0), (255, 255, 255)         # blue, green, red
MOST_COLUMNS = 1280                   # of a picture that is saved
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
