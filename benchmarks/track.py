"""Benchmark of `truearc track` on clips of the emulated phone: accuracy, sigmas, gravity, matching, speed and memory.

    python -m benchmarks.track [--flights 20] [--clips 2] [--rates 60,120] [--rows 1080] [--clutter 1000]
                               [--kinds plain,blur,people,light,coding,lost,askew] [--matched 200] [--seed 5000]

Each clip has that many flights in air with drag and backspin, from robots at several places 2.6 to 7 m before the
target, filmed from 10 m; `askew` robots stand up to 5 % of the distance beside the plane of the others. Errors are
those against the positions that were drawn. Centres are in pixels at the time at which their row was exposed. Positions
are in metres from the exit; `noise` is what is left of them without the scale, level and origin of the clip, whose own
sigmas are the [tracker] of rig.toml. `within one sigma` is of that noise, for the columns sigma_x_m and sigma_z_m, and
for speed and elevation when first seen. Clutter has people, shadows and a flickering lamp, but no ball. Matching draws
recordings of 40 shots of which clips saw a part, with strays.
"""

import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.options import read_options
from truearc.hw.emulated.imaging.hall import RobotPose, Trouble
from truearc.hw.emulated.imaging.phone import Path3D, Phone, Seen, SideCamera
from truearc.sim.video.frames import open_clip
from truearc.sim.video.match import match_times
from truearc.sim.video.track import TrackedClip, View, track_clip

RADIUS_M, MASS_KG, EXIT_M, GOAL_M = 0.0889, 0.14, 0.75, 2.44
STEP_S, AROUND_S = 0.004, 1.0
KINDS = {"plain": {}, "blur": {"exposure_s": 0.010}, "people": {"trouble": Trouble(people=3)},
         "light": {"trouble": Trouble(shadows=2, flicker=0.03)}, "coding": {"codec": "libx265", "quality": 28},
         "lost": {"lost_share": 0.08, "tilt_deg": 2.0, "noise": 5.0}, "askew": {}}
CLUTTER = Trouble(people=3, shadows=2, flicker=0.03)
MATCH_SHOTS, MATCH_SEEN, MATCH_JITTER_S = 40, (4, 20), 0.02


class Marks(NamedTuple):
    """How a clip was tracked: numbers of flights, errors of centres and positions, ratios of errors to sigmas, gravity,
    errors of release and arrival (speed as a share, degrees, m), and processor time / length."""

    true: int
    found: int
    false: int
    centre_px: np.ndarray
    place_m: np.ndarray
    noise_m: np.ndarray
    over_sigma: np.ndarray
    gravity_m_s2: float
    release: np.ndarray
    arrival_m: np.ndarray
    cost: float


def throw(shot: int, begin_s: float, rng: np.random.Generator, pose: RobotPose) -> Path3D:
    """A ball with drag and lift, until it reaches the target's plane or the floor."""
    distance = -pose.key[0]
    speed = float(rng.uniform(0.97, 1.05)) * (5.6 + 0.55 * distance)
    angle, drag, lift = np.radians(rng.uniform(42.0, 56.0)), rng.uniform(0.045, 0.06), rng.uniform(0.2, 0.5)
    state, places = np.array([0.0, EXIT_M, speed * np.cos(angle), speed * np.sin(angle)]), []
    while state[0] < distance + 0.4 and state[1] > RADIUS_M:
        places.append(pose.to_field(float(state[0]), 0.0, float(state[1])))
        for _ in range(4):
            fast = np.hypot(*state[2:])
            pull = np.array([-drag * fast * state[2] - lift * state[3], -9.81 - drag * fast * state[3]
                             + lift * state[2]])
            state = state + STEP_S / 4 * np.concatenate([state[2:] + 0.5 * STEP_S / 4 * pull, pull])
    time_s = begin_s + STEP_S * np.arange(len(places))
    arrived = int(np.searchsorted(np.array(places)[:, 0], 0.0))
    return Path3D(shot, time_s, np.array(places), RADIUS_M, -3.0, pose, (begin_s, float(time_s[min(arrived,
                                                                                               len(places) - 1)])))


def film(path: Path, phone: Phone, flights: int, seed: int, askew: bool = False) -> list[Seen]:
    """Write a clip of so many flights, three from each place; return the truth. askew: not all in one plane."""
    rng = np.random.default_rng(seed)
    balls, poses, now_s = [], [], 1.0
    for shot in range(flights):
        if shot % 3 == 0:
            away = float(rng.uniform(2.6, 7.0))
            aside = askew * float(rng.uniform(-0.05, 0.05)) * away
            poses.append((now_s - 0.9, RobotPose(-away, aside, float(np.arctan2(-aside, away)))))
        balls.append(throw(shot, now_s, rng, poses[-1][1]))
        now_s = balls[-1].time_s[-1] + 2.0 + float(rng.uniform(0.1, 1.5))
    spans = [(ball.seen_s[0] - AROUND_S, ball.time_s[-1] + AROUND_S) for ball in balls]
    return SideCamera(phone, EXIT_M, GOAL_M, seed).film(path, balls, poses, spans)


def judge(one: TrackedClip, truth: list[Seen], cost: float) -> Marks:
    """Compare a tracked clip with its truth."""
    shots = {shot: np.array([row[1:] for row in truth if row.shot == shot]) for shot in {row.shot for row in truth}}
    taken, false, centres, places, sigmas, release, arrival = set[int](), 0, [], [], [], [], []
    for flight, placed in zip(one.flights, one.placed, strict=False):
        times = np.array([blob.time_s for blob in flight.blobs])
        shot, rows = min(shots.items(), key=lambda item: abs(item[1][:, 0].mean() - times.mean()))
        ok = (times >= rows[0, 0]) & (times <= rows[-1, 0])
        if shot in taken or ok.sum() < 5:
            false += 1
            continue
        taken.add(shot)
        at = np.column_stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (4, 5)])
        centres.append((np.array([(blob.x_px, blob.y_px) for blob in flight.blobs]) - at)[ok])
        true = np.column_stack([np.interp(placed.time_s, rows[:, 0], rows[:, k]) for k in (1, 3)])
        off = np.column_stack([placed.x_m, placed.z_m]) - true
        places.append(np.column_stack([true, off])[ok])
        sigmas.append(np.column_stack([placed.sigma_x_m, placed.sigma_z_m])[ok])
        arrival.append(off[ok][-1])
        release.append(_release(one, flight, rows))
    every, stated = np.concatenate(places or [np.zeros((0, 4))]), np.concatenate(sigmas or [np.zeros((0, 2))])
    noise = np.array(every[:, 2:])
    begin = 0
    for part in places:               # scale, level and origin are stated apart; each flight stood in its own plane
        basis = np.column_stack([np.ones(len(part)), part[:, :2], part[:, 0] ** 2, part[:, 0] * part[:, 1]])
        for axis in range(2):
            fitted = basis @ np.linalg.lstsq(basis, part[:, 2 + axis], rcond=None)[0]
            noise[begin:begin + len(part), axis] -= fitted
        begin += len(part)
    gravity = one.self_test.gravity_m_s2 if one.self_test is not None else float("nan")
    return Marks(len(shots), len(taken), false, np.concatenate(centres or [np.zeros((0, 2))]), every[:, 2:], noise,
                 noise / stated, gravity, np.array(release).reshape(-1, 4), np.array(arrival).reshape(-1, 2), cost)


def _release(one: TrackedClip, flight: object, rows: np.ndarray) -> tuple[float, float, float, float]:
    """Errors of speed (share) and elevation (degrees) when first seen, and the same / their stated sigmas."""
    found = one.launch(one.flights.index(flight))
    k = int(np.searchsorted(rows[:, 0], flight.blobs[0].time_s))
    near = rows[max(k - 1, 0):k + 8]
    step = [np.polyval(np.polyder(np.polyfit(near[:, 0] - near[0, 0], near[:, axis], 3)),
                       flight.blobs[0].time_s - near[0, 0]) for axis in (1, 3)]
    speed, angle = float(np.hypot(*step)), float(np.degrees(np.arctan2(step[1], step[0])))
    off = found.speed_m_s - speed, found.elevation_deg - angle
    return off[0] / speed, off[1], off[0] / found.speed_sd_m_s, off[1] / found.elevation_sd_deg


def track(path: Path) -> tuple[TrackedClip, float]:
    """Track a clip; also return processor time / length of what was filmed."""
    began = time.process_time()
    clip = open_clip(path)
    one = track_clip(clip, View(2.0 * RADIUS_M, release_height_m=EXIT_M, mass_kg=MASS_KG))
    frames = sum(1 for _ in clip.frames())
    return one, (time.process_time() - began) / (frames / 60.0)


def line(name: str, marks: list[Marks]) -> str:
    """A row of the table."""
    def rms(parts: list[np.ndarray]) -> float:
        every = np.concatenate(parts)
        return float(np.sqrt((every ** 2).mean())) if every.size else float("nan")

    def within(parts: list[np.ndarray]) -> float:
        every = np.concatenate(parts)
        return float((np.abs(every) < 1.0).mean()) if every.size else float("nan")

    off = [abs(one.gravity_m_s2 / 9.81 - 1.0) < 0.01 for one in marks]
    return (f"| {name} | {sum(one.found for one in marks)}/{sum(one.true for one in marks)} | "
            f"{sum(one.false for one in marks)} | {rms([one.centre_px for one in marks]):.2f} | "
            f"{1e3 * rms([one.place_m for one in marks]):.0f} | {1e3 * rms([one.noise_m for one in marks]):.1f} | "
            f"{within([one.over_sigma for one in marks]):.2f} | {sum(off)}/{len(off)} | "
            f"{rms([one.release[:, 0] for one in marks]):.1%}, {rms([one.release[:, 1] for one in marks]):.2f}° | "
            f"{within([one.release[:, 2:] for one in marks]):.2f} | "
            f"{1e3 * rms([one.arrival_m for one in marks]):.0f} | {np.mean([one.cost for one in marks]):.2f} |")


def match(count: int, seed: int) -> str:
    """Match parts of recordings, with strays, and say how many are right, refused and wrong."""
    rng, right, refused, wrong = np.random.default_rng([seed, 1]), 0, 0, 0
    for _ in range(count):
        shots = np.cumsum(rng.uniform(4.0, 12.0, MATCH_SHOTS))
        first = int(rng.integers(0, MATCH_SHOTS - MATCH_SEEN[1]))
        chosen = np.arange(first, first + int(rng.integers(*MATCH_SEEN)))
        chosen = chosen[rng.uniform(size=len(chosen)) < 0.95]
        begin_s, end_s = shots[chosen[0]] - 3.0, shots[chosen[-1]] + 3.0
        times = shots[chosen] + rng.normal(0.0, MATCH_JITTER_S, len(chosen))
        stray = rng.uniform(begin_s, end_s, int(rng.uniform() < 0.3))
        every, truth = np.concatenate([times, stray]), np.concatenate([chosen, np.full(len(stray), -1)])
        order = np.argsort(every)
        found = match_times((every[order] - begin_s) * (1.0 + 3e-5), shots, 0.0, end_s - begin_s).shots
        named = found >= 0 if len(found) else np.zeros(0, bool)
        refused += not named.any()
        wrong += bool((named & (found != truth[order])).any()) if len(found) else 0
        right += bool(named.any()) and not (named & (found != truth[order])).any()
    return f"matching, {count} clips of 4 to 19 shots: {right} right, {refused} refused, {wrong} with a wrong shot"


def main() -> None:
    args = read_options(__doc__, flights=20, clips=2, rates="60,120", rows=1080, clutter=1000, kinds=",".join(KINDS),
                        matched=200, seed=5000)
    print(match(args.matched, args.seed))
    base = replace(Phone(), width_px=args.rows * 16 // 9, height_px=args.rows)
    print(f"\n{args.clips} clips of {args.flights} flights a row, {base.width_px} x {base.height_px}, from 10 m\n\n"
          "| clip | found | false | centre, px rms | position, mm rms | noise, mm | within one sigma | g within 1 % | "
          "speed, elevation, rms | within one sigma | arrival, mm rms | processor s a s |\n" + "|---" * 12 + "|")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        for rate in map(float, str(args.rates).split(",")):
            for kind in args.kinds.split(","):
                marks = []
                for number in range(args.clips):
                    phone = replace(base, rate_hz=rate, **KINDS[kind])
                    truth = film(path, phone, args.flights, args.seed + number, kind == "askew")
                    one, cost = track(path)
                    marks.append(judge(one, truth, cost))
                print(line(f"{rate:g} Hz, {kind}", marks), flush=True)
        began_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        SideCamera(replace(base, trouble=CLUTTER), EXIT_M, GOAL_M, args.seed).film(
            path, [], [(0.0, RobotPose(-5.0, 0.0, 0.0))], [(0.0, float(args.clutter))])
        one, cost = track(path)
        most_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"\nclutter, {args.clutter} s: {len(one.flights)} false flights; {cost:.2f} processor s a s; "
          f"memory grew by {(most_kb - began_kb) / 1024:.0f} MB, to {most_kb / 1024:.0f} MB")


if __name__ == "__main__":
    main()
