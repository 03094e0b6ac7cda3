"""Tracked clips as the files of a dataset: tracks.csv with standard deviations, shots.csv, rig.toml and pictures."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import msgspec
import numpy as np

from truearc.errors import InputError, save_whole
from truearc.robot.config.rig_spec import Rig, Tracker
from truearc.sim.data.dataset import Dataset, Film, Shots
from truearc.sim.data.files import LEFT_OUT, save_dataset
from truearc.sim.physics.simulate import trajectories
from truearc.sim.printed import save_csv
from truearc.sim.report import make_page
from truearc.sim.video.ballistics import Floats
from truearc.sim.video.match import match_by_order, match_times
from truearc.sim.video.overlay import draw_clip, draw_flight, to_pixel
from truearc.sim.video.track import TrackedClip

COLUMNS = ("shot_id", "t_s", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_z_m")
PICTURES = "flights"                  # folder of the pictures
FILM_COLUMNS, FILM_DARKER = 640, 0.6  # of the picture that a finding shows
CHOOSE = "index.html"                 # the page to accept or reject flights, in that folder


@dataclass(frozen=True)
class Named:
    """Which shot each flight of the clips is.

    shot_id: A name a flight, "" where it is no known shot; a tuple a clip.
    lines: How each clip was matched.
    complete: Whether every clip was.
    rejected: Names of the flights that the user rejected.
    """

    shot_id: tuple[tuple[str, ...], ...]
    lines: tuple[str, ...] = ()
    complete: bool = True
    rejected: frozenset[str] = frozenset()


def name_flights(clips: Sequence[TrackedClip]) -> Named:
    """Name flights after their clips, where there is no recording."""
    return Named(tuple(tuple(flight_name(one, number) for number in range(len(one.flights)))
                       for one in clips))


def match_flights(clips: Sequence[TrackedClip], recorded: Dataset, by_order: bool = False) -> Named:
    """Match the flights of clips to the shots of a recording.

    Args:
        clips: All of one camera, or of several that did not film the same shots.
        recorded: Shots with `t_s`.
        by_order: Take the first flight of the clips for the first shot, and so on.

    Raises:
        InputError: by_order, and there are not as many flights as shots.
    """
    ids = np.array([*recorded.shots.shot_id, ""])         # row -1 is no shot
    if by_order:
        rows = match_by_order(sum(len(one.flights) for one in clips), len(recorded.shots))
        ends = np.cumsum([len(one.flights) for one in clips])[:-1]
        return Named(tuple(tuple(map(str, ids[part])) for part in np.split(rows, ends)), ("matched by order",))
    order = np.argsort(recorded.shots.number("t_s"))
    shot_s, taken, complete = recorded.shots.number("t_s")[order], set[str](), True
    names: list[tuple[str, ...]] = []
    lines = []
    for one in clips:
        matching = match_times(one.begin_s, shot_s, 0.0, one.end_s)
        rows = matching.shots if len(matching.shots) else np.full(len(one.flights), -1)
        own = [str(ids[-1] if row < 0 else ids[order[row]]) for row in rows]
        said = str(matching)
        if twice := taken & {name for name in own if name}:
            own, said = [""] * len(own), f"not matched: shots such as {min(twice)} are another clip's"
        complete &= any(own)
        taken.update(own)
        names.append(tuple(own))
        lines.append(f"{one.clip.name}: {said}")
    return Named(tuple(names), tuple(lines), complete)


def flight_name(one: TrackedClip, number: int) -> str:
    """Return the name of a flight of a clip, from 0, as its picture has it."""
    return f"{one.clip.name}-{number + 1:03d}"


def reject(named: Named, clips: Sequence[TrackedClip], rejected: Collection[str]) -> Named:
    """Return the names without those of flights that the user rejected.

    Raises:
        InputError: There is no flight of such a name.
    """
    every = [[flight_name(one, number) for number in range(len(one.flights))] for one in clips]
    if unknown := sorted(set(rejected) - {name for names in every for name in names}):
        raise InputError(f"--without: there is no flight {unknown[0]}; expected names of pictures, such as clip-001")
    return replace(named, rejected=frozenset(rejected), shot_id=tuple(
        tuple("" if flight in rejected else name for name, flight in zip(names, flights, strict=True))
        for names, flights in zip(named.shot_id, every, strict=True)))


def make_choice(clips: Sequence[TrackedClip], rejected: Collection[str]) -> str:
    """Return the page on which flights are accepted or rejected by key; it ends in the option that says which."""
    return make_page(
        "Accept or reject flights", "Circles are where the ball was found, the line is the fitted flight; a flight is "
        "wrong if its circles are not on the ball. Press J and K to go on and back, X or click to reject or accept.",
        [], template="choose.html", rejected=sorted(rejected),
        flights=[(flight_name(one, number), one.line(number)) for one in clips for number in range(len(one.flights))])


def save_tracks(folder: Path, clips: Sequence[TrackedClip], named: Named, rig: Rig | None,
                recorded: Dataset | None = None) -> int:
    """Write the dataset of tracked clips; return the number of flights in tracks.csv.

    Args:
        folder: New or empty.
        clips: With their flights.
        named: Of `name_flights` or `match_flights`.
        rig: Ball, launcher and target; None: no rig.toml is written.
        recorded: The recording's shots; None: a row of shots.csv is a flight.
    """
    folder.mkdir(parents=True, exist_ok=True)
    left_out = [line for one in clips for line in one.left_out]
    rows, flights = [], []
    for one, names in zip(clips, named.shot_id, strict=True):
        for number, (name, placed) in enumerate(zip(names, one.placed, strict=False)):
            if not name:
                why = ("rejected by the user" if flight_name(one, number) in named.rejected else
                       "belongs to no recorded shot")
                left_out.append(f"{one.clip.name} flight {number + 1}: {why}")
                continue
            flights.append((name, one.clip.name, float(placed.time_s[0])))
            rows += [(name, f"{t - placed.time_s[0]:.6f}", f"{x:.5f}", "", f"{z:.5f}", f"{sx:.5f}", f"{sz:.5f}")
                     for t, x, z, sx, sz in zip(*placed[1:], strict=True)]
    if recorded is not None:
        shots, traces = recorded.shots, recorded.traces
        left_out = [*recorded.left_out, *left_out]
    else:
        shots, traces = Shots(tuple(name for name, _, _ in flights), {"t_s": np.array([t for _, _, t in flights])},
                              {"session": tuple(clip for _, clip, _ in flights)}), None
    if rig is not None:
        save_dataset(folder, Dataset(folder.name, with_tracker(rig, clips), shots, None, traces, tuple(left_out),
                                     film=film_of(clips, named)))
    else:
        save_csv(folder / "shots.csv", ("shot_id", "t_s", "session"),
                 [(name, f"{t:.6f}", clip) for name, clip, t in flights])
        if left_out:
            save_whole(folder / LEFT_OUT, "".join(f"{line}\n" for line in left_out).encode())
    save_csv(folder / "tracks.csv", COLUMNS, rows)
    return len(flights)


def film_of(clips: Sequence[TrackedClip], named: Named) -> Film | None:
    """Return the picture of the first clip with flights, and where metres of each shot are in it."""
    first = next((one for one in clips if one.placed), None)
    still = None if first is None else first.still()
    if first is None or still is None:
        return None
    share = min(1.0, FILM_COLUMNS / still.shape[1])
    small = cv2.resize(still, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", cv2.convertScaleAbs(small, alpha=FILM_DARKER))
    return Film(data.tobytes(), {
        name: _rows(share * to_pixel(flight, placed))
        for one, names in zip(clips, named.shot_id, strict=True) if one.calibration is first.calibration
        for name, flight, placed in zip(names, one.flights, one.placed, strict=False) if name})


def _rows(matrix: Floats) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    first, second, third = ((round(a, 3), round(b, 3)) for a, b in matrix.tolist())
    return first, second, third


def with_tracker(rig: Rig, clips: Sequence[TrackedClip]) -> Rig:
    """Return the rig with what is known of the clips' scale, level and clock, by the least certain of them."""
    known = [one.calibration for one in clips if one.calibration is not None and one.placed]
    if not known:
        return rig
    return msgspec.structs.replace(rig, tracker=Tracker(
        scale_sd=round(max(one.scale_sd for one in known), 5), clock_sd=max(one.clock_sd for one in known),
        tilt_sd_deg=round(max(one.tilt_sd_deg for one in known), 3)))


def save_pictures(folder: Path, one: TrackedClip, names: Sequence[str] = (), recorded: Dataset | None = None) -> None:
    """Write a picture of each flight of a clip, and one of all, into a folder of the dataset.

    Args:
        folder: Of the dataset.
        one: The clip.
        names: shot_id of each flight, "" for none.
        recorded: The recording's shots, for colours by outcome and the simulation's flights.
    """
    (folder / PICTURES).mkdir(parents=True, exist_ok=True)
    if one.flights:
        done, data = cv2.imencode(".jpg", draw_clip(one, *_of_shots(one, names, recorded)))
        if done:
            save_whole(folder / PICTURES / f"{one.clip.name}.jpg", data.tobytes())
    for number in range(len(one.flights)):
        done, data = cv2.imencode(".jpg", draw_flight(one, number))
        if done:
            save_whole(folder / PICTURES / f"{flight_name(one, number)}.jpg", data.tobytes())


def _of_shots(one: TrackedClip, names: Sequence[str],
              recorded: Dataset | None) -> tuple[list[str], list[Floats | None]]:
    """(outcome, simulated flight) of each flight of a clip."""
    nothing: list[Floats | None] = [None] * len(one.flights)
    if recorded is None:
        return [""] * len(one.flights), nothing
    row_of = {name: row for row, name in enumerate(recorded.shots.shot_id)}
    rows = [row_of.get(name, -1) for name in names]
    outcomes = recorded.shots.text("outcome")
    said = [outcomes[row] if row >= 0 else "" for row in rows]
    used = [row for row in rows if row >= 0]
    try:
        paths = trajectories(recorded.facts, {}, recorded.shots.take(used)) if used else ()
    except InputError:                # shots without wheels, hood or distance have no simulation
        return said, nothing
    flown = dict(zip(used, paths, strict=True))
    return said, [flown[row][0][:, [0, 2]] if row in flown else None for row in rows]
