"""One clip from pictures to flights in metres: detection, linking, calibration and self-test, with what is doubtful.

Nothing is wrong in silence: a moving camera, a clip without flights, too few pictures a second, a file that was cut
short, a second launcher and a gravity that is not the earth's each get a sentence.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from truearc.sim.printed import Progress
from truearc.sim.video.background import Background, differences, is_same_view
from truearc.sim.video.ballistics import VX, VZ, Priors
from truearc.sim.video.calibrate import (
    FILE_CLOCK_SD,
    SHEET,
    STATED_CLOCK_SD,
    Calibration,
    Mark,
    Placed,
    Sheet,
    calibrate,
    exits_of,
    find_sheet,
    noise_factors,
    place_flights,
    sheet_beside,
)
from truearc.sim.video.detect import Blob, find_blobs
from truearc.sim.video.frames import Clip, Image
from truearc.sim.video.link import ANY_BALL, FEWEST, Flight, agreeing, link_flights, settle
from truearc.sim.video.selftest import EARTH_M_S2, SelfTest, measure_gravity, pool

EVERY_S = 0.5                         # how often the camera's movement is looked at
STILL_PX = 1.0                        # movement of a still camera: noise, and people who walk through
# Derived: of the time between two pictures, the read-out takes less than all; phones that film 60 a second take most
READOUT_SHARE = (0.7, 0.3)            # mean and standard deviation
AIR_KG_M3, DRAG_COEFFICIENT = 1.2, 0.5            # of a ball that is not very smooth and fast
FEW_HZ = 20.0                         # pictures a second below which a flight is seen in too few of them


@dataclass(frozen=True)
class View:
    """What is known of how a clip was filmed.

    diameter_m: Of the ball; None if unknown.
    mass_kg: Of the ball, from which its drag is known to a third; None if unknown.
    marks: Known places in the picture.
    tag_m: Side of an AprilTag in the plane of the flight; None if there is none.
    exit_px: The launcher's exit in the picture; None: where flights begin.
    release_height_m: Of the exit above the floor.
    """

    diameter_m: float | None = None
    marks: tuple[Mark, ...] = ()
    tag_m: float | None = None
    exit_px: tuple[float, float] | None = None
    release_height_m: float = 0.0
    mass_kg: float | None = None

    def priors(self, rate_hz: float) -> Priors:
        """Return what a single flight is expected to be, in diameters, at this many pictures a second."""
        mean_s, sd_s = ANY_BALL.readout
        if rate_hz > 0.0:             # a picture is read before the next begins
            mean_s, sd_s = min(mean_s, READOUT_SHARE[0] / rate_hz), min(sd_s, READOUT_SHARE[1] / rate_hz)
        if self.mass_kg is None or self.diameter_m is None:
            return ANY_BALL._replace(readout=(mean_s, sd_s))
        drag = AIR_KG_M3 * DRAG_COEFFICIENT * np.pi * self.diameter_m ** 3 / 8.0 / self.mass_kg
        return ANY_BALL._replace(drag=(drag, drag / 3.0), readout=(mean_s, sd_s))


@dataclass(frozen=True)
class TrackedClip:
    """What a clip showed.

    clip: The clip.
    end_s: Time of its last picture.
    flights: Balls in the air that left the launcher, by time.
    placed: The same in metres; empty without a scale.
    calibration, self_test: Of the clip; None without flights.
    warnings: Sentences about what is doubtful.
    left_out: Sentences about flights that are not used.
    """

    clip: Clip
    end_s: float
    flights: tuple[Flight, ...] = ()
    placed: tuple[Placed, ...] = ()
    calibration: Calibration | None = None
    self_test: SelfTest | None = None
    warnings: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def begin_s(self) -> np.ndarray:
        """When each flight begins, in the clip."""
        return np.array([flight.blobs[0].time_s for flight in self.flights])

    @property
    def saw_sheet(self) -> bool:
        """Whether truearc's sheet was beside the flights."""
        return self.calibration is not None and any(one.name == SHEET for one in self.calibration.sources)

    def still(self) -> Image | None:
        """Return the clip's first picture; None if it cannot be read again."""
        first = next(self.clip.frames(), None)
        return None if first is None else first.luma

    def line(self, number: int) -> str:
        """Return what is to be said of a flight."""
        flight = self.flights[number]
        first, last = flight.blobs[0], flight.blobs[-1]
        said = (f"{self.clip.name} flight {number + 1}: {first.time_s:.2f} to {last.time_s:.2f} s, {len(flight.blobs)} "
                f"positions, residual {flight.unit_px * rms(flight):.2f} px")
        if self.calibration is None or self.calibration.metres_per_px is None:
            return said
        launch = self.launch(number)
        return (f"{said}, {launch.speed_m_s:.2f} +- {launch.speed_sd_m_s:.2f} m/s at {launch.elevation_deg:.1f} +- "
                f"{launch.elevation_sd_deg:.1f} degrees when first seen")

    def launch(self, number: int) -> "Launch":
        """Return speed and elevation of a flight when it is first seen; the clip has a scale."""
        flight, calibration = self.flights[number], self.calibration
        assert calibration is not None and calibration.metres_per_px is not None
        unit_m, share = flight.unit_px * self.placed[number].metres_per_px, calibration.scale_sd
        velocity = unit_m * flight.fit.values[[VX, VZ]]
        covariance = unit_m ** 2 * flight.fit.covariance[np.ix_([VX, VZ], [VX, VZ])]
        speed = float(np.hypot(*velocity))
        along = velocity / max(speed, 1e-9)
        across = np.array([-along[1], along[0]])
        noise, turn = (float(np.sqrt(way @ covariance @ way)) for way in (along, across))
        way = -1.0 if velocity[0] < 0.0 else 1.0
        angle = np.degrees(np.arctan2(velocity[1], abs(velocity[0])) + way * calibration.tilt_rad)
        return Launch(speed, float(np.hypot(noise, speed * share)), float(angle),
                      float(np.hypot(np.degrees(turn / max(speed, 1e-9)), calibration.tilt_sd_deg)))


class Launch(NamedTuple):
    """A ball when it is first seen.

    Fields:
        speed_m_s, elevation_deg: Of its motion in the plane of the view.
        speed_sd_m_s, elevation_sd_deg: Standard deviations, scale and level included.
    """

    speed_m_s: float
    speed_sd_m_s: float
    elevation_deg: float
    elevation_sd_deg: float


def rms(flight: Flight) -> float:
    """Return the root mean square of a flight's residuals, in diameters."""
    return float(np.sqrt((flight.fit.residual ** 2).sum(axis=1).mean()))


@dataclass
class Watched:
    """What the pictures of a clip showed, in pixels.

    end_s: Time of the last picture.
    pictures, blobs: Their numbers.
    shifts_px: How far the camera moved, each half second.
    upright: Whether the picture is higher than wide.
    sheets: truearc's sheet as it was seen.
    background: What stood still at last.
    flights: What fell freely.
    """

    clip: Clip
    end_s: float = 0.0
    pictures: int = 0
    blobs: int = 0
    shifts_px: list[float] = field(default_factory=list)
    upright: bool = False
    sheets: list[Sheet] = field(default_factory=list)
    background: Image = field(default_factory=lambda: np.empty((0, 0), np.uint8))
    flights: list[Flight] = field(default_factory=list)

    def is_filmed_like(self, other: "Watched") -> bool:
        """Return whether the camera stood at the same place, by what stands still in view."""
        return (self.clip.slow_motion == other.clip.slow_motion and self.background.shape == other.background.shape
                and is_same_view(self.background, other.background))


def track_clip(clip: Clip, view: View, progress: Progress = lambda done, note: None) -> TrackedClip:
    """Find and measure the flights of a single clip, as `watch` and `measure` do."""
    return measure([watch(clip, progress)], view)[0]


def watch(clip: Clip, progress: Progress = lambda done, note: None) -> Watched:
    """Find the flights of a clip.

    Raises:
        InputError: The clip cannot be read.
    """
    scene, seen = Background(), Watched(clip)
    seen.flights = list(link_flights(_blobs(clip, scene, seen, progress)))
    seen.background = scene.luma
    return seen


def measure(clips: Sequence[Watched], view: View) -> list[TrackedClip]:
    """Measure the flights of clips.

    Clips of a camera that did not move have one scale, level and rolling shutter, measured by all of them together:
    measured apart, they would differ by the errors of each, which are steps in time.

    Raises:
        InputError: A tag is not in view, or marks are at one place.
    """
    groups: list[list[int]] = []
    for number, one in enumerate(clips):
        for group in groups:
            if one.is_filmed_like(clips[group[0]]):
                group.append(number)
                break
        else:
            groups.append([number])
    found: dict[int, TrackedClip] = {}
    for group in groups:
        found.update(zip(group, _measure([clips[number] for number in group], view), strict=True))
    filmed = [group for group in groups if any(found[number].flights for number in group)]
    for group in filmed[1:]:
        tracked = found[group[0]]
        found[group[0]] = replace(tracked, warnings=(*tracked.warnings, (
            f"{tracked.clip.name}: the camera stood elsewhere than in {found[filmed[0][0]].clip.name}; discovery fits "
            "one scale and level for all tracks of a dataset, so track the clips of each place apart")))
    return [found[number] for number in range(len(clips))]


def _measure(clips: Sequence[Watched], view: View) -> list[TrackedClip]:
    """Those of one place of the camera."""
    expected = None if view.diameter_m is None else EARTH_M_S2 / view.diameter_m
    alike = {id(flight) for flight in agreeing([flight for one in clips for flight in one.flights], expected)}
    left_out = [[f"{one.clip.name}: {_span(flight)}: it falls with another acceleration than the other balls"
                 for flight in one.flights if id(flight) not in alike] for one in clips]
    every = [(number, flight, sheet_beside(flight, one.sheets)) for number, one in enumerate(clips)
             for flight in sorted(one.flights, key=lambda flight: flight.blobs[0].time_s) if id(flight) in alike]
    calibration = calibrate([flight for _, flight, _ in every], clips[0].background, diameter_m=view.diameter_m,
                            marks=view.marks, tag_m=view.tag_m, sheets=[sheet for *_, sheet in every if sheet],
                            clock_sd=STATED_CLOCK_SD if clips[0].clip.path.is_dir() else FILE_CLOCK_SD)
    warnings = [[*_doubts(one), *(() if number in {k for k, *_ in every} else (_no_flight(one),))]
                for number, one in enumerate(clips)]
    if not every:
        return [TrackedClip(one.clip, one.end_s, warnings=tuple(said), left_out=tuple(left))
                for one, said, left in zip(clips, warnings, left_out, strict=True)]
    clip = clips[0].clip
    priors = view.priors(clip.rate_hz if clip.path.is_dir() else clip.rate_hz * clip.slow_motion)
    flights, shared = pool([settle(flight.blobs, priors) or flight for _, flight, _ in every], priors)
    of_clip = [number for number, *_ in every]
    beside = [sheet for *_, sheet in every]
    own = list(range(len(flights)))
    if calibration.metres_per_px is not None:
        own, *others = exits_of(flights, calibration.metres_per_px, view.exit_px, beside)
        names = [clips[number].clip.name for number in of_clip]
        for row in (row for group in others for row in group):
            left_out[of_clip[row]].append(f"{names[row]}: {_span(flights[row])}: it begins elsewhere")
        if others:
            first = flights[own[0]].blobs[0]
            warnings[of_clip[own[0]]].append(
                f"{names[own[0]]}: flights begin at {1 + len(others)} places; used are the "
                f"{len(own)} from pixel {first.x_px:.0f},{first.y_px:.0f}; another launcher, or throws by hand? "
                "--exit X,Y chooses the place")
    own = sorted(own)
    placed = [] if calibration.metres_per_px is None else place_flights(
        [flights[row] for row in own], calibration, shared.readout[0], noise_factors([flights[row] for row in own]),
        view.release_height_m, view.exit_px, [beside[row] for row in own])
    warnings[0] += [f"{clip.name}: {line}" for line in calibration.warnings]
    found = []
    for number, one in enumerate(clips):
        mine = [row for row in own if of_clip[row] == number]
        falls = [flight for flight, k in zip(flights, of_clip, strict=True) if k == number]
        found.append(TrackedClip(
            one.clip, one.end_s, tuple(flights[row] for row in mine),
            tuple(place for place, row in zip(placed, own, strict=False) if of_clip[row] == number),
            calibration if falls else None,
            measure_gravity(falls, shared, calibration, view.diameter_m) if falls else None,
            tuple(warnings[number]), tuple(left_out[number])))
    return found


def _blobs(clip: Clip, scene: Background, seen: Watched, progress: Progress) -> Iterator[list[Blob]]:
    looked_s = -np.inf
    for number, (frame, difference, noise) in enumerate(differences(clip, scene)):
        blobs = find_blobs(difference, noise, number, frame.time_s, clip.quarter_turns)
        seen.end_s, seen.pictures, seen.blobs = frame.time_s, number + 1, seen.blobs + len(blobs)
        seen.upright = frame.luma.shape[0] > frame.luma.shape[1]
        if frame.time_s - looked_s >= EVERY_S:
            looked_s = frame.time_s
            seen.shifts_px.append(scene.shift_px(frame))
            if (sheet := find_sheet(scene.luma, frame.time_s)) is not None:
                seen.sheets.append(sheet)
            progress(min(frame.time_s / clip.duration_s, 0.99) if clip.duration_s else 0.0, f"{frame.time_s:.0f} s")
        yield blobs


def _doubts(seen: Watched) -> list[str]:
    found, clip = [], seen.clip
    if clip.is_cut_short(seen.end_s):
        found.append(f"{clip.name}: its pictures end after {seen.end_s:.1f} of {clip.duration_s:.1f} s: the file is "
                     "damaged or cut short; flights up to there are used")
    moved = float(np.median(seen.shifts_px)) if seen.shifts_px else 0.0
    if moved > STILL_PX:
        found.append(f"{clip.name}: the camera moves, by {moved:.0f} pixels and more; put it on a tripod")
    return found


def _no_flight(seen: Watched) -> str:
    rate = (seen.pictures - 1) / seen.end_s if seen.end_s else 0.0
    why = "nothing of a ball's shape moves in it" if seen.blobs < FEWEST else (
        f"at {rate:.0f} pictures a second a ball in the air is seen too seldom; film with 60 or more"
        if rate < FEW_HZ else "what moves does not fall freely: it is carried, rolls, is hidden or leaves the picture")
    upright = "; the clip is upright: turn the phone, so that flights stay in view" if seen.upright else ""
    return f"{seen.clip.name}: no flight: {why}{upright}"


def _span(flight: Flight) -> str:
    return f"the ball at {flight.blobs[0].time_s:.2f} to {flight.blobs[-1].time_s:.2f} s is left out"
