"""The emulated camera: its rate and latency, and a target out of sight; its pictures are seen by tests/robot."""

import numpy as np
import pytest

from truearc.hw.emulated.camera import Lens, Stage, TapeSize
from truearc.hw.emulated.nodes import View
from truearc_proof.world.camera_damage import USUAL, Look, StagedCamera

TAPE = TapeSize(0.99695, 0.49885, 0.4318, 0.0508)
PINHOLE = Lens(640, 480, 699.4, 690.0, 325.0, 236.0)
FRAME_NS = 50_000_000


def camera_at(tvec_m, latency_s: float = 0.0, look: Look = USUAL) -> StagedCamera:
    """Before the tape at `tvec_m` (camera axes), squarely facing it."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])            # target y up and z to the viewer; camera y down and z ahead
    pose[:3, 3] = tvec_m
    return StagedCamera(Stage(View(pose, 1.0, 1.0)), PINHOLE, TAPE, 20.0, latency_s, 1, look=look)


@pytest.mark.parametrize("tvec_m", [(0.0, 0.0, -4.0), (9.0, 0.0, 3.0), (0.0, 0.0, 0.1), (0.0, 0.0, 1e9)])
def test_a_target_out_of_sight_is_not_drawn(tvec_m):
    without, image = (camera_at(at, look=Look(shake_px=0.0)).expose(0).image for at in ((0.0, 0.0, -4.0), tvec_m))
    assert image.shape == without.shape and np.mean(image != without) < 0.02


def test_rate_latency_newest_only_and_no_making_up_for_late_steps():
    camera = camera_at((0.0, 0.0, 4.0), 0.03)
    stamps, ages = [], []
    for t_ns in range(10**9, 2 * 10**9, 5_000_000):
        camera.step(t_ns)
        frame = camera.read()
        if frame is not None:
            stamps.append(frame.t_ns)
            ages.append(t_ns - frame.t_ns)
    assert np.all(np.diff(stamps) == FRAME_NS) and len(stamps) == 20 and set(ages) == {30_000_000}
    for t_ns in range(2 * 10**9, 2 * 10**9 + 400_000_000, 5_000_000):
        camera.step(t_ns)
    newest = camera.read()
    assert newest is not None and newest.t_ns == 2 * 10**9 + 350_000_000 and camera.read() is None
    camera = camera_at((0.0, 0.0, 4.0))
    got = 0
    for t_ns in (0, 1_000_000_000, 1_010_000_000, 1_050_000_000):
        camera.step(t_ns)
        got += camera.read() is not None
    assert got == 3
