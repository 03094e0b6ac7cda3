"""Suggested gains against the loop's frequency response, dead time and all."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.robot.good_tick import CONFIG
from tests.sim.sysid.wheel import stair_record
from truearc.sim.sysid.fit import fit_law
from truearc.sim.sysid.motion import Record
from truearc.sim.sysid.sysid_text import fewest_rad_per_deg, flywheel_gains, hood_gains

FREQUENCIES = np.logspace(-2, 3.5, 4000) * 1j


def scaled(factor):
    """The stairs with efforts in other units: the same wheel, driven by torque."""
    record = stair_record(0.2)
    return fit_law(Record("stairs", "nm", record.effort_t_s, factor * record.effort, record.speed_t_s,
                          record.speed_rad_s), windage=False)


def sensitivity(loop):
    """The peak of |S|: how much the loop makes of a disturbance at worst; 1 / distance to -1."""
    return float(np.max(np.abs(1.0 / (1.0 + loop))))


@pytest.mark.parametrize("factor", [0.01, 0.3])
def test_the_flywheel_loop_keeps_its_distance_from_instability(factor):
    fit = scaled(factor)
    gains = flywheel_gains(fit, CONFIG)
    assert gains.dead_s == pytest.approx(0.03 + 0.01 + 0.0025, abs=0.002)
    s = FREQUENCIES
    plant = np.exp(-s * gains.dead_s) / (fit.value("ka") * s + fit.value("kv"))
    assert 1.3 < sensitivity((gains.kp + gains.ki / s) * plant) < 1.75
    assert sensitivity(3.5 * (gains.kp + gains.ki / s) * plant) > 3.0         # the check can fail


def test_the_hood_loop_keeps_its_distance_wherever_the_hood_is():
    fit = scaled(0.01)
    gains = hood_gains(fit, CONFIG)
    assert gains.ki == 0.0
    s = FREQUENCIES
    for share in (1.0, 0.8):                                      # turns of the screw per degree: the fewest, and more
        deg_per_rad = share / fewest_rad_per_deg(CONFIG)
        plant = deg_per_rad * np.exp(-s * gains.dead_s) / (fit.value("ka") * s**2 + fit.value("kv") * s)
        assert sensitivity((gains.kp + gains.kd * s) * plant) < 2.0


def test_the_fewest_turns_are_really_the_fewest():
    hood = CONFIG.hood
    turns = 2 * np.pi / hood.screw_lead_m / hood.screw_gear
    angle = np.radians(hood.included_deg + np.linspace(hood.low_deg, hood.high_deg, 500))
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    slopes = turns * np.radians(1.0) * a * b * np.sin(angle) / np.sqrt(a * a + b * b - 2 * a * b * np.cos(angle))
    assert fewest_rad_per_deg(CONFIG) == pytest.approx(slopes.min(), rel=0.01)


def test_a_wheel_without_friction_by_speed_still_gets_gains():
    fit = scaled(0.01)
    numbers = fit.numbers | {"kv": SimpleNamespace(name="kv", value=-1e-9, sd=0.0)}
    odd = SimpleNamespace(record=fit.record, law=fit.law, rows=fit.rows, covariance=fit.covariance, numbers=numbers,
                          value=lambda name: numbers[name].value)
    gains = flywheel_gains(odd, CONFIG)
    assert gains.kp > 0.0 and gains.ki == pytest.approx(gains.kp / (8.0 * gains.dead_s))
