"""The acme screw's linkage and the encoder's zero."""

import math
from pathlib import Path

import numpy as np
import pytest

from truearc import robot
from truearc.robot.config.schema import load_config
from truearc.robot.motors import elevation_from_encoder_deg, elevation_from_screw_deg, exit_distance_m, screw_length_m

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")


def test_screw_and_elevation_are_inverse_over_the_travel():
    hood = CONFIG.hood
    for elevation in np.linspace(hood.low_deg, hood.high_deg, 25):
        travel = screw_length_m(elevation, hood) - screw_length_m(hood.low_deg, hood)
        turned = travel / hood.screw_lead_m * 2 * math.pi / hood.screw_gear
        assert elevation_from_screw_deg(turned, hood) == pytest.approx(elevation, abs=1e-9)


def test_the_screw_length_is_the_distance_between_the_pivots():
    hood = CONFIG.hood
    angle = math.radians(hood.included_deg + 40.0)
    nut = hood.pivot_to_nut_m * np.array([math.cos(angle), math.sin(angle)])
    assert screw_length_m(40.0, hood) == pytest.approx(np.hypot(*(nut - [hood.pivot_to_motor_m, 0.0])), rel=1e-12)


def test_a_screw_beyond_its_linkage_is_unknown_not_wrong():
    assert elevation_from_screw_deg(1e4, CONFIG.hood) is None


def test_the_encoder_may_wrap_between_zero_and_the_hood():
    zero = CONFIG.hood_encoder.zero_deg
    for elevation in (-30.0, 0.0, 15.0, 75.0, 179.0):
        angle = math.radians((zero + elevation) % 360.0)
        assert elevation_from_encoder_deg(angle, CONFIG.hood_encoder, zero) == pytest.approx(elevation, abs=1e-9)


def test_the_exit_is_nearer_than_the_lens():
    assert exit_distance_m(5.0, CONFIG.camera) == 5.0 - CONFIG.camera.behind_exit_m
