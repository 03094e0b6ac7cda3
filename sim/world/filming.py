"""Clips of the emulated world's flights, by an emulated phone beside them, and the truth of each flight.

Filmed are the flights and one second around each; a clip ends after a number of flights. The truth, for benchmarks
only, is a table beside the folder of the clips, where a tracker that is given the folder's files does not see it.
"""

from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.hw.emulated.imaging.hall import GOAL_HALF_HEIGHT_M, GOAL_M, RobotPose
from truearc.hw.emulated.imaging.phone import Path3D, Phone, Seen, SideCamera
from truearc.sim.printed import save_csv
from truearc.sim.world.field import CENTRE_HEIGHT_M, EXIT_HEIGHT_M, Flight
from truearc.sim.world.world import World

AROUND_S = 1.0                        # filmed before and after each flight
FLIGHTS = 20                          # of a clip
POSE_S = 1.0 / 60.0                   # how often a moving robot is noted
LATE = 10                             # samples before a ball's last, from which its acceleration is taken
INSIDE_S, BEYOND_S = 0.02, 0.25       # of a ball's way before its release and after its arrival
BOUNCE = 0.6                          # speed kept by a ball that hits the floor
TRUTH = "-truth.csv"                  # added to the name of the clips' folder


class Filmer:
    """Watches a world, and films its flights. Call `step` once a tick and `close` at the end."""

    def __init__(self, world: World, folder: Path, seed: int, phone: Phone | None = None,
                 goal_height_m: float = CENTRE_HEIGHT_M) -> None:
        """Make the folder.

        Raises:
            InputError: It exists and is not empty.
        """
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: exists; clips need a new folder")
        folder.mkdir(parents=True, exist_ok=True)
        self._world, self._folder, self._goal_height_m = world, folder, goal_height_m
        self._camera = SideCamera(phone or Phone(), EXIT_HEIGHT_M, goal_height_m, seed)
        self._airborne: dict[int, tuple[Flight, list[tuple[float, np.ndarray]], RobotPose]] = {}
        self._balls: list[Path3D] = []
        self._poses: list[tuple[float, RobotPose]] = []
        self._truth: list[tuple[str, Seen]] = []
        self._clips = 0

    def step(self, t_ns: int) -> None:
        """Note where robot and balls are; write a clip when it is full."""
        now_s, pose = t_ns * 1e-9, self._world.chassis.pose()
        if not self._poses or (self._poses[-1][1].key != tuple(pose) and now_s - self._poses[-1][0] >= POSE_S):
            self._poses.append((now_s, RobotPose(*pose)))
        for flight in self._world.flying:
            known = self._airborne.setdefault(id(flight), (flight, [], RobotPose(*pose)))
            known[1].append((float(flight.data.time), flight.data.qpos[:3].copy()))
        flying = {id(flight) for flight in self._world.flying}
        for key in [key for key in self._airborne if key not in flying]:
            flight, places, at_release = self._airborne.pop(key)
            if len(places) > LATE + 2:
                self._balls.append(_path(flight, places, at_release, now_s, self._goal_height_m))
        if len(self._balls) >= FLIGHTS and not flying and now_s > self._balls[-1].seen_s[1] + AROUND_S:
            self._write()

    def close(self) -> None:
        """Write the last clip and the truth."""
        if self._balls:
            self._write()
        save_csv(self._folder.with_name(self._folder.name + TRUTH), ("clip", *Seen._fields),
                 [(clip, *(f"{value:.6f}" if isinstance(value, float) else value for value in row))
                  for clip, row in self._truth])

    def _write(self) -> None:
        self._clips += 1
        spans: list[tuple[float, float]] = []
        for ball in self._balls:
            begin_s, end_s = max(ball.seen_s[0] - AROUND_S, 0.0), ball.seen_s[1] + AROUND_S
            if spans and begin_s <= spans[-1][1]:
                spans[-1] = (spans[-1][0], max(end_s, spans[-1][1]))
            else:
                spans.append((begin_s, end_s))
        path = self._folder / f"clip-{self._clips:02d}.mp4"
        self._truth += [(path.stem, row) for row in self._camera.film(path, self._balls, self._poses, spans)]
        self._balls, self._poses = [], self._poses[-1:]


def _path(flight: Flight, places: list[tuple[float, np.ndarray]], pose: RobotPose, now_s: float,
          goal_height_m: float) -> Path3D:
    """The way of a ball that has arrived, with what the launcher and the goal hide of it, or its first bounce."""
    result = flight.result()
    release_s = (result.exit_t_ns if result is not None else 0) * 1e-9
    arrival_s = (result.arrival_t_ns if result is not None else 0) * 1e-9 or now_s
    since, ways = np.array([time_s for time_s, _ in places]), np.array([place for _, place in places])
    begin_m_s, end_m_s, late_m_s = ((ways[k + 1] - ways[k]) / (since[k + 1] - since[k]) for k in (0, -2, -2 - LATE))
    before = ways[0] - begin_m_s * INSIDE_S
    # as it flew at last, until it bounces or the goal hides it
    pull = (end_m_s - late_m_s) / (since[-2] - since[-2 - LATE])
    after_s, last = np.arange(0.005, BEYOND_S, 0.005), ways[-1]
    after = last + end_m_s * after_s[:, None] + 0.5 * pull * after_s[:, None] ** 2
    if last[0] >= 0.0 and abs(last[2] - goal_height_m) < GOAL_HALF_HEIGHT_M:
        kept = after[:, 0] < 0.5 * GOAL_M[1]      # it stays in there
        after_s, after = after_s[kept], after[kept]
    radius_m = flight.radius_m
    under = after[:, 2] < radius_m
    after[under, 2] = radius_m + BOUNCE * (radius_m - after[under, 2])
    spin = result.exit_spin_rev_s if result is not None else 0.0
    return Path3D(result.shot if result is not None else -1,
                  release_s + np.concatenate([[since[0] - INSIDE_S], since, since[-1] + after_s]),
                  np.concatenate([before[None], ways, after]), radius_m, spin, pose, (release_s, arrival_s))
