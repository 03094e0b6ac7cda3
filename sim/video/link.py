"""Flights: blobs of successive pictures that lie on one ballistic curve.

Three blobs in near pictures are a seed. It grows by prediction from its newest positions, is fitted as a whole, and the
longest consistent flight takes its blobs before the next. What is carried by a hand or rolls does not fall freely: its
fitted acceleration is not downward, not constant, or not that of the other flights.
Frame: x to the right, z up. Unit of length: the diameter of the ball.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from truearc.sim.video.ballistics import READOUT, FlightFit, Floats, G, Priors, fit_flight, fly
from truearc.sim.video.detect import Blob

# Chosen on clips that tests/sim/video draws and on four by others; no benchmark measures them yet
FEWEST = 7                            # positions of a flight
WINDOW_S, KEPT_S = 14.0, 3.0          # blobs that are looked at together; and how long a flight may last
GAP_S, GAP_FRAMES = 0.2, 3            # without a blob, after which a flight has ended (the longer)
MEMORY = 8                            # newest positions that predict the next
SPEEDS = 400.0                        # diameters a second: more than any ball's
GRAVITY = (2.0, 700.0)                # diameters/s2: balls of 1.4 cm, and of 30 cm in slow motion of four times
SLOW, MANY, SMOOTH = 15.0, 20, 0.25   # falls slower than 65 cm balls' need as many positions, and that share of ROUGH
SIZES = 1.6                           # ratio of two diameters of one ball, streaks included
HIDDEN, MOST_HIDDEN = 0.87, 3         # share of the diameter that is seen of a partly hidden ball; such balls at an end
GATE = 0.6                            # diameters between prediction and blob
CURVED_SD = 0.12                      # share: a flight whose gravity is less certain may be a straight line
SAGITTA = 0.35                        # diameters by which the path leaves its chord, at least
ROUGH = 0.09                          # diameters: residual of a flight; of a hand's way it is larger
DENSE = 0.7                           # share of the pictures of a flight in which the ball is found
ANY_BALL = Priors(drag=(0.004, 0.004))            # 1/diameter: balls of 2 to 20 cm
AGREE = 0.25                          # share by which gravities of one clip may differ, for depth and noise


class Flight(NamedTuple):
    """One ball in the air.

    Fields:
        blobs: Its positions, by time.
        unit_px: Pixels of a diameter, the unit of `fit`.
        fit: Motion in diameters.
    """

    blobs: tuple[Blob, ...]
    unit_px: float
    fit: FlightFit

    @property
    def gravity(self) -> float:
        """Fitted gravity in diameters/s2."""
        return float(self.fit.values[G])


def link_flights(pictures: Iterable[list[Blob]], gravity: tuple[float, float] = GRAVITY) -> Iterator[Flight]:
    """Yield flights by their end; memory does not grow with the clip.

    Args:
        pictures: The blobs of each picture, in the order of time.
        gravity: Least and greatest, in diameters/s2.
    """
    window: list[list[Blob]] = []
    for blobs in pictures:
        if blobs:
            window.append(blobs)
        if window and window[-1][0].time_s - window[0][0].time_s > WINDOW_S:
            end_s = window[-1][0].time_s
            ended = [flight for flight in _flights_in(window, gravity) if flight.blobs[-1].time_s < end_s - KEPT_S]
            yield from ended
            used = {blob for flight in ended for blob in flight.blobs}
            window = [left for blobs in window if blobs[0].time_s > end_s - 2.0 * KEPT_S
                      if (left := [blob for blob in blobs if blob not in used])]
    yield from _flights_in(window, gravity)


def _flights_in(window: list[list[Blob]], gravity: tuple[float, float]) -> list[Flight]:
    """The flights among the blobs of some pictures, none of which two flights share; by their end."""
    used: set[Blob] = set()
    grown: list[tuple[Blob, ...]] = []
    covered: set[tuple[Blob, Blob]] = set()
    for k in range(len(window) - 2):
        for first, second, third in _seeds(window, k, gravity):
            if (first, second) not in covered:
                chain = _grow(window, (first, second, third), gravity)
                covered |= {(a, b) for n, a in enumerate(chain) for b in chain[n + 1:n + 1 + GAP_FRAMES]}
                if len(chain) >= FEWEST:
                    grown.append(chain)
    found = []
    queue = sorted(grown, key=len, reverse=True)
    while queue:
        chain = queue.pop(0)
        left = tuple(blob for blob in chain if blob not in used)
        if len(left) < len(chain):    # part of it is another flight's: look again in its turn
            if len(left) >= FEWEST:
                queue = sorted([*queue, left], key=len, reverse=True)
            continue
        flight = settle(chain) if _falls(chain, gravity) else None
        flight = flight and settle(_along(flight, window, used))
        if flight is not None and is_flight(flight, gravity):
            used |= set(flight.blobs)
            found.append(flight)
    return sorted(found, key=lambda flight: flight.blobs[-1].time_s)


def _seeds(window: list[list[Blob]], k: int, gravity: tuple[float, float]) -> Iterator[tuple[Blob, Blob, Blob]]:
    """Three blobs, from picture k on, that a ball in the air could have made."""
    for first in window[k]:
        for second in _next(window, k, first):
            step_s = second.time_s - first.time_s
            for third in _next(window, k + second.frame - first.frame, second):
                more_s = third.time_s - second.time_s
                unit = _diameter((first, second, third))
                ahead = more_s / step_s
                miss_x = third.x_px - second.x_px - (second.x_px - first.x_px) * ahead
                miss_z = -(third.y_px - second.y_px - (second.y_px - first.y_px) * ahead)
                fall = 0.5 * more_s * (more_s + step_s) * unit
                if (abs(miss_x) <= GATE * unit + 0.5 * gravity[1] * fall * 0.2
                        and -gravity[1] * fall - GATE * unit <= miss_z <= GATE * unit):
                    yield first, second, third


def _next(window: list[list[Blob]], k: int, blob: Blob) -> Iterator[Blob]:
    """Blobs of the next two pictures that may be the same ball."""
    for other in (other for blobs in window[k + 1:k + 3] for other in blobs):
        step_s = other.time_s - blob.time_s
        way = np.hypot(other.x_px - blob.x_px, other.y_px - blob.y_px)
        if 0 < other.frame - blob.frame <= 2 and _alike(blob, other) and (
                way < SPEEDS * step_s * max(blob.diameter_px, other.diameter_px)):
            yield other


def _alike(one: Blob, other: Blob) -> bool:
    return 1.0 / SIZES < one.diameter_px / other.diameter_px < SIZES


def _diameter(blobs: Iterable[Blob]) -> float:
    sizes = sorted(blob.diameter_px for blob in blobs)
    return sizes[len(sizes) // 2]     # np.median takes longer than all else for a few


def _grow(window: list[list[Blob]], seed: tuple[Blob, ...], gravity: tuple[float, float]) -> tuple[Blob, ...]:
    """A seed and the blobs that continue it, forward and then backward."""
    by_frame = {blobs[0].frame: blobs for blobs in window}
    rate = max(1.0 / max(seed[1].time_s - seed[0].time_s, 1e-4), 1.0)
    patience = max(GAP_FRAMES, round(GAP_S * rate))
    chain = list(seed)
    for way in (1, -1):
        missed, frame = 0, chain[-1 if way > 0 else 0].frame
        while missed <= patience:
            frame += way
            near = chain[-MEMORY:] if way > 0 else chain[:MEMORY]
            best = _nearest(near, by_frame.get(frame, []), gravity)
            missed = missed + 1 if best is None else 0
            if best is not None:
                chain.insert(len(chain) if way > 0 else 0, best)
            if frame > window[-1][0].frame or frame < window[0][0].frame:
                break
    return tuple(chain)


def _nearest(near: list[Blob], candidates: list[Blob], gravity: tuple[float, float]) -> Blob | None:
    """The candidate nearest to where the newest positions say that the ball is; None if all are too far."""
    unit = _diameter(near)
    fits = [blob for blob in candidates if 1.0 / SIZES < blob.diameter_px / unit < SIZES]
    if not fits:
        return None
    t_s = np.array([blob.time_s for blob in near])
    middle_s = t_s.mean()
    place = np.array([(blob.x_px, -blob.y_px) for blob in near]) / unit
    rows = np.stack([np.ones_like(t_s), t_s - middle_s, 0.5 * (t_s - middle_s) ** 2], axis=1)
    # few positions tell no acceleration: it is between the limits, downward
    typical, spread = np.sqrt(gravity[0] * gravity[1]), 0.5 * gravity[1]
    noise = 0.05
    pull = np.diag([0.0, 0.0, (noise / spread) ** 2])
    normal = rows.T @ rows + pull
    goal = rows.T @ place + pull @ np.array([[0.0, 0.0], [0.0, 0.0], [0.0, -typical]])
    covariance = np.linalg.inv(normal)
    motion = covariance @ goal
    found, least = None, np.inf
    for blob in fits:
        ahead = blob.time_s - middle_s
        row = np.array([1.0, ahead, 0.5 * ahead ** 2])
        doubt = noise * float(np.sqrt(1.0 + row @ covariance @ row))
        miss = np.hypot(*(np.array([blob.x_px, -blob.y_px]) / unit - row @ motion))
        if miss < min(GATE, 0.15 + 4.0 * doubt) and miss < least:
            found, least = blob, float(miss)
    return found


def _falls(chain: tuple[Blob, ...], gravity: tuple[float, float]) -> bool:
    """Whether blobs are near a parabola, roughly: most chains are not, and a fit takes a hundred times as long."""
    unit = _diameter(chain)
    t_s, place = np.array([one.time_s for one in chain]), _places(chain, unit)
    rows = np.vander(t_s - t_s.mean(), 3)
    motion = np.linalg.lstsq(rows, place, rcond=None)[0]
    return bool(gravity[0] < -4.0 * motion[0, 1] and -motion[0, 1] < gravity[1]
                and np.median(np.abs(place - rows @ motion)) < 5.0 * ROUGH)


def _along(flight: Flight, window: list[list[Blob]], used: set[Blob]) -> tuple[Blob, ...]:
    """The free blobs nearest to a fitted curve: where two balls meet, a chain may have gone on with the other."""
    first, last = flight.blobs[0], flight.blobs[-1]
    near = [blobs for blobs in window if first.frame <= blobs[0].frame <= last.frame + GAP_FRAMES]
    curve = fly(flight.fit.values[:, None], np.array([blobs[0].time_s for blobs in near]))[:, :, 0] * flight.unit_px
    found = []
    for blobs, (x_px, z_px, vx_px_s, vz_px_s) in zip(near, curve, strict=True):
        late_s = [flight.fit.values[READOUT] * blob.row for blob in blobs]
        off = [float(np.hypot(blob.x_px - x_px - late * vx_px_s, -blob.y_px - z_px - late * vz_px_s))
               for blob, late in zip(blobs, late_s, strict=True)]
        best = int(np.argmin(off))
        if off[best] < GATE * flight.unit_px and blobs[best] not in used:
            found.append(blobs[best])
    return tuple(found)


def settle(chain: tuple[Blob, ...], priors: Priors = ANY_BALL) -> Flight | None:
    """Fit a flight to linked blobs, without the outliers at its ends and between; None if too few are left.

    Args:
        chain: Blobs by time.
        priors: Of its motion, in diameters.
    """
    for _ in range(4):
        if len(chain) < FEWEST:
            return None
        t_s = np.array([one.time_s for one in chain])
        # the slower the ball, the sharper it is, and the better its diameter
        speed = np.hypot(*np.gradient(_places(chain, 1.0), t_s, axis=0).T)
        unit = float(np.median([chain[k].diameter_px for k in np.argsort(speed)[:max(3, len(chain) // 3)]]))
        place, sigma = _places(chain, unit), np.array([sigma_px(one) for one in chain]) / unit
        fit = fit_flight(t_s, place, sigma, np.array([one.row for one in chain]), priors)
        kept = _joined([blob for blob, weight in zip(chain, fit.weight, strict=True) if weight > 0.05])
        if len(kept) == len(chain):
            return Flight(chain, unit, fit)
        chain = kept
    return None


def _joined(blobs: list[Blob]) -> tuple[Blob, ...]:
    """Blobs without what a hand, another ball or something before the ball left at the ends.

    Those are the first or last few, where they are fewer than the pictures between them and the rest; and balls that
    are partly hidden, as by the launcher or the target, whose middles are not where they seem.
    """
    for k in range(len(blobs) - 1, 0, -1):
        gap = blobs[k].frame - blobs[k - 1].frame
        if gap > GAP_FRAMES and min(k, len(blobs) - k) < gap:
            return _joined(blobs[:k] if k > len(blobs) - k else blobs[k:])
    whole = _diameter(blobs) if blobs else 0.0
    first, last = 0, len(blobs)
    while first < min(MOST_HIDDEN, last) and blobs[first].diameter_px < HIDDEN * whole:
        first += 1
    while last > max(len(blobs) - MOST_HIDDEN, first) and blobs[last - 1].diameter_px < HIDDEN * whole:
        last -= 1
    return tuple(blobs[first:last])


def _places(chain: tuple[Blob, ...], unit: float) -> Floats:
    return np.array([(blob.x_px, -blob.y_px) for blob in chain]) / unit


def sigma_px(blob: Blob) -> float:
    """Return the standard deviation of a blob's centre, but for a factor: a quarter of a pixel, or 2 % of a streak."""
    return float(np.hypot(0.25, 0.02 * blob.length_px))


def is_flight(flight: Flight, gravity: tuple[float, float]) -> bool:
    """Whether a fitted motion is a free fall, by its curve alone."""
    fit, span_s = flight.fit, flight.blobs[-1].time_s - flight.blobs[0].time_s
    fall = float(fit.values[G])
    rough = float(np.sqrt((fit.residual ** 2).sum(axis=1).mean()))
    if fall < SLOW and (len(flight.blobs) < MANY or rough > SMOOTH * ROUGH):
        return False                  # a hand is as slow, but not as even
    return (gravity[0] < fall < gravity[1] and fit.gravity_sd < CURVED_SD * fall
            and fall * span_s ** 2 / 8.0 > SAGITTA and rough < max(ROUGH, 1.0 / flight.unit_px)
            and len(flight.blobs) >= DENSE * (1 + flight.blobs[-1].frame - flight.blobs[0].frame))


def agreeing(flights: list[Flight], expected: float | None = None) -> list[Flight]:
    """Return the flights of a clip that fall alike: those whose gravity agrees with most others'.

    Args:
        flights: All of a clip.
        expected: Gravity in diameters/s2 if the ball's diameter is known; flights that have it come before others.
    """
    def within(centre: float) -> list[Flight]:
        near = [flight for flight in flights
                if abs(np.log(flight.gravity / centre)) < AGREE + 2.0 * flight.fit.gravity_sd / flight.gravity]
        usual = float(np.median([flight.unit_px for flight in near for _ in flight.blobs])) if near else 1.0
        return [flight for flight in near if 1.0 / SIZES < flight.unit_px / usual < SIZES]

    if expected is not None and (known := within(expected)):
        return known
    return max((within(flight.gravity) for flight in flights),
               key=lambda group: sum(len(flight.blobs) for flight in group), default=[])
