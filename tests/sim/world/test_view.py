"""The camera's view: the place of the lens, and the direction of the target."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.world.calm import CALM, calm
from truearc.hw.emulated.nodes import View
from truearc.robot.config import schema as config
from truearc.robot.config.schema import load_config
from truearc.sim.world.options import Options
from truearc.sim.world.world import World


def project(view: View, point: tuple[float, float, float]) -> np.ndarray:
    return (view.camera_from_target @ np.array([*point, 1.0]))[:3]


@given(seed=st.integers(0, 1000), distance=st.floats(2.6, 8.0))
@settings(max_examples=30, deadline=None)
def test_the_view_is_rigid_and_the_lens_is_where_the_mounting_says(seed: int, distance: float) -> None:
    world = World(seed, Options(), distance)
    told = load_config(Path(config.__file__).parents[1] / "launcher.toml").camera
    transform = world.view().camera_from_target
    assert transform[:3, :3] @ transform[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1.0)
    lens = -transform[:3, :3].T @ transform[:3, 3]    # in target axes: right, up, towards the viewer
    pose = world.chassis.pose()
    assert lens[1] == pytest.approx(told.height_m - 2.27965)
    assert lens[2] == pytest.approx(distance + told.behind_exit_m * math.cos(pose.heading_rad))
    assert lens[0] == pytest.approx(-pose.y_m + told.behind_exit_m * math.sin(pose.heading_rad))


def test_a_robot_square_to_the_target_sees_it_upright_ahead_and_above() -> None:
    view = World(1, CALM, 5.0).view()
    centre, right, top = project(view, (0, 0, 0)), project(view, (0.3, 0, 0)), project(view, (0, 0.2, 0))
    assert centre[0] == pytest.approx(0.0, abs=1e-12)
    assert centre[2] > 0.0
    assert right[0] - centre[0] == pytest.approx(0.3)
    assert top[1] < centre[1]                         # y is down in the image
    pitch = math.degrees(math.atan2(-centre[1], centre[2])) + 24.0
    assert math.tan(math.radians(pitch)) == pytest.approx((2.27965 - 0.60) / 5.2)


def test_camera_options_reach_the_view() -> None:
    usual = World(1, CALM).view()
    assert (usual.focal_scale, usual.brightness) == (1.0, 1.0)
    odd = World(1, calm(camera_focal_scale=1.02, ring_light=0.4, camera_pitch_error_deg=1.0)).view()
    assert (odd.focal_scale, odd.brightness) == (1.02, 0.4)
    turned = odd.camera_from_target[:3, :3] @ usual.camera_from_target[:3, :3].T
    assert math.degrees(math.acos((np.trace(turned) - 1.0) / 2.0)) == pytest.approx(1.0, abs=1e-6)
    before, after = project(usual, (0, 0, 0)), project(odd, (0, 0, 0))
    assert after[1] / after[2] > before[1] / before[2]          # looking higher, the target sinks in the image
    lifted = World(1, calm(camera_height_m=0.8, camera_behind_exit_m=0.1, camera_pitch_deg=30.0)).view()
    lens = -lifted.camera_from_target[:3, :3].T @ lifted.camera_from_target[:3, 3]
    assert lens == pytest.approx([0.0, 0.8 - 2.27965, 4.1])
