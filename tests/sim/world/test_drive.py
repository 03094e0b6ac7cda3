import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from truearc.sim.world.drive import FLYWHEEL, STANDING_W, Battery, drive_motor, step_shaft
from truearc.sim.world.options import Options

INERTIA, VISCOUS, COULOMB = 6e-5, 1.5e-4, 0.02


def _integrated(speed: float, torque: float, dt: float) -> tuple[float, float]:
    """The same shaft by DOP853, switched where it stops."""
    def rate(_: float, state: np.ndarray) -> list[float]:
        return [(torque - direction * COULOMB - VISCOUS * state[0]) / INERTIA, state[0]]

    def stops(_: float, state: np.ndarray) -> float:
        return state[0]
    stops.terminal = True
    direction = np.sign(speed) if speed else np.sign(torque)
    if speed == 0.0:
        if abs(torque) <= COULOMB:
            return 0.0, 0.0
        found = solve_ivp(rate, (0.0, dt), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-13)
        return found.y[0, -1], found.y[1, -1]
    found = solve_ivp(rate, (0.0, dt), [speed, 0.0], method="DOP853", rtol=1e-11, atol=1e-13, events=stops)
    if found.t_events[0].size == 0:
        return found.y[0, -1], found.y[1, -1]
    after = _integrated(0.0, torque, dt - found.t[-1])
    return after[0], found.y[1, -1] + after[1]


@given(speed=st.one_of(st.just(0.0), st.floats(0.01, 500.0), st.floats(-500.0, -0.01)),
       torque=st.floats(-0.5, 0.5), dt=st.floats(1e-4, 0.1))
def test_a_shaft_turns_as_an_integrator_says(speed: float, torque: float, dt: float) -> None:
    turned = step_shaft(speed, torque, dt, INERTIA, VISCOUS, COULOMB)
    expected = _integrated(speed, torque, dt)
    assert turned[0] == pytest.approx(expected[0], rel=1e-6, abs=1e-5)
    assert turned[1] == pytest.approx(expected[1], rel=1e-6, abs=1e-7)


def test_a_shaft_that_is_pushed_less_than_it_sticks_stays() -> None:
    assert step_shaft(0.0, 0.019, 1.0, INERTIA, VISCOUS, COULOMB) == (0.0, 0.0)
    assert step_shaft(0.0, -0.021, 0.01, INERTIA, VISCOUS, COULOMB)[0] < 0.0


def test_the_motor_follows_its_data_sheet_at_twelve_volt() -> None:
    assert drive_motor(FLYWHEEL, 99.0, 0.0, 12.0, 1e4).torque_nm == pytest.approx(2.6)
    assert drive_motor(FLYWHEEL, 99.0, 594.0, 12.0, 1e4).torque_nm == pytest.approx(0.0, abs=1e-12)
    assert drive_motor(FLYWHEEL, 99.0, 297.0, 12.0, 1e4).torque_nm == pytest.approx(1.3)
    assert drive_motor(FLYWHEEL, 99.0, 594.0 * 11.0 / 12.0, 11.0, 1e4).torque_nm == pytest.approx(0.0, abs=1e-12)


@given(asked=st.floats(-3.0, 3.0), speed=st.floats(-700.0, 700.0), bus=st.floats(6.0, 14.0))
def test_the_driver_gives_no_more_than_asked_nor_than_its_limit(asked: float, speed: float, bus: float) -> None:
    drawn = drive_motor(FLYWHEEL, asked, speed, bus, 40.0)
    assert abs(drawn.torque_nm) <= abs(asked) + 1e-12
    assert drawn.torque_nm * asked >= 0.0
    assert abs(drawn.current_a) <= 40.0 + 1e-9
    heat = drawn.current_a**2 * FLYWHEEL.resistance_ohm
    assert drawn.power_w == pytest.approx(max(0.0, drawn.torque_nm * speed + heat), abs=1e-9)


def test_the_bus_sits_where_power_balances() -> None:
    supply = Battery(Options(battery_start_v=12.6, battery_resistance_ohm=0.03))
    supply.draw(600.0, 0.005)
    current = (12.6 - supply.bus_v) / 0.03
    assert supply.bus_v * current == pytest.approx(600.0 + STANDING_W)
    assert supply.bus_v > 6.3                         # the efficient one of the two solutions


def test_the_charge_runs_down_with_the_current() -> None:
    supply = Battery(Options(battery_resistance_ohm=0.0))
    for _ in range(1000):
        supply.draw(1000.0, 0.1)
    amperes = 1020.0 / 12.6                           # nearly constant; 100 s of it out of 18 Ah, 1.2 V in all
    assert 12.6 - supply.open_circuit_v == pytest.approx(1.2 * amperes * 100.0 / 64800.0, rel=0.02)
