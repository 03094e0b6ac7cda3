"""Plausibility checks of wheel speeds and tracks: units, gears, isolated shots and impossible flights."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from msgspec import structs

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Floats, Shots, Tracks
from truearc.sim.data.table import WHEEL
from truearc.sim.physics.simulate import launch_state

LENGTHS = {"millimetres": ("mm", 1e-3), "centimetres": ("cm", 0.01), "inches": ("in", 0.0254), "feet": ("ft", 0.3048)}
RPM = math.pi / 30.0                  # definition
# Chosen: so that one slip does not decide a median
TRACKS = 3                            # fewest tracks, angles and heights that are judged
MOTORS = "the motors' speeds, before the gears, given as the wheels'"
GEARS = "gears upside down: launcher.wheel.gear is wheel speed / motor speed"
SPEEDS = "launcher.free_speed_rad_s, or the wheels' speeds, in revolutions per "
# Chosen: below any gear or unit that is named
DROOPS = 1.3                          # a wheel's speed by its motor's, or the inverse, under load and by slack belts
# logs of the speed of scoring shots by the least that carries a ball so far in vacuum
# Derived: the first is half of what feet for metres make of speeds, ln(3.28) / 2; chosen: the others, below it
APART, NEAR, LIKE = 0.3, 0.12, 0.25   # by which shots are far from the others, near, and like them,
# Chosen: a few slips are allowed
ALL_BUT, BETWEEN = 0.8, 0.15          # at least this share of those that are far, and at most that many in between
# Derived: nearly as of feet for metres; chosen: a tenth are few
LONE, FEW, LISTED = 0.5, 0.1, 5       # by which single shots are far, largest share of them, and how many are named
# Chosen: as ALIKE
UNIT = 0.2                            # of the log of the ratio, by which a wrong unit is likelier than a wrong part
# Chosen: as drags of balls differ
ALIKE = 1.2                           # causes that fit as well to within this are named together


class Flaw(NamedTuple):
    """One implausible thing: which check, the file and key, and a sentence with what to do."""

    check: str
    place: str
    what: str
    warns: bool = False               # it may well be true

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"


def speed_causes(rig: Rig, shots: Shots) -> dict[str, float]:
    """What may be wrong of the wheels, and by what share of the recorded one a ball then leaves."""
    causes = {f"{SPEEDS}minute": RPM, f"{SPEEDS}second": 2.0 * math.pi, "a wheel's diameter given as its radius": 0.5,
              "half of a wheel's radius or gear given as the whole": 2.0}
    if np.isfinite(shots.number("motor_ratio")).any() and not any(map(WHEEL.fullmatch, shots.numbers)):
        causes["half of launcher.free_speed_rad_s or of motor_ratio"] = 2.0
    geared = {(name := f"wheel_{wheel.name}_rad_s"): wheel.gear * shots.number(name) for wheel in rig.launcher.wheel}
    turned = structs.replace(rig.launcher, wheel=tuple(
        structs.replace(wheel, gear=1.0 / (wheel.gear or math.inf)) for wheel in rig.launcher.wheel))
    before, *others = (launch_state(*one).get("exit_speed_m_s", np.full(len(shots), np.nan)) for one in (
        (rig, shots), (rig, replace(shots, numbers={**shots.numbers, **geared})),
        (structs.replace(rig, launcher=turned), shots)))
    for cause, after in zip((MOTORS, GEARS), others, strict=True):
        moved = after[before > 0.0] / before[before > 0.0]
        if len(moved) and abs(np.median(moved) - 1.0) > 0.05:
            causes[cause] = float(np.median(moved))
    return causes


def likeliest(found: Mapping[str, float], within: tuple[float, float], typical: float, otherwise: str) -> str:
    """The causes by which a ratio would be most typical, of those by which it can be."""
    off = {cause: abs(math.log(ratio / typical)) - UNIT * (" in " in cause) for cause, ratio in found.items()
           if within[0] <= ratio <= within[1]}
    best = min(off.values(), default=0.0)
    return " or ".join(sorted((cause for cause in off if off[cause] < best + math.log(ALIKE) + 1e-9),
                              key=lambda cause: off[cause])[:3]) or otherwise


def judge_wheels(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Speeds of wheels that their motors' contradict, or that are one motor's although their gears differ."""
    ratio, free_rad_s = shots.number("motor_ratio"), rig.launcher.free_speed_rad_s or math.nan
    named = [(wheel, f"wheel_{wheel.name}_rad_s") for wheel in rig.launcher.wheel if wheel.gear]
    for wheel, name in named:
        shares = np.abs(shots.number(name) / np.where(ratio > 0.0, ratio * wheel.gear * free_rad_s, np.nan))
        share = float(np.median(known)) if len(known := shares[np.isfinite(shares)]) >= TRACKS else 1.0
        if share <= 0.0 or abs(math.log(share)) < math.log(DROOPS):
            continue
        stem = name.removesuffix("_rad_s")
        likely = likeliest({f"revolutions per minute; rename the column to {stem}_rpm": share * RPM,
                            f"revolutions per second; rename the column to {stem}_rev_s": share * 2.0 * math.pi,
                            f"the motor's speed; multiply it by the gear, {wheel.gear:g}": share * abs(wheel.gear)},
                           (1.0 / DROOPS, DROOPS), 1.0, "")
        if likely:
            yield Flaw("wheels", f"{shots.source}: {name}", f"is {share:.3g} times the speed by motor_ratio, free "
                       f"speed and gear; this looks like {likely}")
    columns = [shots.number(name) for _, name in named]
    gears = [abs(wheel.gear) for wheel, _ in named]
    if (len(columns) > 1 and np.isfinite(columns[0]).sum() >= TRACKS and max(gears) > DROOPS * min(gears)
            and all(np.allclose(columns[0], one, equal_nan=True) for one in columns[1:])):
        yield Flaw("wheels", f"{shots.source}: {', '.join(name for _, name in named)}", "are equal although the "
                   "wheels' gears differ; make sure that they are not the motors', before the gears", warns=True)


def mixed_units(ratio: Floats, other: Callable[[Bool[np.ndarray, " n"], float], Floats]) -> str:
    """What to say where some shots' ratios are like the others' only with their distances in another unit."""
    gets_there = ratio > 0.0
    if gets_there.mean() < ALL_BUT / 2.0:
        return ""
    usual = float(np.quantile(ratio[gets_there], 0.75))
    off = np.abs(np.log(np.maximum(ratio, 1e-9) / usual))
    far = off > APART
    if (off[~far] > NEAR).mean() > BETWEEN:
        return ""                     # not two kinds of shots, but one that varies
    read = [(metres, name, suffix) for name, (suffix, metres) in LENGTHS.items()]
    read += [(1.0 / metres, f"metres among {name}", "m") for name, (_, metres) in LENGTHS.items()]
    for scale, name, suffix in read if far.sum() >= TRACKS else ():
        if (np.abs(np.log(np.maximum(other(far, scale), 1e-9) / usual)) < LIKE).mean() > ALL_BUT:
            return (f"{far.sum()} of {len(far)} scoring shots look as if their distances were {name}: "
                    f"convert these, for instance in a file of their own with a column distance_{suffix}")
    return ""


def lone_shots(ratio: Floats, names: Sequence[str]) -> str:
    """What to say of a few scoring shots whose ratio is far from that of all others, which are alike."""
    off = np.abs(np.log(np.maximum(ratio, 1e-9) / np.median(ratio))) if np.median(ratio) > 0.0 else np.zeros(len(ratio))
    far = off > LONE
    if not far.any() or far.mean() > FEW or np.quantile(off[~far], 0.9) > APART:
        return ""
    shown = ", ".join(f"{name} ({share:.2g} times)" for name, share in zip(
        [name for name, one in zip(names, far, strict=True) if one][:LISTED], (ratio / np.median(ratio))[far],
        strict=False))
    return (f"scoring shots whose speed is far from what the others needed for their distance and angle: {shown}"
            f"{', ...' if far.sum() > LISTED else ''}; make sure of these rows")


# Chosen: lift and drag of foam balls change gravity by up to a half; units by 2.5 at least
GRAVITY = (0.45, 1.7)                 # share of the rig's that drag and lift leave of it, at the least and at the most
# Chosen: half of a quarter turn
TILT_DEG = 45.0                       # of the measured gravity against -z: no camera is tilted as far
INTERVAL_S = (1e-4, 0.6)              # chosen: a camera of 10 kHz, two pictures a second
# Chosen: beyond slip to a third, and beyond one fast wheel of two
SPEED = (0.2, 1.6)                    # of a tracked ball, by that of the wheels' surfaces
SLIPS = 0.85                          # usual; source: 67 to 87 % of surface speed (team 971)
# Derived: below half of the least factor of two units, inches by centimetres, sqrt(2.54) = 1.6
GRAVITY_ALIKE = 1.15                          # gravity in the unit that a message names, over the rig's, or the inverse
# Derived: below half of the way from 4 to 3.28, sqrt(4 / 3.28) = 1.10
HALVED = 1.08                         # four times gravity, or the inverse: feet have 3.28 times
# Derived: below sqrt(2.54) = 1.6, for lift of 0.3 leaves 1 / 1.43
LIFTED = 1.45                         # the same of a length: backspin leaves less of gravity
# Chosen: centimetres of noise turn shorter ones
FAR_M = 0.5                           # tracks that go less far have no direction
# Chosen: over more, drag bends what is carried back
NEAR_M = 5.0                          # tracks that begin farther off do not tell where the ball left
# Chosen: as of drag on a foam ball over 2 m
BENT = 0.1                            # share of the way back by which drag may bend it
# Derived: the 15 degrees of the term track_tilt, tan(15 deg)
TILT = 0.27                           # sine of the tilt that a fit allows a camera: it moves what is high aside
BEHIND_M = 0.5                        # a ball may be seen before it leaves the launcher; chosen: a launcher's length
# Chosen: drag turns it by less than 45
TURNED_DEG = 60.0                     # of a track's fall against that of the others
ASIDE_DEG = 20.0                      # of where balls go against x; chosen: above the 15 degrees of the term track_roll
# Chosen: scatter turns steeper ones back
UPRIGHT_DEG = 85.0                    # hood angles from which a ball need not go forwards
# Chosen: hoods err by a degree or two, a third of that spread, which leaves a correlation above 0.9
ALIGNED, SPREAD_DEG = 0.5, 3.0        # correlation of the tracks' elevations with their shots', where both vary so much
# Derived: five times that
OFF_RELEASE_M = 0.2                   # a release height is misjudged by centimetres (term release_height: 0.04 usual)
SAMPLES = 8                           # fewest of a track that is judged; chosen: twice the numbers of a cubic
# Chosen: over twice the numbers that are fitted
SPINS = 8                             # fewest tracks with a spin, of which its sign is judged
# Derived: chance goes so far once in 10^9; if noise is understated by half, once in 400
SURE = 6.0                            # standard errors of what falls otherwise than the others
# Derived: half of what feet make, sqrt(3.28)
LONGER = 1.8                          # times as long a part of the distance, or as short, as other tracks
# Chosen: near twice, as a stated half makes it
DOUBLE = 1.7                          # times the distance that balls seldom travel
# Derived: the least of two units, inches by centimetres
GRAVITY_APART = 2.5                           # times the others' gravity, or a share of it, in tracks of another unit
# Chosen: more than a late sample; derived: chance reaches 8 once in 10^15
RISEN, NOISES = 0.1, 8.0              # share of its heights, and times its noise, by which a track rises again
# Chosen: a bounce turns a speed round at once
KICK = 4.0                            # times its usual change of the vertical speed in the same time
# Chosen: five samples of a film of a second
WINDOW = 1.0 / 12.0                   # share of a track on either side, in which these speeds are taken
DIFFERENCES = 20.0                    # variance of a third difference, by that of a sample; derived: 1 + 9 + 9 + 1
MEDIAN = 0.6745                       # of the size of a normal deviate; derived: normal quantile 0.75


class Motion(NamedTuple):
    """What tracks say by themselves: acceleration without drag [3] and its standard error, speed at the start."""

    acceleration_m_s2: Floats
    error_m_s2: float
    start_m_s: Floats                 # [tracks]
    from_m: Floats                    # [tracks, 3]: where each begins
    velocity_m_s: Floats              # [tracks, 3]: there
    shot: Floats                      # [tracks]: row in Shots
    pull_m_s2: Floats                 # [tracks, 3]: acceleration of each, drag included,
    unsure_m_s2: Floats               # [tracks]: and its standard error
    reach_m: Floats                   # [tracks]: horizontal distance travelled
    toward_m: Floats                  # [tracks, 2]: along x and y


def measure_motion(tracks: Tracks) -> Motion | None:
    """Fit each track by a polynomial, and gravity and drag to all accelerations; None where there are too few."""
    rows, starts, shots, toward, begins, unsure = [], [], [], [], [], []
    points = np.column_stack([tracks.x_m, tracks.y_m, tracks.z_m])
    sound = np.asarray(np.isfinite(points).all(axis=1))
    for shot, mine in tracks.by_shot():
        here = mine[sound[mine]]
        t_s, place = tracks.t_s[here], points[here]
        if len(t_s) < SAMPLES or np.ptp(t_s) <= 0.0:
            continue
        half_s, middle_s = np.ptp(t_s) / 2.0, (t_s[0] + t_s[-1]) / 2.0
        scaled, degree = (t_s - middle_s) / half_s, 4 if len(t_s) >= 2 * SAMPLES else 3
        fit = np.polynomial.polynomial.polyfit(scaled, place, degree)
        unsure.append(_bend_error(scaled, place - np.polynomial.polynomial.polyval(scaled, fit).T, degree) / half_s**2)
        slope = np.polynomial.polynomial.polyder(fit)
        bend = np.polynomial.polynomial.polyder(slope)
        at = np.array([-0.5, 0.0, 0.5])
        rows.append((np.polynomial.polynomial.polyval(at, slope) / half_s,
                     np.polynomial.polynomial.polyval(at, bend) / half_s**2))
        starts.append(np.linalg.norm(np.polynomial.polynomial.polyval(-0.9, slope)) / half_s)
        begins.append((np.polynomial.polynomial.polyval(-1.0, fit),
                       np.polynomial.polynomial.polyval(-1.0, slope) / half_s))
        shots.append(shot)
        toward.append(place[-1, :2] - place[0, :2])
    if len(rows) < TRACKS:
        return None
    solutions = np.array([_gravity_of([row]) for row in rows])
    # one track alone does not part drag from gravity
    pull = np.array([row[1].mean(axis=1) for row in rows])
    like = ~_apart(np.linalg.norm(pull, axis=1))
    whole = _gravity_of([row for row, one in zip(rows, like, strict=True) if one])
    # 1.25 = sqrt(pi / 2) of a median's error; 1.5 = 1 / 0.67 of a deviation by its median size
    error = float(np.linalg.norm(1.25 * np.median(np.abs(solutions - np.median(solutions, axis=0)), axis=0)))
    along, (places, velocities) = np.array(toward), np.array(begins).transpose(1, 0, 2)
    return Motion(whole, 1.5 * error / math.sqrt(len(rows)), np.array(starts), places, velocities, np.array(shots),
                  pull, np.array(unsure), np.linalg.norm(along, axis=1), along)


def _bend_error(scaled: Floats, rest_m: Float[np.ndarray, "n 3"], degree: int) -> float:
    """Standard error of a polynomial's second derivative at the middle, by what it leaves of the samples."""
    basis = np.polynomial.polynomial.polyvander(scaled, degree)
    noise_m = math.sqrt(float((rest_m**2).sum()) / (3.0 * max(len(scaled) - degree - 1, 1)))
    return 2.0 * noise_m * math.sqrt(float(np.linalg.pinv(basis.T @ basis)[2, 2]))


def _apart(alone_m_s2: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which tracks [n] have a gravity far from the others': by a unit, and beyond how much tracks differ anyway."""
    off = np.abs(np.log(alone_m_s2 / np.median(alone_m_s2)))
    return np.asarray((off > math.log(GRAVITY_APART)) & (off > NOISES * np.median(off)))


def _gravity_of(rows: list[tuple[Floats, Floats]]) -> Floats:
    """Least squares of acceleration = gravity - k speed velocity, over components and points; k at least zero."""
    velocity = np.concatenate([row[0].T for row in rows])
    bend = np.concatenate([row[1].T for row in rows])
    drag = -np.linalg.norm(velocity, axis=1)[:, None] * velocity
    centred, pulled = drag - drag.mean(axis=0), bend - bend.mean(axis=0)
    k = max(0.0, float((centred * pulled).sum() / max((centred**2).sum(), 1e-300)))
    return np.asarray(bend.mean(axis=0) - k * drag.mean(axis=0))


def judge_tracks(dataset: Dataset, tracks: Tracks) -> Iterator[Flaw]:
    """Yield what is implausible of the tracks; nothing where there are too few."""
    unmeasured = list(_unmeasured(dataset, tracks))
    yield from unmeasured
    if not all(flaw.warns for flaw in unmeasured):
        return
    steps = np.diff(tracks.t_s)[np.diff(tracks.shot) == 0]
    step_s = float(np.median(steps)) if len(steps) else 0.01
    motion = measure_motion(tracks)
    objections = list(judge_bounces(dataset, tracks))      # with which all else means nothing
    if motion is not None and not objections:
        objections = [*_gravity(dataset, motion), *_mixed(dataset, motion)]
    yield from objections
    if objections:
        return
    if motion is not None:
        directions = list(_direction(motion))
        yield from directions or _release(dataset.rig, motion)
        yield from _against_launcher(dataset, motion)
        yield from _spin_sign(dataset, motion)
    if not INTERVAL_S[0] <= step_s <= INTERVAL_S[1]:
        yield Flaw("sample-interval", "tracks: t_s", f"samples are {step_s:g} s apart; this looks like "
                    + ("milliseconds: rename the column to t_ms" if step_s > INTERVAL_S[1] else "another unit of time"))


def _spin_sign(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    """Backspin lifts; where what is stated as backspin presses balls down, it may be topspin."""
    rows = motion.shot.astype(int)
    spin, speed = dataset.shots.number("exit_spin_rev_s")[rows], np.linalg.norm(motion.velocity_m_s, axis=1)
    known = np.isfinite(spin)
    if known.sum() < SPINS or np.ptp(spin[known]) <= 0.0:
        return
    ahead = np.linalg.norm(motion.velocity_m_s[:, :2], axis=1)
    made = np.column_stack([np.ones(len(spin)), speed * motion.velocity_m_s[:, 2], spin * ahead])[known]
    pull = motion.pull_m_s2[known, 2]
    by, _, rank, _ = np.linalg.lstsq(made, pull, rcond=None)
    if rank < made.shape[1]:
        return
    rest = pull - made @ by
    noise = float(rest @ rest) / (known.sum() - made.shape[1])
    if by[2] < -SURE * math.sqrt(noise * float(np.linalg.inv(made.T @ made)[2, 2])):
        yield Flaw("spin", f"{dataset.shots.source}: exit_spin_rev_s", "the more of it, the faster balls fall; "
                   "backspin, which lifts, is positive: if this is topspin, multiply it by -1", warns=True)


def _mixed(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    """Some tracks in another unit than the others, or with other axes."""
    alone = np.linalg.norm(motion.pull_m_s2, axis=1)
    far = motion.reach_m / dataset.shots.number("distance_m")[motion.shot.astype(int)]
    sure = alone > SURE * motion.unsure_m_s2
    turned = sure & (motion.pull_m_s2 @ np.median(motion.pull_m_s2, axis=0) < math.cos(math.radians(TURNED_DEG)) * (
        alone * np.linalg.norm(np.median(motion.pull_m_s2, axis=0))))
    if turned.any() and 2 * turned.sum() < len(turned):
        yield Flaw("axes", "tracks: x_m, y_m, z_m", f"{turned.sum()} of {len(turned)} tracks fall in another direction "
                   f"than the others: correct the axes of {_ids(dataset, motion.shot[turned].tolist())}")
        return
    # in another unit a track's length is another share of the distance, too; a fast ball's is not
    usual_far = float(np.nanmedian(far)) if np.isfinite(far).any() else math.nan
    apart = _apart(alone) & sure & ~(np.abs(np.log(far / usual_far)) < math.log(LONGER))
    if not apart.any() or 2 * apart.sum() >= len(apart):
        return
    usual, other = float(np.median(alone)), float(np.median(alone[apart]))
    name = min(LENGTHS, key=lambda one: abs(math.log(other * LENGTHS[one][1] / usual)))
    near = abs(math.log(other * LENGTHS[name][1] / usual)) < math.log(GRAVITY_ALIKE)
    likely = f"these look like {name}; " if near else ""
    yield Flaw("gravity", "tracks: x_m, y_m, z_m, t_s", f"{apart.sum()} of {len(apart)} tracks have another unit than "
               f"the others: gravity and drag would be {other:,.3g} m/s2 in them, {usual:,.3g} in the others; {likely}"
               f"convert {_ids(dataset, motion.shot[apart].tolist())}")


def _ids(dataset: Dataset, rows: Sequence[int]) -> str:
    """The first of these shots."""
    return ", ".join([*(dataset.shots.shot_id[row] for row in rows[:3]), *["..."][:len(rows) > 3]])


def _unmeasured(dataset: Dataset, tracks: Tracks) -> Iterator[Flaw]:
    """A coordinate that never varies was not measured; a ball goes forwards unless it is thrown upright, and falls."""
    upright = not (dataset.shots.number("hood_deg") < UPRIGHT_DEG).any()
    for name, values, why in (("x_m", tracks.x_m, "" if upright else "the distance from the exit to the target's side"),
                              ("y_m", tracks.y_m, ""), ("z_m", tracks.z_m, "the height above the floor")):
        known = values[np.isfinite(values)]
        if len(known) > 1 and np.ptp(known) == 0.0 and (name != "x_m" or why):
            yield Flaw("axes", f"tracks: {name}", f"is {known[0]:g} in every sample" + (
                f"; it is {why}" if why else ", so it is taken as not measured: nothing can be found that way"),
                       warns=not why)


def _gravity(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    """Gravity as if it were unknown: its size says the units, its direction the axes."""
    size, rig = float(np.linalg.norm(motion.acceleration_m_s2)), dataset.rig
    low, high = (share * rig.world.gravity_m_s2 for share in GRAVITY)
    spread = 3.0 * motion.error_m_s2
    said = f"fitted as if unknown, gravity is {size:,.3g} +- {motion.error_m_s2:,.2g} m/s2"
    if size - spread > high:
        name, (suffix, metres) = min(LENGTHS.items(),
                                     key=lambda one: abs(math.log(size * one[1][1] / rig.world.gravity_m_s2)))
        if abs(math.log(size / 4.0 / rig.world.gravity_m_s2)) < math.log(HALVED):
            yield Flaw("gravity", "tracks: t_s", f"times look like half of what they were, by a camera's rate that was "
                       f"treated as twice as high: {said}; double them, or where these are feet rename the columns")
        elif abs(math.log(size * metres / rig.world.gravity_m_s2)) > math.log(LIFTED):
            yield Flaw("gravity", "tracks: x_m, y_m, z_m, t_s", f"positions or times have another unit: {said}; state "
                       "them in metres and seconds")
        else:
            axes = "z" if _is_upright(dataset, motion, metres) else "xyz"
            yield Flaw("gravity", f"tracks: {', '.join(f'{axis}_m' for axis in axes)}", f"these look like {name}: "
                       f"{said}; rename " + ", ".join(f"{axis}_m to {axis}_{suffix}" for axis in axes))
    elif size + spread < low:
        yield Flaw("gravity", "tracks: t_s", _slow(math.sqrt(rig.world.gravity_m_s2 / size), said))
    if size > spread:
        across = int(np.argmax(np.abs(motion.acceleration_m_s2)))
        tilt_deg = math.degrees(math.acos(np.clip(-motion.acceleration_m_s2[2] / size, -1.0, 1.0)))
        if tilt_deg > TILT_DEG and spread < 0.5 * size:
            cause = ("z points down: change its sign" if across == 2 else
                     f"gravity acts along {'xyz'[across]}: z_m must point up; exchange z_m and {'xyz'[across]}_m")
            yield Flaw("axes", "tracks: x_m, y_m, z_m", cause)


def _is_upright(dataset: Dataset, motion: Motion, metres: float) -> bool:
    """Whether z alone is in a unit of `metres`: tracks then rise more steeply than the ball left, or where its
    angle is not known, go no farther than the target."""
    shots, rows = dataset.shots, motion.shot.astype(int)
    slope = motion.velocity_m_s[:, 2] / np.linalg.norm(motion.velocity_m_s[:, :2], axis=1)
    seen_deg, far = shots.number("exit_deg"), motion.reach_m / shots.number("distance_m")[rows]
    stated = np.tan(np.radians(np.where(np.isfinite(seen_deg), seen_deg, shots.number("hood_deg"))[rows]))
    if np.isfinite(stated).sum() >= TRACKS:
        return bool(abs(np.nanmedian(np.log(np.abs(slope / stated))) + math.log(metres)) < -0.5 * math.log(metres))
    # chosen: a film shows a part of the way, or a little more than it
    return bool(np.isfinite(far).sum() >= TRACKS and 0.2 < np.nanmedian(far) < 1.2)


def _slow(per_s: float, said: str) -> str:
    """What times look like of which a second has `per_s`."""
    for name, column, times in (("milliseconds", "t_ms", 1e3), ("microseconds", "t_us", 1e6)):
        if abs(math.log(per_s / times)) < math.log(GRAVITY_ALIKE):
            return f"these look like {name}: {said}; rename the column to {column}"
    if 20.0 <= per_s < 1e3:             # rates of cameras
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
    elif abs(turn_deg := math.degrees(math.atan2(aside, abs(along)))) > ASIDE_DEG:
        yield Flaw("axes", "tracks: x_m, y_m", f"balls travel {abs(turn_deg):.0f} degrees to the "
                   f"{'left' if aside > 0.0 else 'right'} of x; x_m must point to the target: turn the axes")
    elif (back := (far[:, 0] < 0.0).mean()) > 0.9:
        yield Flaw("axes", "tracks: x_m", "balls travel backwards; x_m must point to the target: change its sign, and "
                   "that of y_m")
    elif back > 0.0:
        yield Flaw("axes", "tracks: x_m", f"{back:.0%} of the balls travel backwards, the others forwards; x_m must "
                   "point to the target: change its sign in those, and that of y_m; where balls were thrown in many "
                   "directions of one room, leave them and accept this")


def _release(rig: Rig, motion: Motion) -> Iterator[Flaw]:
    """Tracks, carried back to x = 0 in vacuum, begin at the stated height and at y = 0; none begins behind that."""
    stated_m, begin_m = rig.launcher.release_height_m, motion.from_m[:, 0]
    near = (begin_m < NEAR_M) & (motion.velocity_m_s[:, 0] > 0.0)
    if near.sum() < TRACKS:
        return
    first_m, velocity_m_s = motion.from_m[near], motion.velocity_m_s[near]
    begins_m, tilted_m = float(np.median(first_m[:, 0])), TILT * abs(float(np.median(first_m[:, 2])))
    if begins_m < -BEHIND_M - tilted_m:
        yield Flaw("release", "tracks: x_m", f"balls are first seen {-begins_m:.2f} m behind the exit; x_m is measured "
                   "from the exit: subtract where the exit is")
        return
    back_s = first_m[:, 0] / velocity_m_s[:, 0]
    allowed_m = OFF_RELEASE_M + BENT * abs(begins_m)
    aside_m = float(np.median(first_m[:, 1] - velocity_m_s[:, 1] * back_s))
    if abs(aside_m) > allowed_m + tilted_m:
        yield Flaw("release", "tracks: y_m", f"balls leave at y = {aside_m:.2f} m; y_m is measured from the exit: "
                   "subtract where the exit is")
    found_m = float(np.median(first_m[:, 2] - velocity_m_s[:, 2] * back_s - 0.5 * rig.world.gravity_m_s2 * back_s**2))
    if (stated_m > 0.0 or rig.target is not None) and abs(found_m - stated_m) > allowed_m:
        cause = ("state that height there" if stated_m == 0.0 else
                 "z_m is measured from the exit; add that height" if abs(found_m) < 0.3 * stated_m else
                 "z_m is the height above the floor, x_m the distance from the exit; correct these or that height")
        yield Flaw("release", "tracks: z_m", f"balls leave at {found_m:.2f} m by their tracks, at {stated_m:g} m by "
                   f"rig.toml (launcher.release_height_m): {cause}")


def _elevations(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    """Tracks rise as the hoods of their shots say."""
    rows, shots = motion.shot.astype(int), dataset.shots
    seen_deg, (along, aside, up) = shots.number("exit_deg"), motion.velocity_m_s.T
    stated_deg = np.where(np.isfinite(seen_deg), seen_deg, shots.number("hood_deg"))[rows]
    begin_s = np.clip(motion.from_m[:, 0] / np.where(along > 0.0, along, np.inf), 0.0, None)
    found_deg = np.degrees(np.arctan2(up + dataset.rig.world.gravity_m_s2 * begin_s, np.hypot(along, aside)))
    both = np.array([found_deg, stated_deg])[:, np.isfinite(stated_deg) & (motion.from_m[:, 0] < NEAR_M)]
    if both.shape[1] < SAMPLES or both.std(axis=1).min() < SPREAD_DEG:
        return
    if (alike := float(np.corrcoef(both)[0, 1])) < -ALIGNED:
        yield Flaw("hood", f"{shots.source}: hood_deg, exit_deg", "tracks are the flatter the steeper their shots are "
                   "said to be; the angle is the elevation above the horizontal: 90 less one from the vertical")
    elif alike < ALIGNED:
        yield Flaw("track-shots", "tracks: shot_id", f"the tracks do not rise as the hood angles of their shots say "
                   f"(correlation {alike:.2f}): make sure that each track has the shot_id of its shot")


def _against_launcher(dataset: Dataset, motion: Motion) -> Iterator[Flaw]:
    yield from _elevations(dataset, motion)
    rows = motion.shot.astype(int)
    far = motion.reach_m / dataset.shots.number("distance_m")[rows]
    if np.isfinite(far).sum() >= TRACKS and np.nanmedian(far) > 2.5:        # below 3.28, of feet
        yield Flaw("track-length", "tracks: x_m", f"balls travel {np.nanmedian(far):.2g} times distance_m; one of the "
                    "two has another unit")
    elif np.isfinite(far).sum() >= TRACKS and np.nanmedian(far) > DOUBLE:
        yield Flaw("track-length", "tracks: x_m", f"balls travel {np.nanmedian(far):.2g} times distance_m, which is "
                   "the distance from the exit to the target's side; make sure that it is not half of that", warns=True)
    speed_m_s = launch_state(dataset.rig, dataset.shots).get("exit_speed_m_s", np.full(len(dataset.shots), np.nan))
    known = speed_m_s[rows] > 0.0
    ratio = float(np.median(motion.start_m_s[known] / speed_m_s[rows][known])) if known.any() else 1.0
    if not SPEED[0] <= ratio <= SPEED[1]:
        likely = likeliest({cause: ratio / share for cause, share in speed_causes(dataset.rig, dataset.shots).items()},
                           SPEED, SLIPS, "another unit of a wheel's radius, gear or speed")
        yield Flaw("speed", f"{dataset.shots.source}: the wheels", f"tracked balls leave with {ratio:.2g} times the "
                   f"speed of the wheels' surfaces; this looks like {likely}")


def judge_bounces(dataset: Dataset, tracks: Tracks) -> Iterator[Flaw]:
    """Yield an objection where a ball turns upward again at once, which no force of the air does."""
    found = []
    for shot, mine in tracks.by_shot():
        here = mine[np.isfinite(tracks.z_m[mine])]
        at = _turn(tracks.t_s[here], tracks.z_m[here])
        if at is not None:
            found.append(f"{dataset.shots.shot_id[shot]} at t_s = {tracks.t_s[here[at]]:.4g}")
    if found:
        shown = ", ".join(found[:3]) + (" ..." if len(found) > 3 else "")
        yield Flaw("bounce", "tracks: z_m", f"{len(found)} tracks turn upward again, as a ball does that touches "
                   f"something ({shown}): cut each track before that")


def _turn(t_s: Float[np.ndarray, " n"], z_m: Float[np.ndarray, " n"]) -> int | None:
    """The sample from which a track rises at once after it has fallen; None where it does not. In any unit."""
    if len(z_m) < SAMPLES or (np.diff(t_s) <= 0.0).any():
        return None
    fallen = np.maximum.accumulate(z_m) - z_m
    risen = np.maximum.accumulate(z_m[::-1])[::-1] - z_m
    both, noise_m = np.minimum(fallen, risen), np.median(np.abs(np.diff(z_m, 3))) / MEDIAN / np.sqrt(DIFFERENCES)
    span = max(round(WINDOW * len(z_m)), 2)
    slope = (z_m[span:] - z_m[:-span]) / (t_s[span:] - t_s[:-span])
    change = slope[span:] - slope[:-span]                 # at the samples from `span` on
    at = int(both[span:-span].argmax())
    if both[at + span] < max(RISEN * np.ptp(z_m), NOISES * noise_m) or change[at] < KICK * np.median(np.abs(change)):
        return None
    return at + span
