"""Forecasts of tracks under a belief: the ball's position over time, from its settings or the first part of its flight.

A flight is approximately linear in the parameters that all flights share (those of the belief, errors of the tracker)
and in the ball's deviations from its configuration. All have normal priors. The observations of the flights (samples,
measured exits) turn these into a normal posterior, which gives a position with its standard deviation at every time.
Flights are simulated again at their most likely deviations until these converge.

This leaves out what the model gets wrong within a flight, of which sparse samples cannot tell it from noise. How far
the ends of its own flights were off is therefore measured when a belief is made, and widens the bands of forecasts.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, Tracks, circumstances_of
from truearc.sim.infer.belief import Belief, along, launcher_of, ranges_of
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.data import Intake, every_column, take_in
from truearc.sim.infer.likelihood.layout import believed_name, is_tracker, lay_out
from truearc.sim.infer.likelihood.linearization import LEAD, TRACK, variance_of
from truearc.sim.infer.likelihood.noise import UNMEASURED_M
from truearc.sim.infer.likelihood.observations import FEWEST_SAMPLES, PAD, samples_of
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.simulate import POINT_S, trajectories

MEASURED_SHARE, MEASURED = 0.4, 60           # of a flight that is known, and flights, of `forecast_error`; chosen
ERROR = "forecast_error"                     # its key in a belief's provenance
STEP_S, LONGEST_S = 2.0 * POINT_S, 2.0       # between places where no sample says when, and how far they go
ROUNDS, SETTLED = 8, 0.01                    # of flying again; standard deviations that deviations may still move


class FlightForecast(NamedTuple):
    """Of one shot (its row): times [m] in s, places [m, 3] in m in the launcher's frame, their standard deviations."""

    row: int
    t_s: Float[Array, " m"]
    place_m: Float[Array, "m 3"]
    sd_m: Float[Array, "m 3"]


def forecast_flights(dataset: Dataset, belief: Belief, share: float) -> list[FlightForecast]:
    """Forecast flights from the first `share` of each track's samples, at the times of the others; from all of them,
    every STEP_S on to the floor. share 0: from settings alone, every STEP_S from release to the plane or the floor.

    Tracks with fewer than FEWEST_SAMPLES samples in their first part have no forecast. InputError: no track is left, or
    no settings.
    """
    early, later = _by_settings(dataset, belief) if share == 0.0 else _by_start(dataset, share)
    data = take_in(early, belief.curves, fewest=1) if later else None
    if data is None or data.samples is None:
        raise InputError(f"{dataset.shots.source}: no flight can be forecast: "
                         f"fewer than {FEWEST_SAMPLES} samples of each are known")
    t_s = [later[row] for row in data.samples.rows.tolist()]
    model = _launcher(data, belief, t_s, blind=share == 0.0)
    known = belief.provenance.get(ERROR)
    wider = max(1.0, float(known)) if isinstance(known, int | float) and share > 0.0 else 1.0
    return [one._replace(sd_m=wider * one.sd_m) for one in _forecast(model, doubt_of(model, belief), t_s, share == 1.0)]


def known_of(dataset: Dataset, belief: Belief) -> dict[str, Any]:
    """Return what a belief's provenance says of the shots it was made from: the ranges of their settings, the rig, and,
    with tracks, the error of forecasts."""
    return {"range": ranges_of(dataset.shots), "rig": launcher_of(dataset.rig),
            **({ERROR: forecast_error(dataset, belief)} if dataset.tracks is not None else {})}


def forecast_error(dataset: Dataset, belief: Belief) -> float:
    """Return by how many standard deviations (root mean square, at least 1) ends of the dataset's tracks are off
    forecasts from their first MEASURED_SHARE; 1 if no track can be forecast."""
    if dataset.tracks is None:
        return 1.0
    rows = np.unique(dataset.tracks.shot)
    some = dataset.take(rows[np.linspace(0, len(rows) - 1, min(len(rows), MEASURED)).astype(int)].tolist())
    samples, noise, _ = samples_of(some)
    if samples is None or noise is None or samples.real.sum(1).max() < 2 * FEWEST_SAMPLES:
        return 1.0
    seen, square = noise.sigma_m < UNMEASURED_M, list[float]()
    assert some.tracks is not None
    where = dict(some.tracks.by_shot())
    for one in forecast_flights(some, replace(belief, provenance={}), MEASURED_SHARE):
        end = where[one.row][-1]
        off = one.place_m[-1:] - [[some.tracks.x_m[end], some.tracks.y_m[end], some.tracks.z_m[end]]]
        square.extend((off**2 / (one.sd_m[-1:]**2 + noise.sigma_m**2))[0, seen] if len(one.t_s) else ())
    return float(max(1.0, np.sqrt(np.mean(square)))) if square else 1.0


def _by_settings(dataset: Dataset, belief: Belief) -> tuple[Dataset, dict[int, Array]]:
    """The dataset with the nominal flights as tracks, and their times."""
    around = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    flown = trajectories(dataset.rig, belief.coefficients, dataset.shots, around, belief.catalogue)
    places = [one[:-1:2] for one, _ in flown]
    shot = np.repeat(np.arange(len(places)), [len(one) for one in places])
    times = [STEP_S * np.arange(len(one)) for one in places]
    return (replace(dataset, tracks=Tracks(shot, np.concatenate(times), *np.concatenate(places).T), times=None),
            dict(enumerate(times)))


def _by_start(dataset: Dataset, share: float) -> tuple[Dataset, dict[int, Array]]:
    """The dataset with the first part of its tracks, and the times to forecast, from a track's first sample."""
    if dataset.tracks is None:
        raise InputError(f"{dataset.shots.source}: there is no tracks.csv; forecast from settings instead (share 0)")
    tracks, kept, later = dataset.tracks, [], {}
    for row, where in tracks.by_shot():
        t_s, count = tracks.t_s[where] - tracks.t_s[where][0], max(int(share * len(where)), FEWEST_SAMPLES)
        kept.append(where[:count])
        later[row] = t_s[count:] if share < 1.0 else t_s[-1] + np.arange(STEP_S, LONGEST_S, STEP_S)
    rows = np.concatenate(kept) if kept else np.zeros(0, int)
    first = Tracks(tracks.shot[rows], tracks.t_s[rows], tracks.x_m[rows], tracks.y_m[rows], tracks.z_m[rows])
    return replace(dataset, tracks=first), later


def _launcher(data: Intake, belief: Belief, later: Sequence[Array], blind: bool) -> Launcher:
    """With places without samples at these times after (blind: in place of) each track's samples."""
    samples = data.samples
    assert samples is not None
    real = samples.real & (not blind)
    count = real.sum(1)
    width = -(-max(n + len(t_s) for n, t_s in zip(count, later, strict=True)) // PAD) * PAD
    more = width - real.shape[1]
    time_s, position_m = (np.pad(part, ((0, 0), (0, max(more, 0)), *[(0, 0)] * (part.ndim - 2)), mode="edge")[:, :width]
                          for part in (samples.time_s, samples.position_m))
    for k, (n, t_s) in enumerate(zip(count, later, strict=True)):
        if len(t_s):
            time_s[k, n:n + len(t_s)], time_s[k, n + len(t_s):] = t_s, t_s[-1]
    flown_s = np.zeros((len(data.rows), width))
    flown_s[data.tracked] = time_s
    lanes, noise_var = data.lanes._replace(time_s=flown_s), data.noise_var
    if blind:                                                # a forecast's time is that since release
        lanes, noise_var = lanes._replace(lead_s=np.zeros(len(data.rows))), noise_var.copy()
        noise_var[:, LEAD] = 0.0
    data = replace(data, lanes=lanes, noise_var=noise_var, samples=replace(samples, time_s=time_s,
                   position_m=position_m, real=np.full_like(real, True, shape=(len(real), width))))
    model = Launcher(data, lay_out(data, tuple(belief.coefficients), None, belief.catalogue, belief)).shared_only()
    seen = np.arange(width) < count[:, None]
    assert data.samples is not None
    return replace(model, data=replace(data, samples=replace(data.samples, real=seen)))


def _forecast(model: Launcher, shared: Float[Array, "inputs u"], later: Sequence[Array],
              to_floor: bool) -> list[FlightForecast]:
    data, point = model.data, model.believed()
    assert data.samples is not None
    sd = np.sqrt(variance_of(data, point.log_scatter))[:, :model.layout.chain.deviates]
    prior = np.stack([block_diag(shared, np.diag(one)) for one in sd])     # of unit normal numbers to the inputs
    for _ in range(ROUNDS):
        flown, at = model.fly(point), point.deviates
        normal = flown.exits.beside(flown.tracks, float(np.exp(-2.0 * point.log_scatter[TRACK])))
        told = _told(np.swapaxes(prior, 1, 2) @ normal.inner @ prior, np.einsum("niu,ni->nu", prior, normal.onto),
                     shared.shape[1])
        point = replace(point, deviates=told.own * sd)
        if np.abs((point.deviates - at) / np.maximum(sd, 1e-12)).max(initial=0.0) < SETTLED:
            break
    found, wide = [], shared.shape[1]
    for shot, row, first, t_s in zip(data.samples.rows.tolist(), data.tracked, data.samples.real.sum(1), later,
                                     strict=True):
        now = slice(first, first + len(t_s))
        raw = np.asarray(flown.slopes.track_m)[row, now]
        by, by_own = np.split(raw @ prior[row], [wide], axis=2)
        place = (np.asarray(flown.seen.track_m)[row, now] - raw[..., -sd.shape[1]:] @ at[row] + by @ told.shared
                 + by_own @ told.own[row])
        end = int(np.argmax(place[:, 2] < 0.0)) if to_floor and (place[:, 2] < 0.0).any() else len(t_s)
        by = by - by_own @ told.follows[row]
        variance = (np.einsum("lci,ij,lcj->lc", by, told.doubt, by)
                    + np.einsum("lci,ij,lcj->lc", by_own, told.own_doubt[row], by_own))
        found.append(FlightForecast(shot, t_s[:end], place[:end], np.sqrt(variance[:end])))
    return found


class _Told(NamedTuple):
    """What n flights say of u shared numbers and d own ones, unit normal before: means, the shared ones' covariance,
    the own ones' given these, and by how much they fall as these rise."""

    shared: Float[Array, " u"]
    own: Float[Array, "n d"]
    doubt: Float[Array, "u u"]
    own_doubt: Float[Array, "n d d"]
    follows: Float[Array, "n d u"]


def _told(inner: Float[Array, "n k k"], onto: Float[Array, "n k"], wide: int) -> _Told:
    """From the flights' normal equations in the shared numbers, the first `wide`, and their own."""
    own_doubt = np.linalg.inv(np.eye(inner.shape[1] - wide) + inner[:, wide:, wide:])
    follows = own_doubt @ inner[:, wide:, :wide]
    doubt = np.linalg.inv(np.eye(wide) + (inner[:, :wide, :wide] - inner[:, :wide, wide:] @ follows).sum(0))
    shared = doubt @ (onto[:, :wide] - np.einsum("ndu,nd->nu", follows, onto[:, wide:])).sum(0)
    own = np.einsum("nij,nj->ni", own_doubt, onto[:, wide:]) - follows @ shared
    return _Told(shared, own, doubt, own_doubt, follows)


def doubt_of(model: Launcher, belief: Belief, others: bool = True) -> Float[Array, "inputs u"]:
    """What is open, as numbers of unit variance to the layout's inputs: coefficients that the belief knows with their
    covariance, and (where `others`) other balls than its own, and a tracker's errors where there are samples."""
    layout, samples = model.layout, model.data.samples
    asked = np.flatnonzero(layout.source >= 0)
    root = np.linalg.cholesky(np.linalg.inv(layout.precision)[np.ix_(asked, asked)])
    seen = samples is not None and samples.real.any()
    sure = [not seen if is_tracker(one, model.catalogue) else believed_name(one.name) not in belief.names
            for one in (layout.columns[k] for k in asked)]
    root[sure] = 0.0
    balls = np.zeros(0) if layout.groups is None else layout.groups.scale * bool(belief.names) * others
    return np.asarray(block_diag(root, np.diag(balls)))
