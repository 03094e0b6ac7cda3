"""Formulas for curves, on evidence in which the amplitude of every shot is seen with known noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian, stand_in
from tests.sim.discover.straight import take_straight
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.free_curve import correct
from truearc.sim.discover.detect.test_battery import Test
from truearc.sim.discover.report.formula import find_formula
from truearc.sim.infer.baseline_fit import BaselineFit
from truearc.sim.physics.launch import Exit

N = 300
BALL_KG, BALL_M, DENSITY = 0.2, 0.1, 1.2


def formula_of(what: Any, truth: np.ndarray, noise: float, unit: str = "1", speed: Any = 8.0,
               spin: Any = 0.0) -> str | None:
    """The formula for amplitudes `truth` [n] seen with this noise."""
    rng = np.random.default_rng(0)
    seen = (truth + noise * rng.normal(size=N)) / noise
    evidence = gaussian(seen, np.full((N, 1), 1.0 / noise), (replace(column("launch speed"), unit=unit),))
    found = correct(evidence, Test("free", 0, what, "straight", np.ones(N)))
    intake = take_straight(np.zeros(N))
    zero = np.zeros(N)
    lanes = intake.lanes._replace(rolling=Exit(zero + speed, zero, zero + spin, zero), ball_kg=zero + BALL_KG,
                                  ball_m=zero + BALL_M)
    fitted = stand_in(BaselineFit, intake=replace(intake, lanes=lanes), together=np.arange(N))
    return find_formula(found, fitted, 0)


def covariate(name: str, low: float, high: float) -> Covariate:
    return Covariate(((name, np.random.default_rng(1).uniform(low, high, N)),))


def test_a_power_is_found_with_its_factor_in_units_of_the_median() -> None:
    what = covariate("distance_m", 1.0, 9.0)
    scale = float(f"{np.median(what.values):.2g}")
    found = formula_of(what, -0.05 + 0.2 * (what.values / scale)**2, 0.02)
    assert found is not None
    assert f"(distance_m / {scale:g} m)^2" in found
    constant, _, factor = found.removeprefix("launch speed = ").split(" ")[:3]
    assert float(constant) == pytest.approx(-0.05, abs=0.005)
    assert float(factor) == pytest.approx(0.2, abs=0.005)


def test_temperatures_count_from_absolute_zero() -> None:
    what = covariate("temperature_c", 0.0, 40.0)
    found = formula_of(what, 3.0 * (what.values + 273.15) / 290.0, 0.005)
    assert found is None or "K)" in found


def test_powers_that_the_shots_cannot_part_are_not_told() -> None:
    what = covariate("distance_m", 4.0, 5.0)
    assert formula_of(what, 0.1 * (what.values / 4.5)**2, 0.05) is None


def test_a_step_is_no_power() -> None:
    what = covariate("distance_m", 1.0, 9.0)
    assert formula_of(what, 0.3 * (what.values > 6.0), 0.02) is None


def test_groups_have_no_formula() -> None:
    codes = np.arange(N) % 2
    assert formula_of(Factor("supplier", ("north", "south"), codes), 0.3 * codes, 0.02) is None


def test_a_push_goes_with_the_spin_parameter_and_the_airs_pressure() -> None:
    rng = np.random.default_rng(2)
    speed, spin = rng.uniform(5.0, 12.0, N), rng.uniform(1.0, 9.0, N)
    pressure = 0.5 * DENSITY * np.pi * BALL_M**2 * speed**2 / BALL_KG
    lift = 0.8 * (2.0 * np.pi * spin * BALL_M / speed) * pressure
    found = formula_of(Covariate((("exit_spin_rev_s", spin),)), lift, 0.05, "m/s2", speed, spin)
    assert found is not None
    assert "0.8 S rho A v^2 / 2 m" in found
