"""The likelihood with every term of the catalogue at once: whatever --terms asks for has exact derivatives."""

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.infer.likelihood.observations import gather
from truearc.sim.infer.likelihood.shot_likelihood import Points, log_likelihood, narrow, opening_at, plane_of, values_at
from truearc.sim.infer.likelihood.track_likelihood import guess_lead
from truearc.sim.infer.parameters import make_model
from truearc.sim.physics.catalogue import TERMS, effective, flight_terms
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import classify, launch_of, predict

ADDED = tuple(term for term in TERMS if term.name not in ("gravity", "drag", "magnus"))
BELIEVED = {"gravity": {"scale": 1.0}, "drag": {"cd": 0.5}, "magnus": {"cl": 0.1}}
SILENT = ("wind_y", "ball_spread")    # across the flight, whose sideways part is left out; a ball's own is unknown


def _dataset() -> Dataset:
    """Shots that scatter by a hand's breadth about the middle of the target, two of them tracked."""
    n, rng = 8, np.random.default_rng(5)
    numbers = {"distance_m": rng.uniform(2.5, 4.5, n), "hood_deg": rng.uniform(45, 60, n),
               "motor_ratio": rng.uniform(0.4, 0.5, n), "battery_v": rng.uniform(11.5, 12.5, n),
               "t_s": np.cumsum(rng.uniform(0.3, 1.5, n)), "temperature_c": rng.uniform(10, 30, n),
               "robot_speed_m_s": rng.uniform(-1, 1, n)}
    shots = Shots(tuple(map(str, range(n))), numbers, {})
    height_m = predict(GUPPY, BELIEVED, shots).height_m
    numbers["miss_height_m"] = height_m - 2.44 + rng.normal(0.0, 0.1, n)
    numbers["miss_height_m"][4:] = np.nan
    rig = msgspec.structs.replace(GUPPY, target=Target(float(np.median(height_m)), 0.1, 0.4))
    outcome = tuple(classify(rig, height_m + rng.normal(0.0, 0.1, n)))
    tracked = [0, 3]
    flown = path(GUPPY, flight_terms(BELIEVED), BELIEVED, launch_of(GUPPY, shots.take(tracked)), 9, 0.05)
    x, z = (np.asarray(part).T.ravel() for part in (flown.position_m.x, flown.position_m.z))
    noise = rng.normal(0.0, 0.01, (2, len(x)))
    tracks = Tracks(np.repeat(tracked, 9), np.tile(np.arange(9) * 0.05, 2), x + noise[0], 0.0 * x, z + noise[1])
    return Dataset("made", rig, Shots(shots.shot_id, numbers, {"outcome": outcome}), tracks)


@pytest.fixture(scope="module")
def problem():
    dataset = _dataset()
    gathered = gather(dataset.facts, dataset)
    model = make_model(dataset.facts, tuple(term.name for term in TERMS), tracks=True)
    points = Points(guess_lead(gathered.evidence.tracks, gathered.evidence.given.rolling), jnp.zeros((0, 4)))
    at = np.array([one.u(0.5) if one.name == "drag.cd" else 0.0 for one in model.sought])
    return model, gathered.evidence, points, at


def _amplitude(name: str) -> str:
    return next((term.parameters[0].name for term in ADDED if term.name == name.partition(".")[0]), "")


@pytest.mark.slow
def test_gradients_are_those_of_differences(problem):
    model, evidence, points, at = problem
    value = jax.jit(lambda u: log_likelihood(model, evidence, points, u))
    along = jax.jit(lambda u, way: jax.jvp(lambda here: log_likelihood(model, evidence, points, here), (u,), (way,))[1])
    exact = np.stack([np.asarray(along(at, way)) for way in np.eye(len(at))], axis=1)
    assert np.isfinite(exact).all()
    step = 3e-3                       # the likelihood of a track is right to 1e-7 or so: its slopes are differences
    for index, name in enumerate(model.names):
        way = np.zeros(len(at))
        way[index] = step
        rough = (np.asarray(value(at + way)) - np.asarray(value(at - way))) / (2 * step)
        np.testing.assert_allclose(exact[:, index], rough, rtol=2e-3, atol=1e-4 * (1 + np.abs(rough).max()),
                                   err_msg=name)
        term, _, key = name.partition(".")
        if key == _amplitude(name) and term not in SILENT:
            assert np.abs(exact[:, index]).max() > 1e-6, name


@pytest.mark.slow
def test_heights_are_those_of_predict(problem):
    """The fit's flight over x and the simulator's over time, with a bit of every term but the tracker's."""
    model, evidence, points, at = problem
    moved = at + 0.3 * np.array([name.partition(".")[2] == _amplitude(name) for name in model.names])
    dataset = _dataset()
    launch = narrow(model, evidence._replace(tracks=None), points, moved)
    plane = plane_of(model, evidence.given, launch, moved)
    values = {name: {key: float(number) for key, number in table.items()}
              for name, table in values_at(model, moved).items()}
    wanted = predict(dataset.facts, values, dataset.shots, circumstances=circumstances_of(dataset)).height_m
    centre_m = float(opening_at(model, moved).centre_m)
    assert effective(values, circumstances_of(dataset))["battery_sag"]["sensitivity"].any()
    reached = np.isfinite(wanted)
    assert reached.sum() > 4
    np.testing.assert_allclose(np.asarray(plane.mean_m)[reached], wanted[reached] - centre_m, atol=1e-4)
