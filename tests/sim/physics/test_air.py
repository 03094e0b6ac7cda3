"""Flights with every term of the air at work, against SciPy's DOP853 of equations written out here and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.sim.physics.rigs import GUPPY
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import fly, make_law, path, reach_plane, start_of
from truearc.sim.physics.term import Exit

M, R, RHO, G, UP = 0.14, 0.0889, 1.2, 9.81, 0.75
AREA, VOLUME = np.pi * R**2, 4 / 3 * np.pi * R**3
TERMS = flight_terms((
    "gravity", "drag", "magnus", "spin_decay", "wind_x", "wind_y", "wind_z", "spin_drag", "drag_reynolds",
    "lift_saturation", "drag_wear", "air_density", "buoyancy", "added_mass"))
# amplitude of each, and of all at once; drag_wear and air_density: age and density already multiplied in
AMPLITUDES = {"spin_decay": 0.8, "wind_x": 1.5, "wind_y": -2.0, "wind_z": 0.7, "spin_drag": 0.6, "drag_reynolds": -0.4,
              "lift_saturation": 1.3, "drag_wear": 0.12, "air_density": 0.07, "buoyancy": 1.0, "added_mass": 1.0}
CASES = {**{name: {name: size} for name, size in AMPLITUDES.items()}, "none": {}, "all": AMPLITUDES,
         "known": {"buoyancy": 1.0, "added_mass": 1.0}}
CD, CL, SPEED, ELEVATION, SPIN, STEP_S, STEPS = 0.6, 0.12, 11.0, 0.9, 6.0, 0.002, 450


def _rates(t, state, e):
    """The equations of motion; e: amplitudes."""
    velocity = state[3:]
    through = velocity - np.array([e("wind_x"), e("wind_y"), e("wind_z")])
    spin = np.array([0.0, -SPIN, 0.0]) * np.exp(-e("spin_decay") * t)
    v = np.linalg.norm(through)
    s = 2 * np.pi * R * np.linalg.norm(spin) / v
    cd = CD * (1 + e("drag_reynolds") * (v / 10.0 - 1) + e("drag_wear")) + e("spin_drag") * s**2
    lift = CL / (1 + e("lift_saturation") * s)
    rho = RHO * (1 + e("air_density"))
    force = (-0.5 * rho * AREA * cd * v * through + lift * 16 / 3 * np.pi**2 * R**3 * rho * np.cross(spin, through)
             + np.array([0, 0, -M * G + e("buoyancy") * RHO * VOLUME * G]))
    return np.concatenate([velocity, force / (M + e("added_mass") * RHO * VOLUME / 2)])


def _params(amplitudes):
    first = {term.name: term.parameters[0].name for term in TERMS}
    return {"gravity": {"scale": 1.0}, "drag": {"cd": CD}, "magnus": {"cl": CL},
            **{name: {first[name]: amplitudes.get(name, 0.0)} for name in AMPLITUDES}}


def _dop853(amplitudes, **more):
    start = [0.0, 0.0, UP, SPEED * np.cos(ELEVATION), 0.0, SPEED * np.sin(ELEVATION)]
    return solve_ivp(_rates, (0.0, STEP_S * STEPS), start, "DOP853", rtol=1e-11, atol=1e-12,
                     args=(lambda name: amplitudes.get(name, 0.0),), **more)


@pytest.mark.parametrize("case", CASES)
def test_paths_are_those_of_dop853(case):
    exit = Exit(SPEED, ELEVATION, SPIN)
    flown = path(GUPPY, TERMS, _params(CASES[case]), exit, points=STEPS + 1, step_s=STEP_S)
    times = np.arange(STEPS + 1) * STEP_S
    wanted = _dop853(CASES[case], t_eval=times[::50])
    ours = np.stack([np.asarray(part)[::50] for part in (*flown.position_m, *flown.velocity_m_s)])
    np.testing.assert_allclose(ours, wanted.y, atol=2e-8)
    np.testing.assert_allclose(flown.time_s, times, atol=1e-12)
    if case != "none":                                # each shows: none of the agreement is by absence
        assert np.abs(wanted.y - _dop853({}, t_eval=times[::50]).y).max() > 1e-3


@pytest.mark.parametrize("case", ["spin_decay", "wind_y", "all"])
def test_planes_are_met_where_dop853_meets_them(case):
    def plane(t, state, e):
        return state[0] - 3.0

    plane.terminal = True
    wanted = _dop853(CASES[case], events=plane).y_events[0][0]
    exit, params = Exit(np.array([SPEED]), ELEVATION, SPIN), _params(CASES[case])
    assert float(fly(GUPPY, TERMS, params, exit, 3.0).height_m[0]) == pytest.approx(wanted[2], abs=2e-8)
    over = reach_plane(GUPPY, make_law(GUPPY, TERMS, params), exit, np.array([3.0]))
    assert float(over.height_m[0]) == pytest.approx(wanted[2], abs=2e-6)
    assert float(over.climb[0]) == pytest.approx(wanted[5] / wanted[3], abs=1e-5)


def test_flights_in_the_plane_stay_there():
    """Without wind across, the flight costs two dimensions, as before."""
    terms = tuple(term for term in TERMS if term.name != "wind_y")
    params = {name: values for name, values in _params(AMPLITUDES).items() if name != "wind_y"}
    law = make_law(GUPPY, terms, params)
    pushed = law(start_of(GUPPY, Exit(np.array([SPEED]), ELEVATION, SPIN), (1,)))
    assert isinstance(pushed.y, float)
    assert pushed.y == 0.0
