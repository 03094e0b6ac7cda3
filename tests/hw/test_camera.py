"""The emulated camera: a target out of sight; its pictures are seen by tests/robot."""

import numpy as np
import pytest

from truearc.hw.emulated.camera import Lens, Stage, TapeSize
from truearc.hw.emulated.nodes import View
from truearc_proof.world.camera_damage import Look, StagedCamera

TAPE = TapeSize(0.99695, 0.49885, 0.4318, 0.0508)
PINHOLE = Lens(640, 480, 699.4, 690.0, 325.0, 236.0)


def camera_at(tvec_m) -> StagedCamera:
    """Before the tape at `tvec_m` (camera axes), squarely facing it."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])            # target y up and z to the viewer; camera y down and z ahead
    pose[:3, 3] = tvec_m
    return StagedCamera(Stage(View(pose, 1.0, 1.0)), PINHOLE, TAPE, 1, look=Look(shake_px=0.0))


@pytest.mark.parametrize("tvec_m", [(0.0, 0.0, -4.0), (9.0, 0.0, 3.0), (0.0, 0.0, 0.1), (0.0, 0.0, 1e9)])
def test_a_target_out_of_sight_is_not_drawn(tvec_m):
    without, image = (camera_at(at).expose(0).image for at in ((0.0, 0.0, -4.0), tvec_m))
    assert image.shape == without.shape and np.mean(image != without) < 0.02
