"""Plausibility of a dataset before inference: wrong units, axes and angles, which a fit would turn into physics.

Each check has a name, and can be accepted by it. A check passes where the data cannot tell.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import DENSEST_KG_M3, MOST, Rig, too_large
from truearc.robot.config.schema import InputError
from truearc.sim.data.model import Dataset, Floats, Shots, Tracks
from truearc.sim.physics.simulate import by_wheels, launch_state

CHECKS = ("gravity", "axes", "sample-interval", "track-length", "speed", "hood", "mass", "radius", "reach", "air",
          "target", "noise", "wheels", "height")
GRAVITY = (0.45, 1.7)                 # share of the rig's that drag and lift leave of it, at the least and at the most
TILT_DEG = 45.0                       # of the measured gravity against -z: no camera is tilted as far
INTERVAL_S = (1e-4, 0.6)
SPEED = (0.2, 1.6)                    # of a tracked ball, by that of the wheels' surfaces
LIGHTEST_KG_M3 = 3.0                  # of a ball: lighter is a balloon
LIGHT_KG_M3 = 12.0                    # below this the radius may be the diameter
HEAVY_KG_M3 = 1500.0                  # above this the mass may be in ounces; a bowling ball has 1400, a golf ball 1150
REACH = (0.9, 4.0)                    # launch speed of scoring shots, by the least that carries a ball so far in vacuum
DOUBLED = 1.9                         # of it: a light ball, or the wheels' diameters for their radii
TYPICAL = 1.3                         # of foam balls
MEASURED = (0.85, 2.0)                # of it where the speed itself was measured: slip does not add to drag
STRAIGHTER = 0.65                     # spread of that ratio with the other angle, by its spread as recorded
UNEVEN = 0.05                        # and the least spread as recorded that is judged
SAMPLES, TRACKS, SCORES = 8, 3, 6     # fewest of a track, of tracks, of scoring shots, that are judged
LENGTHS = {"millimetres": ("mm", 1e-3), "centimetres": ("cm", 0.01), "inches": ("in", 0.0254), "feet": ("ft", 0.3048)}
ALIKE = 1.15                          # gravity in the unit that a message names, over the rig's, or the inverse
THIN_KG_M3 = 0.5                      # air at 8 km
FAR_M = 0.5                           # tracks that go less far have no direction
SPEEDS = (("miles per hour", "exit_speed_mph", 0.44704), ("feet per second", "exit_speed_ft_s", 0.3048),
          ("kilometres per hour", "exit_speed_km_h", 1.0 / 3.6))
RPM = math.pi / 30.0
MISSED = "miss_height_m"
OUNCE_KG = 0.0283495
OF_KEY = {"world.gravity_m_s2": "gravity", "launcher.wheel.clock_deg": "wheels",
          "launcher.free_speed_rad_s": "speed"}           # key of the rig -> its check
WEAKEST_M_S2 = 1.2                    # gravity below this may be a multiple of the Earth's; the Moon has 1.6
IMPOSSIBLE = 0.2                      # share of heights that cannot be, above which their unit is another


class Flaw(NamedTuple):
    """One implausible thing: which check, the file and key, and a sentence with what to do."""

    check: str
    place: str
    what: str
    warns: bool = False               # it may well be true

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"


def check_plausible(dataset: Dataset, accept: Collection[str] = ()) -> Dataset:
    """Return the dataset with the objections that were accepted, or only warn.

    Args:
        accept: Names of checks whose objections are accepted.

    Raises:
        InputError: names every other objection with its file, key, likeliest cause and check; or an unknown check.
    """
    accept = (accept,) if isinstance(accept, str) else accept
    for name in accept:
        if name not in CHECKS:
            raise InputError(f"accept: there is no check {name!r}; there are {', '.join(CHECKS)}")
    objections = list(_objections(dataset))
    refused = [objection for objection in objections if not objection.warns and objection.check not in accept]
    if refused:
        raise InputError("\n".join(f"{_placed(objection, dataset.shots.source)} (check {objection.check!r}; accept it "
                                   "by name if it is so)" for objection in refused))
    return replace(dataset, accepted=tuple(f"{objection.check}: {objection}" for objection in objections))


def _placed(objection: Flaw, shots: str) -> str:
    """With the folder of the shots' file before the names of files beside it."""
    folder = Path(shots).parent if Path(shots).suffix in (".csv", ".parquet") else None
    beside = folder is not None and objection.place.startswith(("rig.toml:", "tracks:"))
    return f"{folder}/{objection}" if beside else str(objection)


def _objections(dataset: Dataset) -> Iterator[Flaw]:
    ball = list(_ball(dataset.rig))
    yield from ball or _balls(dataset.rig, dataset.shots)
    launcher = list(_launcher(dataset.rig))
    yield from launcher
    hood = list(_hood(dataset.shots))
    yield from hood
    yield from () if hood else _heights(dataset.rig, dataset.shots)
    if not hood and not launcher:
        yield from _reach(dataset.rig, dataset.shots)
    if dataset.tracks is not None:
        yield from _tracks(dataset, dataset.tracks)


def _ball(rig: Rig) -> Iterator[Flaw]:
    ball = rig.ball
    said = f"a ball of {ball.mass_kg:g} kg and {ball.radius_m:g} m radius"
    density = ball.density_kg_m3
    if density > DENSEST_KG_M3:
        yield Flaw("mass", "rig.toml: ball.mass_kg", f"{said} is denser than any metal; this looks like grams: "
                    f"{ball.mass_kg / 1000.0:g} kg")
    elif density > HEAVY_KG_M3:
        yield Flaw("mass", "rig.toml: ball.mass_kg", f"{said} is as dense as stone or metal; make sure that it is not "
                   f"in ounces, which would be {ball.mass_kg * OUNCE_KG:.3g} kg", warns=True)
    elif density < LIGHTEST_KG_M3:
        name, (_, metres) = next((one for one in reversed(LENGTHS.items())
                                  if density / one[1][1]**3 > LIGHT_KG_M3), ("millimetres", ("mm", 1e-3)))
        yield Flaw("radius", "rig.toml: ball.radius_m", f"{said} weighs little more than the air in its place; this "
                    f"looks like {name}: {ball.radius_m * metres:g} m")
    elif density < LIGHT_KG_M3:
        yield Flaw("radius", "rig.toml: ball.radius_m", f"{ball.radius_m:g} m is much for a ball of {ball.mass_kg:g} "
                    "kg; make sure that it is not the diameter", warns=True)


def _balls(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """The ball of each shot, where shots state it."""
    mass_kg, radius_m = (np.where(np.isfinite(given := shots.number(name)), given, own) for name, own in (
        ("mass_kg", rig.ball.mass_kg), ("radius_m", rig.ball.radius_m)))
    density = mass_kg / (4.0 / 3.0 * math.pi * radius_m**3)
    for check, wrong, what, slip in (("mass", density > DENSEST_KG_M3, "denser than any metal", "mass_kg to mass_g"),
                                     ("radius", density < LIGHTEST_KG_M3, "hardly heavier than the air in its place",
                                      "radius_m to radius_cm or radius_in")):
        if wrong.any():
            row = int(np.argmax(wrong))
            yield Flaw(check, f"{shots.source}: mass_kg, radius_m", f"the ball of shot {shots.shot_id[row]} "
                       f"({mass_kg[row]:g} kg, {radius_m[row]:g} m radius) is {what}; if this is another unit, rename "
                       f"the column {slip}")


def _launcher(rig: Rig) -> Iterator[Flaw]:
    release_m = rig.launcher.release_height_m
    if rig.target is not None and release_m > MOST["launcher.release_height_m"]:
        yield Flaw("reach", "rig.toml: launcher.release_height_m", f"{release_m:g} m is high for a launcher; this "
                   f"looks like {_smaller(release_m, 2.0)}")
    for key, what in too_large(rig):
        check = OF_KEY.get(key, key.partition(".")[0])
        if check in CHECKS:
            yield Flaw(check, f"rig.toml: {key}", what)
    if 0.0 < rig.world.gravity_m_s2 < WEAKEST_M_S2:
        yield Flaw("gravity", "rig.toml: world.gravity_m_s2", f"{rig.world.gravity_m_s2:g} is less than the Moon's; "
                   "on Earth it is 9.81")
    if 0.0 < rig.air.density_kg_m3 < THIN_KG_M3:
        yield Flaw("air", "rig.toml: air.density_kg_m3", f"{rig.air.density_kg_m3:g} is not air on Earth; at sea level "
                   "it is 1.2")
    for wheel in rig.launcher.wheel:
        if wheel.radius_m > MOST["launcher.wheel.radius_m"]:
            yield Flaw("radius", "rig.toml: launcher.wheel.radius_m", f"{wheel.radius_m:g} m is much for a wheel; this "
                       f"looks like {_smaller(wheel.radius_m, 0.25)}")


def _smaller(value: float, most_m: float) -> str:
    """The largest units in which a value is at most `most_m`."""
    likely = [f"{name} ({value * metres:g} m)" for name, (_, metres) in reversed(LENGTHS.items())
              if value * metres <= most_m and name != "feet"]
    return " or ".join(likely[:2]) or "another unit"


def _heights(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Heights at the target that cannot be: below the floor, far above the line of launch, or beside the outcome."""
    if rig.target is None:
        return
    centre_m, outcome, height_m = rig.target.centre_height_m, np.array(shots.text("outcome")), shots.number(MISSED)
    line_m = shots.number("distance_m") * np.tan(np.radians(shots.number("hood_deg")))
    above_m = max(rig.launcher.release_height_m - centre_m, 0.0) + 1.0
    least_m, most_m = np.full(len(shots), -centre_m - 0.5), np.nan_to_num(1.5 * line_m + above_m, nan=np.inf)
    for word, half_m in (("two", rig.target.two_half_height_m), ("three", rig.target.three_half_height_m)):
        wide_m = np.where(outcome == word, 1.5 * half_m + 0.1, np.inf)
        least_m, most_m = np.maximum(least_m, -wide_m), np.minimum(most_m, wide_m)

    def beyond(metres: float) -> int:
        return int(((height_m * metres < least_m) | (height_m * metres > most_m)).sum())

    wrong, known = beyond(1.0), int(np.isfinite(height_m).sum())
    if wrong < TRACKS or wrong < IMPOSSIBLE * known:
        return
    likely = [f"{name}, rename the column to miss_height_{suffix}" for name, (suffix, metres) in
              reversed(LENGTHS.items()) if beyond(metres) < 0.1 * wrong]
    yield Flaw("height", f"{shots.source}: {MISSED}", f"{wrong} of {known} are below the floor, above the line of "
               "launch, or contradict the outcome; " + (f"if these are {'; if '.join(likely)}" if likely else
                                                        "it is the height less that of the target's centre, in metres"))


def _hood(shots: Shots) -> Iterator[Flaw]:
    for name in ("hood_deg", "exit_deg"):
        angle_deg = shots.number(name)
        known = np.abs(angle_deg[np.isfinite(angle_deg)])
        if len(known) >= TRACKS and known.max() <= math.pi / 2 and np.median(known) > 0.05:
            yield Flaw("hood", f"{shots.source}: {name}", f"no shot exceeds {known.max():.2f} degrees; these look like "
                       f"radians: rename the column to {name.removesuffix('_deg')}_rad or multiply it by 57.3")


def needed_speed(distance_m: Floats, rise_m: float, hood_deg: Floats, gravity_m_s2: float) -> Floats:
    """Return the speed [m/s] that carries a ball through a point in vacuum; inf where that angle never does."""
    angle = np.radians(hood_deg)
    above_m = distance_m * np.tan(angle) - rise_m
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.sqrt(gravity_m_s2 * distance_m**2 / (2.0 * np.cos(angle)**2 * above_m))
    return np.where(above_m > 0.0, speed, np.inf)


def _reach(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Scoring shots got to the target: their launch speed must have been enough, and not many times as much."""
    scoring = np.isin(shots.text("outcome"), ("two", "three"))
    speed_m_s = launch_state(rig, shots).get("exit_speed_m_s", np.full(len(shots), np.nan))
    seen_deg = shots.number("exit_deg")
    columns = np.array([shots.number("distance_m"),
                        np.where(np.isfinite(seen_deg), seen_deg, shots.number("hood_deg")), speed_m_s])
    distance_m, hood_deg, speed_m_s = columns[:, scoring & np.isfinite(columns).all(axis=0)]
    if rig.target is None or len(distance_m) < SCORES:
        return
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m

    def ratios(distance: Floats, hood: Floats, speed: Floats) -> Floats:
        return np.asarray(speed / needed_speed(distance, rise_m, hood, rig.world.gravity_m_s2))

    ratio = ratios(distance_m, hood_deg, speed_m_s)
    middle = float(np.median(ratio))
    other = ratios(distance_m, 90.0 - hood_deg, speed_m_s)
    if _is_straighter(other, ratio):
        yield Flaw("hood", f"{shots.source}: hood_deg", "the speeds of scoring shots fit their distances far better "
                    "if the angle is from the vertical; hood_deg is the elevation above the horizontal: 90 less that")
        return
    for name, (suffix, metres) in LENGTHS.items():
        other = ratios(distance_m * metres, hood_deg, speed_m_s)
        if _is_straighter(other, ratio) and REACH[0] <= float(np.median(other)) <= REACH[1]:
            yield Flaw("reach", f"{shots.source}: distance_m", "the speeds of scoring shots fit their distances far "
                       f"better if these are {name}: rename the column to distance_{suffix}")
            return
    measured = np.isfinite(shots.number("exit_speed_m_s")[scoring]).all() and "exit_speed_m_s" in shots.numbers
    low, high = MEASURED if measured else REACH
    if low <= middle <= high:
        if middle > DOUBLED and by_wheels(shots).all():
            yield Flaw("reach", "rig.toml: launcher.wheel.radius_m", f"scoring shots leave with {middle:.2g} times the "
                       "speed that gets a ball so far without air; make sure that it is not the diameter", warns=True)
        return
    if measured:
        near = sorted(SPEEDS, key=lambda one: abs(math.log(max(middle, 1e-9) * one[2] / TYPICAL)))
        yield Flaw("reach", f"{shots.source}: exit_speed_m_s", f"scoring shots leave with {middle:.2g} times the speed "
                   "that gets a ball so far without air; if this is another unit, rename the column: "
                   + " or ".join(f"{column} for {name}" for name, column, _ in near[:2]))
        return
    causes = {f"distance_m in {name}": ratios(distance_m * metres, hood_deg, speed_m_s)
              for name, (_, metres) in LENGTHS.items()}
    causes["launcher.free_speed_rad_s, or the wheels' speeds, in revolutions per minute"] = ratios(
        distance_m, hood_deg, speed_m_s * RPM)
    causes["a wheel's diameter given as its radius"] = ratios(distance_m, hood_deg, speed_m_s / 2.0)
    medians = {cause: float(np.median(new)) for cause, new in causes.items()}
    fits = {cause: abs(math.log(new / TYPICAL)) for cause, new in medians.items() if REACH[0] <= new <= REACH[1]}
    likely = min(fits, key=lambda cause: fits[cause]) if fits else "wrong distances, wheels or hood angles"
    yield Flaw("reach", f"{shots.source}: distance_m, hood_deg and the wheels", "scoring shots leave with "
                f"{middle:.2g} times the speed that gets a ball so far without air; this looks like {likely}")


def _is_straighter(other: Floats, ratio: Floats) -> bool:
    """Whether the other reading explains the speeds much better; both are zero where no speed would do."""
    if len(ratio) < 2 * SCORES or (other <= 0.0).any():
        return False
    spread = np.inf if (ratio <= 0.0).any() else float(np.std(np.log(ratio)))
    return spread > UNEVEN and float(np.std(np.log(other))) < STRAIGHTER * spread


class Motion(NamedTuple):
    """What tracks say by themselves: acceleration without drag [3] and its standard error, speed at the start."""

    acceleration_m_s2: Floats
    error_m_s2: float
    start_m_s: Floats                 # [tracks]
    shot: Floats                      # [tracks]: row in Shots
    reach_m: Floats                   # [tracks]: horizontal distance travelled
    toward_m: Floats                  # [tracks, 2]: along x and y


def measure_motion(tracks: Tracks) -> Motion | None:
    """Fit each track by a polynomial, and gravity and drag to all accelerations; None where there are too few."""
    rows, starts, shots, toward = [], [], [], []
    points = np.column_stack([tracks.x_m, tracks.y_m, tracks.z_m])
    for shot in np.unique(tracks.shot):
        here = (tracks.shot == shot) & np.isfinite(points).all(axis=1)
        t_s, place = tracks.t_s[here], points[here]
        if len(t_s) < SAMPLES or np.ptp(t_s) <= 0.0:
            continue
        half_s, middle_s = np.ptp(t_s) / 2.0, (t_s[0] + t_s[-1]) / 2.0
        fit = np.polynomial.polynomial.polyfit((t_s - middle_s) / half_s, place, 4 if len(t_s) >= 2 * SAMPLES else 3)
        slope = np.polynomial.polynomial.polyder(fit)
        bend = np.polynomial.polynomial.polyder(slope)
        at = np.array([-0.5, 0.0, 0.5])
        rows.append((np.polynomial.polynomial.polyval(at, slope) / half_s,
                     np.polynomial.polynomial.polyval(at, bend) / half_s**2))
        starts.append(np.linalg.norm(np.polynomial.polynomial.polyval(-0.9, slope)) / half_s)
        shots.append(shot)
        toward.append(place[-1, :2] - place[0, :2])
    if len(rows) < TRACKS:
        return None
    solutions = np.array([_gravity_of([row]) for row in rows])
    whole = _gravity_of(rows)
    error = float(np.linalg.norm(1.25 * np.median(np.abs(solutions - np.median(solutions, axis=0)), axis=0)))
    along = np.array(toward)
    return Motion(whole, 1.5 * error / math.sqrt(len(rows)), np.array(starts), np.array(shots),
                  np.linalg.norm(along, axis=1), along)


def _gravity_of(rows: list[tuple[Floats, Floats]]) -> Floats:
    """Least squares of acceleration = gravity - k speed velocity, over components and points; k at least zero."""
    velocity = np.concatenate([row[0].T for row in rows])
    bend = np.concatenate([row[1].T for row in rows])
    drag = -np.linalg.norm(velocity, axis=1)[:, None] * velocity
    centred, pulled = drag - drag.mean(axis=0), bend - bend.mean(axis=0)
    k = max(0.0, float((centred * pulled).sum() / max((centred**2).sum(), 1e-300)))
    return np.asarray(bend.mean(axis=0) - k * drag.mean(axis=0))


def _tracks(dataset: Dataset, tracks: Tracks) -> Iterator[Flaw]:
    steps = np.diff(tracks.t_s)[np.diff(tracks.shot) == 0]
    step_s = float(np.median(steps)) if len(steps) else 0.01
    motion = measure_motion(tracks)
    if motion is not None:
        objections = list(_gravity(dataset.rig, motion, step_s))
        yield from objections
        if objections:
            return
        yield from _direction(motion)
        yield from _against_launcher(dataset, motion)
    if not INTERVAL_S[0] <= step_s <= INTERVAL_S[1]:
        yield Flaw("sample-interval", "tracks: t_s", f"samples are {step_s:g} s apart; this looks like "
                    + ("milliseconds: rename the column to t_ms" if step_s > INTERVAL_S[1] else "another unit of time"))


def _gravity(rig: Rig, motion: Motion, step_s: float) -> Iterator[Flaw]:
    """Gravity as if it were unknown: its size says the units, its direction the axes."""
    size = float(np.linalg.norm(motion.acceleration_m_s2))
    low, high = (share * rig.world.gravity_m_s2 for share in GRAVITY)
    spread = 3.0 * motion.error_m_s2
    said = f"fitted as if unknown, gravity is {size:,.3g} +- {motion.error_m_s2:,.2g} m/s2"
    if size - spread > high:
        name, (suffix, metres) = min(LENGTHS.items(),
                                     key=lambda one: abs(math.log(size * one[1][1] / rig.world.gravity_m_s2)))
        if abs(math.log(size * metres / rig.world.gravity_m_s2)) > math.log(ALIKE):
            yield Flaw("gravity", "tracks: x_m, y_m, z_m, t_s", f"positions or times have another unit: {said}; state "
                       "them in metres and seconds")
        else:
            yield Flaw("gravity", "tracks: x_m, y_m, z_m", f"these look like {name}: {said}; rename the columns to "
                       + ", ".join(f"{axis}_{suffix}" for axis in "xyz"))
    elif size + spread < low:
        yield Flaw("gravity", "tracks: t_s", _slow(math.sqrt(rig.world.gravity_m_s2 / size), said))
    if size > spread:
        across = int(np.argmax(np.abs(motion.acceleration_m_s2)))
        tilt_deg = math.degrees(math.acos(np.clip(-motion.acceleration_m_s2[2] / size, -1.0, 1.0)))
        if tilt_deg > TILT_DEG and spread < 0.5 * size:
            cause = ("z points down: change its sign" if across == 2 else
                     f"gravity acts along {'xyz'[across]}: z_m must point up; exchange z_m and {'xyz'[across]}_m")
            yield Flaw("axes", "tracks: x_m, y_m, z_m", cause)


def _slow(per_s: float, said: str) -> str:
    """What times look like of which a second has `per_s`."""
    for name, column, times in (("milliseconds", "t_ms", 1e3), ("microseconds", "t_us", 1e6)):
        if abs(math.log(per_s / times)) < math.log(ALIKE):
            return f"these look like {name}: {said}; rename the column to {column}"
    if 20.0 <= per_s < 1e3:
        return (f"these look like numbers of pictures, about {per_s:.0f} per second: {said}; divide them by the "
                "camera's rate")
    return f"positions or times have another unit: {said}; state them in metres and seconds"


def _direction(motion: Motion) -> Iterator[Flaw]:
    """x points to the target: balls travel along it."""
    far = motion.toward_m[motion.reach_m > FAR_M]
    if len(far) < TRACKS:
        return
    along, aside = np.median(far, axis=0)
    if abs(aside) > 2.0 * abs(along) and (np.abs(far[:, 1]) > np.abs(far[:, 0])).mean() > 0.9:
        yield Flaw("axes", "tracks: x_m, y_m", "balls travel along y; x_m must point to the target: exchange x_m and "
                   "y_m")
    elif (far[:, 0] < 0.0).mean() > 0.9:
        yield Flaw("axes", "tracks: x_m", "balls travel backwards; x_m must point to the target: change its sign, and "
                   "that of y_m")


def _against_launcher(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    rows = motion.shot.astype(int)
    far = motion.reach_m / dataset.shots.number("distance_m")[rows]
    if np.isfinite(far).sum() >= TRACKS and np.nanmedian(far) > 2.5:
        yield Flaw("track-length", "tracks: x_m", f"balls travel {np.nanmedian(far):.2g} times distance_m; one of the "
                    "two has another unit")
    speed_m_s = launch_state(dataset.rig, dataset.shots).get("exit_speed_m_s", np.full(len(dataset.shots), np.nan))
    ratio = float(np.nanmedian(motion.start_m_s / speed_m_s[rows])) if np.isfinite(speed_m_s[rows]).any() else 1.0
    if not SPEED[0] <= ratio <= SPEED[1]:
        cause = ("the wheels' speeds look like revolutions per minute" if SPEED[0] <= ratio / RPM <= SPEED[1] else
                 "wheel radius, gear or speed has another unit")
        yield Flaw("speed", f"{dataset.shots.source}: the wheels", f"tracked balls leave with {ratio:.2g} times the "
                    f"speed of the wheels' surfaces; {cause}")
