import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from truearc.sim.world.field import Flight
from truearc.sim.world.options import Options
from truearc.sim.world.scene import Ball, Released

MASS, RADIUS, GRAVITY = 0.14, 0.0889, 9.81
BALL = Ball("b", MASS, RADIUS, 8000.0, 1.0, 1.0, 0.0, 0.0)
VACUUM = Options(air_density_kg_m3=0.0)
DISTANCE = 5.0


def _start(speed: float, deg: float, spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
           distance: float = DISTANCE) -> Released:
    angle = math.radians(deg)
    return Released(np.array([-distance, 0.0, 0.75]), speed * np.array([math.cos(angle), 0.0, math.sin(angle)]),
                    np.array(spin))


def _fly(options: Options, start: Released, dt: float = 0.005) -> Flight:
    flight = Flight(BALL, options, start)
    while flight.arrival is None:
        flight.step(dt)
    return flight


def _reference(start: Released, cd: float, magnus: float, wind: tuple[float, float, float], until: float,
               spin_drag: float = 0.0) -> np.ndarray:
    """Drag 1/2 Cd rho pi r^2 |u| u and Magnus C rho 4/3 pi r^3 w x u on the velocity u through the air, by DOP853."""
    rho = 1.2
    area, volume, inertia = math.pi * RADIUS**2, 4.0 / 3.0 * math.pi * RADIUS**3, 0.4 * MASS * RADIUS**2

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        through = state[3:6] - np.array(wind)
        spin = state[6:9]
        drag = (-0.5 * cd * rho * area * np.linalg.norm(through) - 6.0 * math.pi * 1.8e-5 * RADIUS) * through
        lift = magnus * rho * volume * np.cross(spin, through)
        second = 8.0 / 15.0 * math.pi * RADIUS**5                # MuJoCo's angular drag on a sphere
        slow = -(spin_drag * rho * second * np.linalg.norm(spin) + 8.0 * math.pi * 1.8e-5 * RADIUS**3) * spin / inertia
        return np.concatenate([state[3:6], (drag + lift) / MASS + np.array([0.0, 0.0, -GRAVITY]), slow])

    found = solve_ivp(rate, (0.0, until), np.concatenate(start), method="DOP853", rtol=1e-11, atol=1e-12)
    return found.y[:, -1]


@given(speed=st.floats(7.5, 15.0), deg=st.floats(15.0, 75.0))
@settings(max_examples=40, deadline=None)
def test_in_vacuum_a_ball_crosses_where_the_parabola_does(speed: float, deg: float) -> None:
    arrival = _fly(VACUUM, _start(speed, deg)).arrival
    assert arrival is not None
    after = DISTANCE / (speed * math.cos(math.radians(deg)))
    height = 0.75 + DISTANCE * math.tan(math.radians(deg)) - 0.5 * GRAVITY * after**2
    lands = (speed * math.sin(math.radians(deg))
             + math.sqrt((speed * math.sin(math.radians(deg)))**2 + 2.0 * GRAVITY * (0.75 - RADIUS))) / GRAVITY
    if arrival.z_m is None:
        assert height < RADIUS + 1e-6
        assert arrival.after_s == pytest.approx(lands, abs=1e-6)
    else:
        assert arrival.z_m == pytest.approx(height, abs=1e-7)
        assert arrival.after_s == pytest.approx(after, abs=1e-8)
        assert arrival.y_m == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("cd", "magnus", "wind"), [
    (0.5, 0.0, (0.0, 0.0, 0.0)), (0.0, 0.25, (0.0, 0.0, 0.0)), (0.5, 0.25, (0.0, 0.0, 0.0)),
    (0.9, -0.1, (0.0, 0.0, 0.0)), (0.5, 0.25, (-2.0, 1.0, 0.5))])
def test_the_fluid_forces_are_the_ones_that_are_stated(cd: float, magnus: float,
                                                        wind: tuple[float, float, float]) -> None:
    start = _start(12.0, 45.0, (3.0, -70.0, 8.0))
    options = Options(drag_coefficient=cd, magnus_coefficient=magnus, wind_x_m_s=wind[0], wind_y_m_s=wind[1],
                      wind_z_m_s=wind[2])
    flight = Flight(BALL, options, start)
    for _ in range(100):
        flight.step(0.005)
    expected = _reference(start, cd, magnus, wind, 0.5)
    assert flight.data.qpos[:3] == pytest.approx(expected[:3], abs=2e-6)
    assert flight.data.qvel[:3] == pytest.approx(expected[3:6], abs=1e-5)


def test_spin_drag_is_the_one_that_is_stated() -> None:
    start = _start(12.0, 45.0, (0.0, -70.0, 0.0))
    flight = Flight(BALL, Options(spin_drag_coefficient=2.0), start)
    for _ in range(100):
        flight.step(0.005)
    assert flight.data.qpos[:3] == pytest.approx(_reference(start, 0.5, 0.25, (0.0, 0.0, 0.0), 0.5, 2.0)[:3], abs=1e-5)


def test_backspin_lifts_and_sidespin_turns_by_the_right_hand() -> None:
    plain = _fly(Options(), _start(10.5, 45.0)).arrival
    back = _fly(Options(), _start(10.5, 45.0, (0.0, -60.0, 0.0))).arrival
    side = _fly(Options(), _start(10.5, 45.0, (0.0, 0.0, 30.0))).arrival
    assert plain is not None and back is not None and side is not None
    assert plain.z_m is not None and back.z_m is not None and side.y_m is not None
    assert back.z_m > plain.z_m + 0.3
    assert side.y_m > 0.1                             # z x (x cos, 0, ...) is +y: to the left


@pytest.mark.parametrize("dt", [0.0013, 0.005, 0.02])
def test_where_a_ball_arrives_does_not_hang_on_the_steps(dt: float) -> None:
    start = _start(11.0, 50.0, (0.0, -60.0, 0.0))
    fine, coarse = _fly(Options(), start, 0.0005).arrival, _fly(Options(), start, dt).arrival
    assert fine is not None and coarse is not None and fine.z_m is not None
    assert coarse.z_m == pytest.approx(fine.z_m, abs=1e-6)
    assert coarse.after_s == pytest.approx(fine.after_s, abs=1e-7)


def test_a_ball_that_turns_back_or_falls_short_never_crosses() -> None:
    for start in (_start(3.0, 45.0), _start(-3.0, 0.0)):
        arrival = _fly(Options(), start).arrival
        assert arrival is not None and arrival.z_m is None and arrival.y_m is None


def test_an_arrived_ball_stays_where_it_arrived() -> None:
    flight = _fly(Options(), _start(11.0, 50.0))
    place, arrival = flight.data.qpos[:3].copy(), flight.arrival
    flight.step(0.1)
    assert flight.arrival == arrival
    assert (flight.data.qpos[:3] == place).all()
