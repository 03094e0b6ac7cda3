"""A team's log of shots with outcomes, and exits by phone clips."""

import math
from pathlib import Path

import pytest

from truearc.errors import InputError
from truearc_proof.importers.real_shots import import_ftc_decode, import_fuel_clips

LOG = """session,time_ms,set_rps,measured_rps,hood_position,distance_mm,result
2025_11_27__22_31_16_412,1764311194052,47.14,47.0,0.8,3341.5,good
2025_11_27__22_31_16_412,1764311204052,47.14,0.0,0.8,-1.0,good
2025_11_27__22_31_16_412,1764311254052,34.5,35.0,0.8,1984.9,under
2025_11_28__16_18_52_440,1764375440777,46.8,47.1,0.784,3529.9,over
"""


def test_a_log_of_shots_has_outcomes_session_and_day(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(LOG)
    dataset = import_ftc_decode(path)
    shots = dataset.shots
    assert shots.text("outcome") == ("two", "miss", "miss") and shots.text("side") == ("", "low", "high")
    assert shots.text("day") == ("2025_11_27", "2025_11_27", "2025_11_28")
    assert shots.number("t_s").tolist() == [0.0, 60.0, 0.0]
    assert shots.number("distance_m")[0] == pytest.approx(3.3415)
    assert shots.number("wheel_main_rad_s")[1] == pytest.approx(35.0 * 2.0 * math.pi)
    assert dataset.rig.target is not None and dataset.rig.target.hit_or_miss and dataset.rig.site
    assert dataset.left_out == ("1 shots without a speed or a distance",)
    path.write_text(LOG.replace("under", "short"))
    with pytest.raises(InputError, match=r"log\.csv:4.*result: 'short' is not one of good, over, under"):
        import_ftc_decode(path)


def test_clips_have_measured_exits(tmp_path: Path) -> None:
    path = tmp_path / "clips.csv"
    path.write_text("set_rps,exit_speed_m_s,exit_deg,lowest_rps_during_shot\n50,8.25,68.8,33.36\n")
    shots = import_fuel_clips(path).shots
    assert shots.number("exit_speed_m_s").tolist() == [8.25] and shots.number("exit_deg").tolist() == [68.8]
    assert shots.number("lowest_rad_s")[0] == pytest.approx(33.36 * 2.0 * math.pi)
