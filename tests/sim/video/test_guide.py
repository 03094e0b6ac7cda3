"""The guide: what a flight is worth against a worked sum, and a sheet that the tracker's detector reads."""

import re

import cv2
import numpy as np
import pytest

from truearc.sim.video.calibrate import find_sheet
from truearc.sim.video.guide import make_guide, sheet_svg, worth


def test_speed_is_as_uncertain_as_the_scale():
    near, far = worth(5.0, 60.0, 0.178), worth(15.0, 60.0, 0.178)
    assert near.width_m == pytest.approx(2 * 5.0 * np.tan(np.radians(26.0)))
    assert near.ball_px == pytest.approx(0.178 * 1920 / near.width_m)
    # 1 % of 7 m/s by where the sheet hangs, and 0.3 pixels of its side
    scale = np.hypot(0.01, 0.3 / (0.24 * 1920 / near.width_m))
    assert near.speed_m_s == pytest.approx(1.645 * 7.0 * scale, rel=0.15)
    assert near.speed_m_s < far.speed_m_s and near.height_m < far.height_m
    without = worth(5.0, 60.0, 0.178, has_sheet=False)
    assert without.speed_m_s > 1.5 * near.speed_m_s


def test_small_ball_is_refused_with_the_reason():
    assert "5 are needed" in worth(15.0, 60.0, 0.03).reason
    assert "pixels wide" in make_guide(0.03)


def test_sheet_in_the_page_is_the_trackers():
    picture = np.full((297, 420), 255, np.uint8)
    for cell in re.findall(r'<rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)"', sheet_svg()):
        x, y, side = (round(float(value)) for value in cell)
        picture[y:y + side, x:x + side] = 0
    sheet = find_sheet(cv2.GaussianBlur(picture, (0, 0), 0.7), 0.0)
    assert sheet is not None and sheet.side_px == pytest.approx(240.0, abs=1.0)
    assert (sheet.x_px, sheet.y_px) == (pytest.approx(209.5, abs=1.0), pytest.approx(148.0, abs=1.0))
