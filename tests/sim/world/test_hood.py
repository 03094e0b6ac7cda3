import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.robot.config import schema as config
from truearc.robot.config.schema import load_config
from truearc.sim.world.drive import HOOD_COULOMB_NM, LEAD_M, Hood, elevation_deg, screw_rad
from truearc.sim.world.options import Options

DT = 0.005


def _run(hood: Hood, torque: float, seconds: float) -> float:
    """Push until `seconds` are over; the time at which the hood last moved."""
    moved = 0.0
    for tick in range(round(seconds / DT)):
        before = hood.elevation_deg
        hood.step(torque, DT)
        if hood.elevation_deg != before:
            moved = (tick + 1) * DT
    return moved


@given(st.floats(15.0, 75.0))
def test_the_screw_is_as_long_as_the_triangle_drawn_in_the_plane(elevation: float) -> None:
    motor = np.array([0.30, 0.0])
    angle = math.radians(30.0 + elevation)
    nut = 0.25 * np.array([math.cos(angle), math.sin(angle)])
    turns = np.linalg.norm(motor - nut) / 0.005
    assert screw_rad(elevation) == pytest.approx(2.0 * math.pi * turns, rel=1e-12)
    assert elevation_deg(screw_rad(elevation)) == pytest.approx(elevation, abs=1e-9)


def test_the_linkage_is_the_one_that_the_robot_is_told_of() -> None:
    told = load_config(Path(config.__file__).parents[1] / "launcher.toml").hood
    assert (told.pivot_to_motor_m, told.pivot_to_nut_m, told.included_deg, told.screw_lead_m) == (0.30, 0.25, 30.0,
                                                                                                  LEAD_M)
    assert (told.low_deg, told.high_deg, told.screw_gear) == (15.0, 75.0, 1.0)


@pytest.mark.parametrize("torque", [0.12, 0.2, 0.3])
def test_full_travel_takes_about_a_second(torque: float) -> None:
    hood = Hood(15.0, Options())
    seconds = _run(hood, torque, 4.0)
    assert 0.3 < seconds < 2.0
    assert hood.elevation_deg > 74.8


def test_the_stops_hold_and_the_switch_closes_near_the_lower_one() -> None:
    hood = Hood(40.0, Options())
    assert not hood.at_limit
    _run(hood, -0.1, 4.0)
    assert hood.at_limit
    assert 15.0 <= hood.elevation_deg <= 15.1
    below = hood.position_rad
    _run(hood, -0.3, 1.0)
    assert hood.position_rad == below
    _run(hood, 0.3, 4.0)
    assert 74.9 <= hood.elevation_deg <= 75.0
    assert not hood.at_limit


def test_the_motor_counts_from_switch_on_by_the_law_of_cosines() -> None:
    hood = Hood(50.0, Options(hood_backlash_deg=0.0))
    assert hood.position_rad == 0.0
    _run(hood, 0.1, 0.2)
    assert hood.elevation_deg > 52.0
    assert hood.position_rad == pytest.approx(screw_rad(hood.elevation_deg) - screw_rad(50.0), abs=1e-9)


def test_below_its_friction_nothing_moves() -> None:
    hood = Hood(50.0, Options())
    _run(hood, 0.99 * HOOD_COULOMB_NM, 1.0)
    assert (hood.elevation_deg, hood.position_rad) == (50.0, 0.0)


@pytest.mark.parametrize("play_deg", [0.0, 0.1, 0.8])
def test_reversing_loses_the_play(play_deg: float) -> None:
    hood = Hood(50.0, Options(hood_backlash_deg=play_deg))
    _run(hood, 0.1, 0.3)
    _run(hood, 0.0, 1.0)
    top_deg, top_rad = hood.elevation_deg, hood.position_rad
    assert elevation_deg(screw_rad(50.0) + top_rad) - top_deg == pytest.approx(play_deg / 2.0, abs=1e-9)
    _run(hood, -0.1, 0.3)
    _run(hood, 0.0, 1.0)
    nut_deg = elevation_deg(screw_rad(50.0) + hood.position_rad)
    assert hood.elevation_deg - nut_deg == pytest.approx(play_deg / 2.0, abs=1e-9)


def test_a_crooked_magnet_changes_only_what_the_encoder_says() -> None:
    straight, crooked = Hood(50.0, Options()), Hood(50.0, Options(hood_offset_deg=1.5))
    for hood in (straight, crooked):
        _run(hood, 0.1, 0.2)
    assert crooked.elevation_deg == straight.elevation_deg
    assert math.degrees(crooked.encoder_rad - straight.encoder_rad) == pytest.approx(1.5)
    assert math.degrees(straight.encoder_rad) == pytest.approx(straight.elevation_deg)
