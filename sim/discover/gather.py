"""A dataset -> evidence from everything in it that the believed simulation speaks of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robot.config import BadInput
from sim.discover.evidence import Array, Evidence
from sim.discover.launch_evidence import launch_evidence
from sim.discover.motion import believe
from sim.discover.outcome_evidence import fit_outcomes, make_plane, outcome_evidence
from sim.discover.outcomes import see_outcomes
from sim.discover.samples import Samples, gather_samples, measure_scatter
from sim.discover.track_evidence import push_columns, track_evidence
from sim.discover.tracks import TrackFit, first_guess, fit_tracks, release_spin
from sim.physics.catalogue import flight_terms
from sim.physics.launch import Exit
from sim.physics.shot import launch_of
from sim.shots import Dataset, Shots

Progress = Callable[[float, str], None]
FEWEST_SHOTS = 10
FEWEST_OUTCOMES = 10
# What every shot is fired with; any other number is telemetry.
SETTINGS = ("distance_m", "hood_deg", "motor_ratio", "miss_height_m", "t_s")


@dataclass(frozen=True)
class Gathered:
    """Evidence, and what a report needs beside it."""

    evidences: tuple[Evidence, ...]
    level: str                        # L0 outcomes | L1 with telemetry | L2 with tracks
    fitted: dict[str, dict[str, float]]       # kind of evidence -> fitted shared parameters
    tracks: TrackFit | None
    columns: Array | None             # [n, L, 3, C] what a unit of each track channel adds to positions
    left_out: tuple[str, ...]


def gather(dataset: Dataset, terms: Sequence[str], progress: Progress) -> Gathered:
    """Fit the believed terms to tracks, and to outcomes and heights, whichever there are.

    BadInput for an unknown term, or fewer than FEWEST_SHOTS shots.
    """
    believed_terms = flight_terms(terms)
    if len(dataset.shots) < FEWEST_SHOTS:
        raise BadInput(f"{dataset.name}: shots: {len(dataset.shots)} are too few to judge a simulation by; "
                       f"{FEWEST_SHOTS} at least")
    left_out = list(dataset.left_out)
    launched, leaving = _launches(dataset)
    evidences: list[Evidence] = []
    fitted: dict[str, dict[str, float]] = {}
    tracks, columns = None, None
    samples, notes = _samples(dataset)
    left_out += notes
    if samples is not None and len(samples.rows) >= FEWEST_SHOTS:
        tracks = _fit_tracks(dataset, believed_terms, samples, launched, leaving)
        progress(0.3, "tracks")
        channels, columns = push_columns(tracks)
        evidences.append(track_evidence(tracks, channels, columns))
        fitted["tracks"] = dict(zip(evidences[0].shared, tracks.shared.tolist(), strict=True))
        if leaving is not None and launched[samples.rows].all():
            evidences.append(launch_evidence(tracks, leaving.take(samples.rows)))
    progress(0.5, "outcomes")
    outcome = _outcomes(dataset, believed_terms, launched, leaving, left_out)
    if outcome is not None:
        evidences.append(outcome[0])
        fitted["outcomes"] = {name: float(np.exp(value) if name.startswith("scatter.") else value)
                              for name, value in zip(outcome[0].shared, outcome[1], strict=True)}
    progress(1.0, "fitted")
    return Gathered(tuple(evidences), _level(dataset, tracks), fitted, tracks, columns, tuple(left_out))


def _samples(dataset: Dataset) -> tuple[Samples | None, tuple[str, ...]]:
    if dataset.tracks is None or len(dataset.tracks.t_s) == 0:
        return None, ()
    samples, notes, _ = gather_samples(dataset.tracks, len(dataset.shots))
    return samples, notes


def _fit_tracks(dataset: Dataset, terms: tuple, samples: Samples, launched: Array, leaving: Exit | None) -> TrackFit:
    """Tracks with the spin that wheels or exit columns give; without any, lift cannot be fitted and is left out."""
    backspin = np.full(len(dataset.shots), np.nan)
    if leaving is not None:
        backspin[launched] = np.asarray(leaving.spin_rev_s)[launched]
    else:
        backspin = _backspin(dataset)
    _, velocity = first_guess(samples)
    spin = release_spin(dataset.facts, dataset.shots.take(samples.rows), backspin[samples.rows], velocity)
    without = () if np.abs(spin).max(initial=0.0) > 1e-6 else ("magnus",)
    scatter = measure_scatter(samples, dataset.facts.noise.track_m)
    return fit_tracks(believe(dataset.facts, terms, without), samples, scatter, spin)


def _backspin(dataset: Dataset) -> Array:
    """Backspin of each shot in rev/s where it is known without an elevation, nan elsewhere."""
    _, leaving = _launches(Dataset(dataset.name, dataset.facts, _levelled(dataset.shots)))
    return np.full(len(dataset.shots), np.nan) if leaving is None else np.asarray(leaving.spin_rev_s)


def _levelled(shots: Shots) -> Shots:
    return Shots(shots.shot_id, {**shots.numbers, "hood_deg": np.zeros(len(shots))}, shots.texts)


def _launches(dataset: Dataset) -> tuple[Array, Exit | None]:
    """Which shots [n] have a full launch in their columns, and those launches (nan elsewhere); None when none has."""
    shots, wheels = dataset.shots, dataset.facts.launcher.wheel
    turned = np.all([np.isfinite(shots.number(f"wheel_{wheel.name}_rad_s")) for wheel in wheels], axis=0)
    driven = bool(wheels) & (turned | np.isfinite(shots.number("motor_ratio")))
    known = ((np.isfinite(shots.number("exit_deg")) | np.isfinite(shots.number("hood_deg")))
             & (driven | np.isfinite(shots.number("exit_speed_m_s"))))
    if not known.any():
        return known, None
    part = launch_of(dataset.facts, shots.take(known))
    whole = np.full((len(part), len(shots)), np.nan)
    whole[:, known] = np.stack([np.broadcast_to(np.asarray(column, dtype=float), known.sum()) for column in part])
    return known, Exit(*whole)


def _outcomes(dataset: Dataset, terms: tuple, launched: Array, leaving: Exit | None,
              left_out: list[str]) -> tuple[Evidence, Array] | None:
    """Evidence and shared parameters of shots whose outcome, launch and distance are known; None if too few."""
    rows, seen = see_outcomes(dataset.shots, dataset.facts.target)
    usable = launched[rows] & np.isfinite(dataset.shots.number("distance_m")[rows])
    if len(rows) and not usable.all():
        left_out.append(f"{int((~usable).sum())} outcomes without distance_m, or without hood_deg and a launch speed")
    if usable.sum() < FEWEST_OUTCOMES or leaving is None:
        return None
    rows, seen = rows[usable], seen.take(usable)
    spins = bool(np.abs(np.asarray(leaving.spin_rev_s)[rows]).max() > 1e-6)
    believed = believe(dataset.facts, terms, () if spins else ("magnus",))
    plane = make_plane(believed, dataset.shots, leaving, rows, seen)
    shared = fit_outcomes(plane)
    return outcome_evidence(plane, rows, shared), shared


def _fitted_outcomes(evidence: Evidence) -> dict[str, float]:
    """Coefficients and scatters as fitted: the log prior's slope tells how far they are from its middle."""
    values = evidence.fitted
    return {name: float(np.exp(value) if name.startswith("scatter.") else value)
            for name, value in zip(evidence.shared, values, strict=True)}


def _level(dataset: Dataset, tracks: TrackFit | None) -> str:
    if tracks is not None:
        return "L2"
    wheels = tuple(f"wheel_{wheel.name}_rad_s" for wheel in dataset.facts.launcher.wheel)
    telemetry = [name for name in dataset.shots.numbers if name not in SETTINGS + wheels]
    return "L1" if telemetry or dataset.traces is not None else "L0"

