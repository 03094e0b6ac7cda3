"""The likelihood of everything seen of shots, unit by unit, exact in its derivatives (JAX, forward mode).

A shot's launch deviates from its configuration by d ~ N(0, V): scatter from shot to shot (fitted) and the noise of hood
and wheels (rig.toml). Measurements of the launch, and then the track, narrow d; the height at the plane is then
normal, its mean flown from the narrowed launch, its variance by the height's exact slopes; marks are its likelihood.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from truearc.sim.data.conditions import Circumstances
from truearc.sim.infer.likelihood.heights import configured, height_at, speed_gain, with_numbers
from truearc.sim.infer.likelihood.launch_inputs import Given
from truearc.sim.infer.likelihood.observations import Observations
from truearc.sim.infer.likelihood.outcome_likelihood import fit_edges, log_marks, outcome_probabilities
from truearc.sim.infer.likelihood.track_likelihood import (
    FREE_SD,
    LEAD_SD_S,
    Look,
    TrackLinearization,
    launched,
    linear,
    loose,
)
from truearc.sim.infer.parameters import TRACK_NOISE, Model
from truearc.sim.physics.catalogue import arrival_terms, effective, flight_terms
from truearc.sim.physics.flight import Law, make_law
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.simulate import ORDINARY, opening_of, watch
from truearc.sim.physics.term import Opening

FLOOR_M = 0.005                       # of the height's deviation: what the model leaves out even of a perfect shot
FAR_M = -20.0                         # stands for the height of a ball that turned back, which can only have missed


class Points(NamedTuple):
    """Where tracks are linearised: deviations of launched flights [k, 3], starts of free ones [f, 4]."""

    launched: Float[Any, "k 3"]
    free: Float[Any, "f 4"]


class Narrowed(NamedTuple):
    """A launch's deviation [n] (log speed, elevation in rad) after all that was measured of it, as a normal one."""

    mean: Float[Any, "n 2"]
    covariance: Float[Any, "n 2 2"]
    log_likelihood: Float[Any, " n"]
    alone: Bool[Any, " n"]            # nothing was measured


class PlaneModel(NamedTuple):
    """Height above the opening's centre [n], normal."""

    mean_m: Float[Any, " n"]
    sd_m: Float[Any, " n"]


def log_likelihood(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"]) -> Float[Any, " units"]:
    """Log-likelihood of each unit, n launches and then f free flights."""
    launch = narrow(model, evidence, points, u)
    units = launch.log_likelihood
    if evidence.marks is not None:
        marks = evidence.marks
        if arrival_terms(model.terms, model.catalogue):
            assert model.facts.target is not None      # there are no marks without one
            marks = fit_edges(marks, model.facts.target, opening_at(model, u))
        units = units + log_marks(marks, *plane_of(model, evidence.given, launch, u))
    if evidence.free is None:
        return units
    return jnp.concatenate([units, free_tracks(model, evidence, points, u).log_likelihood])


@partial(jax.jit, static_argnames=("model",))
def outcome_table(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"]) -> Float[Any, "n 3"]:
    """P(miss, two, three) of the shots with a launch, by configuration alone: nothing measured of the launch."""
    evidence = evidence._replace(
        tracks=None, seen=evidence.seen._replace(speed_seen=jnp.zeros_like(evidence.seen.speed_seen),
                                                 elevation_seen=jnp.zeros_like(evidence.seen.elevation_seen)))
    plane = plane_of(model, evidence.given, narrow(model, evidence, points, u), u)
    return outcome_probabilities(opening_at(model, u), *plane)


def narrow(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"]) -> Narrowed:
    """What measured exits and tracks leave of each launch's deviation."""
    given, seen = evidence.given, evidence.seen
    values = values_at(model, u)
    exit = configured(model.facts, values, given, model.catalogue)[1]
    speed_var, elevation_var = _scatter(model, given, values, u)
    off = seen.log_speed - jnp.log(exit.speed_m_s), seen.elevation_rad - exit.elevation_rad
    speed = _update(speed_var, off[0], seen.log_speed_sd**2, seen.speed_seen)
    elevation = _update(elevation_var, off[1], seen.elevation_sd_rad**2, seen.elevation_seen)
    mean = jnp.stack([speed[0], elevation[0]], axis=1)
    covariance = jnp.stack([speed[1], elevation[1]], axis=1)[:, :, None] * jnp.eye(2)
    alone = jnp.asarray(~(seen.speed_seen | seen.elevation_seen))
    narrowed = Narrowed(mean, covariance, speed[2] + elevation[2], alone)
    if evidence.tracks is None:
        return narrowed
    row = evidence.tracks.row
    left = _track_update(model, evidence, points, u, exit, narrowed)
    return Narrowed(mean.at[row].set(left.mean[:, :2]), covariance.at[row].set(left.covariance[:, :2, :2]),
                    narrowed.log_likelihood.at[row].add(left.log_likelihood), alone.at[row].set(False))


def plane_of(model: Model, given: Given, launch: Narrowed, u: Float[Any, " p"]) -> PlaneModel:
    """Height above the opening's centre [n] of launches so narrowed, with the noise of spin and distance."""
    values = values_at(model, u)
    height = height_at(model.facts, values, given, model.catalogue, launch.mean[:, 0], launch.mean[:, 1])
    by_launch = height.by_launch[:, :2]
    variance = jnp.einsum("ni,nij,nj->n", by_launch, launch.covariance, by_launch) + FLOOR_M**2
    by_spin = height.by_launch[:, 2:] * given.wheel_spin_rev_s
    gain = speed_gain(model.facts, values, given, model.catalogue)
    by_speed = (by_launch[:, 0] * gain)[:, None] * given.wheel_log_speed
    variance = variance + (by_spin**2).sum(1) + jnp.where(launch.alone, 2.0 * (by_spin * by_speed).sum(1), 0.0)
    variance = variance + (height.by_distance * given.distance_sd_m)**2
    centre_m = opening_at(model, u).centre_m if model.facts.target else 0.0
    return PlaneModel(jnp.where(height.near, height.height_m - centre_m, FAR_M),
                 jnp.sqrt(jnp.where(height.near, variance, 1.0)))


def free_tracks(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"]) -> TrackLinearization:
    """Flights with an unknown launch, of which there must be some: their start is integrated out."""
    data = evidence.free
    assert data is not None
    law = _law(model, u, evidence.free_circumstances)
    k = points.free.shape[0]
    sd = jnp.broadcast_to(jnp.array(FREE_SD), (k, len(FREE_SD)))
    look = _tracker(model, u)
    return linear(lambda at: loose(law, evidence.free_spin_rev_s, at, data.time_s, look), data, points.free,
                  points.free, sd, _value(model, TRACK_NOISE, u))


def opening_at(model: Model, u: Float[Any, " p"]) -> Opening:
    """The opening that the ball has to pass at u; InputError when the rig has no target."""
    return opening_of(model.facts, effective(values_at(model, u), ORDINARY, model.catalogue), model.catalogue)


def values_at(model: Model, u: Float[Any, " p"]) -> dict[str, dict[str, Any]]:
    """{term: {parameter: value}} at u."""
    centre, sd = model.scales()
    count = len(model.numbers)
    return with_numbers(model.fixed(), model.numbers, centre[:count] + sd[:count] * u[:count])


def _scatter(model: Model, given: Given, values: dict[str, dict[str, Any]],
             u: Float[Any, " p"]) -> tuple[Float[Any, " n"], Float[Any, " n"]]:
    """Variances of log exit speed and of elevation before anything was measured of the launch."""
    speed, elevation_deg = (_value(model, name, u) for name in ("scatter.speed", "scatter.elevation_deg"))
    wheels = (speed_gain(model.facts, values, given, model.catalogue)[:, None] * given.wheel_log_speed)**2
    return (given.rolled * speed**2 + wheels.sum(1),
            given.hooded * jnp.radians(elevation_deg)**2 + given.elevation_sd_rad**2)


def _update(variance: Float[Any, " n"], off: Float[Any, " n"], noise: Float[Any, " n"],
            seen: Bool[Any, " n"]) -> tuple[Float[Any, " n"], Float[Any, " n"], Float[Any, " n"]]:
    """(mean, variance, log-likelihood) after measuring `off` with variance `noise`, where `seen`."""
    total = variance + noise
    share = jnp.where(seen, variance / total, 0.0)
    value = jnp.where(seen, -0.5 * (off**2 / total + jnp.log(2.0 * jnp.pi * total)), 0.0)
    return share * jnp.where(seen, off, 0.0), variance * (1.0 - share), value


def _track_update(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"], exit: Exit,
                  launch: Narrowed) -> TrackLinearization:
    data = evidence.tracks
    assert data is not None
    around = jax.tree.map(lambda part: jnp.broadcast_to(part, launch.alone.shape)[data.row],
                          evidence.given.circumstances)
    law, height_m = _law(model, u, around), model.facts.launcher.release_height_m
    mine = Exit(*(jnp.broadcast_to(part, launch.alone.shape)[data.row] for part in exit))
    lead = jnp.zeros((data.row.shape[0], 1))
    mean = jnp.concatenate([launch.mean[data.row], points.launched[:, 2:]], axis=1)
    variance = jnp.diagonal(launch.covariance, axis1=1, axis2=2)[data.row]
    sd = jnp.concatenate([jnp.sqrt(variance), lead + LEAD_SD_S], axis=1)
    look = _tracker(model, u)
    return linear(lambda at: launched(law, mine, height_m, at, data.time_s, look), data, points.launched, mean, sd,
                  _value(model, TRACK_NOISE, u))


def _law(model: Model, u: Float[Any, " p"], circumstances: Circumstances) -> Law:
    values = effective(values_at(model, u), circumstances, model.catalogue)
    return make_law(model.facts, flight_terms(model.terms, model.catalogue), values)


def _tracker(model: Model, u: Float[Any, " p"]) -> Look:
    return partial(watch, effective(values_at(model, u), ORDINARY, model.catalogue), among=model.catalogue)


def _value(model: Model, name: str, u: Float[Any, " p"]) -> Any:
    """A parameter in its own unit at u; 0 where the model has none of that name."""
    return next((one.value(u[index]) for index, one in enumerate(model.sought) if one.name == name), 0.0)


@partial(jax.jit, static_argnames=("model",))
def relinearise(model: Model, evidence: Observations, points: Points, u: Float[Any, " p"]) -> Points:
    """Points moved to each flight's most likely deviation at u, by one Gauss-Newton step."""
    launched_at, free_at = points
    if evidence.tracks is not None:
        bare = evidence._replace(tracks=None)
        values = values_at(model, u)
        exit = configured(model.facts, values, evidence.given, model.catalogue)[1]
        launched_at = _track_update(model, evidence, points, u, exit, narrow(model, bare, points, u)).mean
    if evidence.free is not None:
        free_at = free_tracks(model, evidence, points, u).mean
    return Points(launched_at, free_at)


@partial(jax.jit, static_argnames=("model",))
def objective(model: Model, evidence: Observations, points: Points, weight: Float[Any, " units"],
              u: Float[Any, " p"]) -> Float[Any, ""]:
    """Minus the log posterior, up to a constant; weight counts units."""
    return -(weight * log_likelihood(model, evidence, points, u)).sum() + 0.5 * (u**2).sum()


@partial(jax.jit, static_argnames=("model",))
def derivatives(model: Model, evidence: Observations, points: Points, weight: Float[Any, " units"],
                u: Float[Any, " p"]) -> tuple[Float[Any, ""], Float[Any, " p"], Float[Any, "p p"]]:
    """(value, gradient, Hessian) of the objective, exact."""
    def value(u: Float[Any, " p"]) -> Float[Any, ""]:
        return objective(model, evidence, points, weight, u)

    def slope(u: Float[Any, " p"]) -> tuple[Float[Any, " p"], tuple[Float[Any, ""], Float[Any, " p"]]]:
        gradient, at = jax.jacfwd(lambda u: (value(u),) * 2, has_aux=True)(u)
        return gradient, (at, gradient)

    hessian, (at, gradient) = jax.jacfwd(slope, has_aux=True)(u)
    return at, gradient, hessian
