"""The emulated camera against OpenCV's own projection and polygon filling; one that repeats its image is lost."""


import cv2
import numpy as np
import pytest

from truearc.hw.emulated.camera import Lens, TapeSize, distort, outline_m
from truearc.hw.emulated.nodes import View
from truearc_proof.world.camera_damage import Look, StagedCamera

TAPE = TapeSize(0.99695, 0.49885, 0.4318, 0.0508)
PINHOLE = Lens(640, 480, 699.4, 690.0, 325.0, 236.0)
WIDE = Lens(640, 480, 500.0, 505.0, 330.0, 230.0, (-0.25, 0.08, 0.001, -0.0015, -0.01))
FRAME_NS = 50_000_000


class Still:
    """A plant of which the camera sees one thing."""

    def __init__(self, view: View) -> None:
        self.now = view

    def view(self) -> View:
        return self.now


def make_view(rvec, tvec_m, focal_scale: float = 1.0, brightness: float = 1.0) -> View:
    """The tape at `tvec_m` (camera axes), turned by `rvec` from facing the camera squarely."""
    facing = np.diag([1.0, -1.0, -1.0])               # target y up and z to the viewer; camera y down and z ahead
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array(rvec, dtype=float))[0] @ facing
    pose[:3, 3] = tvec_m
    return View(pose, focal_scale, brightness)


def project_by_opencv(points_m, view: View, lens: Lens):
    matrix = np.array([[lens.fx_px * view.focal_scale, 0, lens.cx_px], [0, lens.fy_px * view.focal_scale, lens.cy_px],
                       [0, 0, 1]])
    rvec, _ = cv2.Rodrigues(view.camera_from_target[:3, :3])
    seen, _ = cv2.projectPoints(points_m, rvec, view.camera_from_target[:3, 3], matrix, np.array(lens.distortion))
    return seen.reshape(-1, 2)


def picture(view: View, lens: Lens = PINHOLE, seed: int = 1, shake_px: float = 0.0):
    camera = StagedCamera(Still(view), lens, TAPE, 20.0, 0.0, seed, look=Look(shake_px=shake_px))
    camera.step(0)
    frame = camera.read()
    assert frame is not None
    return frame.image


def test_outline_is_half_a_regular_hexagon_of_two_inch_tape():
    outline = outline_m(TAPE)
    outer, inner = outline[:4], outline[4:]
    assert outer[0] == pytest.approx([0.249425, -0.2159, 0.0]) and outer[3] == pytest.approx([0.498475, 0.2159, 0.0])
    assert np.linalg.norm(outer[3] - outer[0]) == pytest.approx(TAPE.bottom_width_m, rel=2e-3)      # equal sides
    for a, b in ((0, 1), (1, 2), (3, 0)):                                                           # tape of one width
        along = (outer[b] - outer[a]) / np.linalg.norm(outer[b] - outer[a])
        for corner in (inner[a], inner[b]):
            assert np.linalg.norm(np.cross(along, corner - outer[a])) == pytest.approx(0.0508, abs=1e-9)
    assert inner[2][1] == inner[3][1] == outer[2][1]                                                # cut level on top


@pytest.mark.parametrize("lens", [PINHOLE, WIDE])
def test_distortion_is_opencv_s(lens):
    points = np.random.default_rng(1).uniform((-1, -0.8, 1), (1, 0.8, 1), (200, 3))
    view = View(np.eye(4), 1.0, 1.0)
    flat = Lens(lens.width_px, lens.height_px, lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px)
    assert distort(project_by_opencv(points, view, flat), lens) == pytest.approx(
        project_by_opencv(points, view, lens), abs=1e-9)


@pytest.mark.parametrize("tvec_m", [(0.0, 0.0, -4.0), (9.0, 0.0, 3.0), (0.0, 0.0, 0.1), (0.0, 0.0, 1e9)])
def test_a_target_out_of_sight_is_not_drawn(tvec_m):
    without = picture(make_view((0, 0, 0), (0.0, 0.0, -4.0)))
    image = picture(make_view((0, 0, 0), tvec_m))
    assert image.shape == without.shape and np.mean(image != without) < 0.02


def test_rate_latency_newest_only_and_no_making_up_for_late_steps():
    camera = StagedCamera(Still(make_view((0, 0, 0), (0, 0, 4.0))), PINHOLE, TAPE, 20.0, 0.03, 1)
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
    camera = StagedCamera(Still(make_view((0, 0, 0), (0, 0, 4.0))), PINHOLE, TAPE, 20.0, 0.0, 1)
    got = 0
    for t_ns in (0, 1_000_000_000, 1_010_000_000, 1_050_000_000):
        camera.step(t_ns)
        got += camera.read() is not None
    assert got == 3
