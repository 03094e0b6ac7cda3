"""A dataset as evidence for a likelihood: each shot with what it has, and text about what is left out."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.data.conditions import Circumstances
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.shot_conditions import circumstances_of, take_circumstances
from truearc.sim.infer.likelihood.launch_inputs import EXIT_DEG_SD, EXIT_SPEED_SD_M_S, Given, given_of
from truearc.sim.infer.likelihood.outcome_likelihood import OutcomeMarks, make_marks
from truearc.sim.infer.likelihood.track_data import TrackData, gather_tracks
from truearc.sim.physics.simulate import ORDINARY, has_wheels, spin_of

FEWEST_SHOTS = 10                     # by which a simulation is judged

Which = Bool[np.ndarray, " n"]


class ShotObservations(NamedTuple):
    """Measurements of the launch itself; none where `*_seen` is False."""

    speed_seen: Bool[Any, " n"]
    log_speed: Float[Any, " n"]
    log_speed_sd: Float[Any, " n"]
    elevation_seen: Bool[Any, " n"]
    elevation_rad: Float[Any, " n"]
    elevation_sd_rad: Float[Any, " n"]


class Observations(NamedTuple):
    """Arrays for the likelihood, one row a unit: first the shots with a launch [n], then free flights [f].

    marks: None when not one was made. tracks: of shots with a launch, whose `row` is among the n. free: of flights
    with an unknown launch, with their backspin as measured, else by the wheels, else none.
    """

    given: Given
    seen: ShotObservations
    marks: OutcomeMarks | None
    tracks: TrackData | None
    free: TrackData | None
    free_spin_rev_s: Float[Any, " f"]
    free_circumstances: Circumstances = ORDINARY


@dataclass(frozen=True, eq=False)
class Gathered:
    """Evidence, the shot (row of the dataset) behind each of its units, and the words about it.

    `used`: {kind of evidence: shots that have it}. left_out: one line a reason.
    """

    evidence: Observations
    shots: Shots
    rows: Int[np.ndarray, " units"]
    used: dict[str, int]
    left_out: tuple[str, ...]


def gather(rig: Rig, dataset: Dataset) -> Gathered:
    """All that a fit can use; InputError when that is nothing."""
    shots = dataset.shots
    launched, marked = _has_launch(rig, shots), _has_mark(shots)
    placed = np.isfinite(shots.number("distance_m"))
    tracked = np.zeros(len(shots), bool)
    if dataset.tracks is not None:
        tracked[np.unique(dataset.tracks.shot)] = True
    at_plane = launched & marked & placed & (rig.target is not None)
    measured = np.isfinite(shots.number("exit_speed_m_s")) | np.isfinite(shots.number("exit_deg"))
    use = launched & (at_plane | tracked | (measured & has_wheels(rig, shots)))
    rows = np.flatnonzero(use)
    tracks = gather_tracks(dataset.tracks, rows)
    free = gather_tracks(dataset.tracks, np.flatnonzero(tracked & ~launched))
    left_out = _left_out(rig, shots, launched, marked, placed, tracked, use, (tracks, free))
    if not rows.size and free is None:
        raise InputError(f"{shots.source}: there is nothing to fit to, neither a track nor a shot with both a launch "
                         f"and something seen of its flight: {'; '.join(left_out) or 'there are no shots'}")
    free_rows = np.flatnonzero(tracked & ~launched)[free.row if free is not None else np.zeros(0, np.int64)]
    around = circumstances_of(dataset)
    given, seen, marks = _launches(rig, shots.take(rows), at_plane[rows])
    evidence = Observations(given._replace(circumstances=take_circumstances(around, rows)), seen, marks, tracks, free,
                        spin_of(rig, shots)[free_rows], take_circumstances(around, free_rows))
    rows = np.concatenate([rows, free_rows])
    return Gathered(evidence, shots, rows, _used(shots.take(rows), evidence), left_out)


def blind(given: Given) -> Observations:
    """Launches of which nothing was seen, neither leaving nor arriving."""
    n = len(given.rolled)
    no, zero, one = np.zeros(n, bool), np.zeros(n), np.ones(n)
    return Observations(given, ShotObservations(no, zero, one, no, zero, one), None, None, None, np.zeros(0))


def _launches(rig: Rig, shots: Shots, at_plane: Which) -> tuple[Given, ShotObservations, OutcomeMarks | None]:
    """Where wheels and hood speak, measured speed and elevation are evidence about them, not a launch of their own."""
    wheels, hood = has_wheels(rig, shots), np.isfinite(shots.number("hood_deg"))
    speed, elevation = shots.number("exit_speed_m_s"), shots.number("exit_deg")
    numbers = dict(shots.numbers)
    numbers["exit_speed_m_s"] = np.where(wheels, np.nan, speed)
    numbers["exit_deg"] = np.where(hood, np.nan, elevation)
    numbers["distance_m"] = np.where(np.isfinite(shots.number("distance_m")), shots.number("distance_m"), 1.0)
    given = given_of(rig, Shots(shots.shot_id, numbers, shots.texts, shots.source))
    speed_seen, elevation_seen = wheels & (speed > 0.0), hood & np.isfinite(elevation)
    seen = ShotObservations(speed_seen, np.log(np.where(speed_seen, speed, 1.0)),
                EXIT_SPEED_SD_M_S / np.where(speed_seen, speed, 1.0), elevation_seen,
                np.radians(np.where(elevation_seen, elevation, 0.0)), np.full(len(shots), np.radians(EXIT_DEG_SD)))
    return given, seen, _marks(rig, shots, at_plane)


def _marks(rig: Rig, shots: Shots, at_plane: Which) -> OutcomeMarks | None:
    if rig.target is None or not at_plane.any():
        return None
    outcome, side = (tuple(word if here else "" for word, here in zip(shots.text(name), at_plane, strict=True))
                     for name in ("outcome", "side"))
    return make_marks(rig.target, outcome, side, np.where(at_plane, shots.number("miss_height_m"), np.nan))


def say_few(count: int) -> str:
    """Say what so few shots cannot tell."""
    return f"{count} shots are too few to judge a simulation by; {FEWEST_SHOTS} at least"


def _has_speed(rig: Rig, shots: Shots) -> Which:
    return has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))


def _has_launch(rig: Rig, shots: Shots) -> Which:
    return _has_speed(rig, shots) & (np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg")))


def _has_mark(shots: Shots) -> Which:
    """Return which shots have a mark with information about the height."""
    side = np.array(shots.text("side"))
    outcome = np.array(shots.text("outcome"))
    beside = np.isin(side, ("left", "right")) & np.isin(outcome, ("miss", ""))
    worded = ((outcome != "") | np.isin(side, ("low", "high"))) & ~beside
    return np.asarray(worded | np.isfinite(shots.number("miss_height_m")))


def _left_out(rig: Rig, shots: Shots, launched: Which, marked: Which, placed: Which, tracked: Which, use: Which,
              tracks: tuple[TrackData | None, ...]) -> tuple[str, ...]:
    unused = ~use & ~(tracked & ~launched)
    beside, sped = np.isin(shots.text("side"), ("left", "right")) & ~marked, _has_speed(rig, shots)
    aimed = np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg"))
    reasons = (
        (unused & launched & beside, "missed left or right, without information about the height"),
        (unused & launched & ~marked & ~beside,
         "nothing was seen of their flight: no outcome, side, miss_height_m, exit_* or track"),
        (unused & marked & ~placed, "no distance_m"),
        (unused & ~sped, "no launch speed: motor_ratio (with launcher.free_speed_rad_s in rig.toml), every "
                         "wheel_<name>_rad_s, or exit_speed_m_s"),
        (unused & ~aimed, "no hood_deg or exit_deg"),
        (unused & launched & marked & placed & (rig.target is None), "rig.toml has no [target]"),
        (marked & tracked & ~launched, "their outcome only: no launch, the track alone counts"),
    )
    said = [f"{int(which.sum())} of {len(shots)} shots: {why} ({_names(shots, which)})" for which, why in reasons
            if which.any()]
    short = sum(part.too_short for part in tracks if part is not None)
    return (*said, *([f"{short} tracks: too few samples to say anything"] if short else []))


def _names(shots: Shots, which: Which, most: int = 3) -> str:
    names = [shots.shot_id[row] for row in np.flatnonzero(which)]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


def _used(shots: Shots, evidence: Observations) -> dict[str, int]:
    seen, n = evidence.seen, len(evidence.given.rolled)
    marked, measured = np.zeros((2, n), bool) if evidence.marks is None else evidence.marks[5:7]
    sides = np.isin(shots.text("side"), ("low", "high"))[:n]
    tracks = sum(len(part.row) for part in (evidence.tracks, evidence.free) if part is not None)
    counts = {"outcome": int((marked & ~measured).sum()), "side": int((sides & marked & ~measured).sum()),
              "miss_height_m": int(measured.sum()),
              "exit_speed_m_s": int(seen.speed_seen.sum()), "exit_deg": int(seen.elevation_seen.sum()),
              "exit_spin_rev_s": int(np.isfinite(shots.number("exit_spin_rev_s")).sum()), "tracks": tracks}
    return {kind: count for kind, count in counts.items() if count}
