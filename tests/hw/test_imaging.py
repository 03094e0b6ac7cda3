"""The emulated phone's pictures, against a pinhole worked out by hand and centroids of differences."""

from pathlib import Path

import numpy as np
import pytest

from truearc.hw.emulated.imaging.hall import SHEET_FROM_EXIT_M, RobotPose
from truearc.hw.emulated.imaging.phone import Path3D, Phone, SideCamera

av = pytest.importorskip("av")

LEVEL = Phone(tilt_deg=0.0, pitch_deg=0.0, bend=0.0, noise=0.5, quality=8)
POSE = RobotPose(-5.0, 0.0, 0.0)
EXIT_M, RADIUS_M = 0.75, 0.0889
SCALE_PX_M = LEVEL.width_px / LEVEL.view_m


def flight(begin_s: float = 0.5) -> Path3D:
    since = np.arange(0.0, 0.8, 0.005)
    places = np.column_stack([-5.0 + 4.0 * since, 0.0 * since, EXIT_M + 5.5 * since - 4.905 * since ** 2])
    return Path3D(3, begin_s + since, places, RADIUS_M, -2.0, POSE, (begin_s, begin_s + 0.8))


def filmed(path: Path, phone: Phone, *spans: tuple[float, float]) -> tuple[list, list[tuple[float, np.ndarray]]]:
    truth = SideCamera(phone, EXIT_M, 2.44, 1).film(path, [flight()], [(0.0, POSE)], spans or [(0.0, 0.1), (0.6, 1.0)])
    with av.open(str(path)) as container:
        return truth, [(float(frame.pts * frame.time_base), frame.to_ndarray(format="gray").astype(float))
                       for frame in container.decode(video=0)]


def test_ball_is_where_a_pinhole_puts_it(tmp_path):
    phone = Phone(**{**LEVEL.__dict__, "readout_s": 0.0, "exposure_s": 0.0005, "clock": 0.0})
    truth, frames = filmed(tmp_path / "a.mp4", phone)
    still = frames[0][1]
    for row in truth[3:-3:5]:
        since = row.time_s - 0.5
        x_px = 0.5 * (phone.width_px - 1) + SCALE_PX_M * (-5.0 + 4.0 * since - phone.place_m[0])
        y_px = 0.5 * (phone.height_px - 1) - SCALE_PX_M * (row.z_m - phone.place_m[2])
        assert (row.x_px, row.y_px) == (pytest.approx(x_px, abs=0.02), pytest.approx(y_px, abs=0.02))
        assert row.x_m == pytest.approx(4.0 * since, abs=1e-6)
        assert row.diameter_px == pytest.approx(2.0 * RADIUS_M * SCALE_PX_M, abs=0.01)
        picture = min(frames, key=lambda one: abs(one[0] - row.time_s))[1]
        rows, columns = np.nonzero(np.abs(picture - still) > 15.0)
        assert 0.5 * (columns.min() + columns.max()) == pytest.approx(x_px, abs=1.5)
        assert 0.5 * (rows.min() + rows.max()) == pytest.approx(y_px, abs=1.5)


def test_rolling_shutter_shows_low_rows_later(tmp_path):
    still, _ = filmed(tmp_path / "a.mp4", Phone(**{**LEVEL.__dict__, "readout_s": 0.0}), (0.5, 0.9))
    rolling, _ = filmed(tmp_path / "b.mp4", Phone(**{**LEVEL.__dict__, "readout_s": 0.016}), (0.5, 0.9))
    for one, other in zip(still, rolling, strict=True):
        late_s = 0.016 * (other.y_px / LEVEL.height_px - 0.5)
        assert other.x_px - one.x_px == pytest.approx(4.0 * SCALE_PX_M * late_s, abs=0.03)


def test_frames_are_missing_between_spans(tmp_path):
    _, frames = filmed(tmp_path / "a.mp4", LEVEL)
    steps = np.diff([time_s for time_s, _ in frames])
    assert np.sort(steps)[-1] == pytest.approx(0.5, abs=1.1 / LEVEL.rate_hz)
    assert np.sort(steps)[-2] == pytest.approx(1.0 / LEVEL.rate_hz, rel=0.01)


def test_sheet_is_seen_beside_the_exit(tmp_path):
    from truearc.sim.video.calibrate import find_sheet
    _, frames = filmed(tmp_path / "a.mp4", LEVEL, (0.0, 0.05))
    sheet = find_sheet(frames[0][1].astype(np.uint8), 0.0)
    x_px = 0.5 * (LEVEL.width_px - 1) + SCALE_PX_M * (-5.0 + SHEET_FROM_EXIT_M[0] - LEVEL.place_m[0])
    y_px = 0.5 * (LEVEL.height_px - 1) - SCALE_PX_M * (EXIT_M - LEVEL.place_m[2])
    assert (sheet.x_px, sheet.y_px) == (pytest.approx(x_px, abs=0.1), pytest.approx(y_px, abs=0.1))
    assert sheet.side_px == pytest.approx(0.24 * SCALE_PX_M, abs=0.2)
