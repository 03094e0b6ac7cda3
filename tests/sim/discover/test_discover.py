"""Discovery from end to end: concealed effects found where they are, nothing found where there is nothing."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc
from robot.config import BadInput
from sim.discover.discover import Investigation, discover
from sim.discover.finding import make_json
from sim.discover.page import make_report
from sim.shots import Dataset, Shots, Tracks, save_dataset
from tests.sim.discover.worlds import World, fly, make_outcomes, make_tracks

BELIEVED = ("gravity", "drag")


@pytest.fixture(scope="module")
def lifted() -> Investigation:
    """Lift that follows the temperature, concealed in tracks."""
    return discover(make_tracks(World(lift_by_temperature=0.05), 30, 1), BELIEVED)


def test_lift_that_follows_a_covariate_is_found_in_flight(lifted: Investigation) -> None:
    finding = lifted.finding
    assert finding.mismatch.found and finding.verdict == "unknown"
    assert finding.data.level == "L2"
    where = finding.where
    assert (where.stage, where.direction, where.covariate) == ("flight", "vertical", "temperature_c")
    assert finding.unknown is not None and finding.fit is not None
    # 0.05 m/s2 a degree over the middle nine tenths of temperatures drawn with a deviation of 3 degrees
    assert finding.unknown.amplitude == pytest.approx(0.05 * 2.0 * 1.645 * 3.0, rel=0.3)
    assert finding.fit.gain_per_shot is not None and finding.fit.gain_se is not None
    assert finding.fit.gain_per_shot > 2.0 * finding.fit.gain_se > 0.0
    assert finding.data.fitted["tracks"]["drag.cd"] == pytest.approx(0.5, abs=0.03)


def test_a_crosswind_is_found_sideways_in_flight() -> None:
    where = discover(make_tracks(World(wind_m_s=1.5), 30, 2), BELIEVED).finding.where
    assert (where.stage, where.direction) == ("flight", "lateral")


def test_a_launcher_that_gives_less_speed_is_found_at_the_launch() -> None:
    finding = discover(make_tracks(World(efficiency=0.96), 30, 3)).finding
    assert (finding.where.stage, finding.where.direction, finding.where.covariate) == ("launch", "along", None)
    assert finding.unknown is not None
    assert finding.unknown.amplitude == pytest.approx(-0.04, abs=0.01)
    assert discover(make_tracks(World(efficiency=1.0), 30, 3)).finding.verdict == "none"


def test_a_drift_over_the_session_is_found_from_outcomes_with_sides() -> None:
    finding = discover(make_outcomes(World(speed_drift=0.06), 100, 4)).finding
    assert finding.mismatch.found and finding.data.level == "L0"
    assert finding.where.covariate in ("t_s", "order_in_session")
    assert {"t_s", "order_in_session"} <= {finding.where.covariate, *finding.where.inseparable}
    assert finding.where.stage_probability is not None
    assert sum(finding.where.stage_probability.values()) == pytest.approx(1.0)
    assert finding.fit is not None and finding.fit.accuracy_before is not None
    assert finding.fit.accuracy_after is not None
    assert finding.fit.accuracy_after > finding.fit.accuracy_before


def test_measured_heights_are_used_and_telemetry_makes_level_1() -> None:
    finding = discover(make_outcomes(World(measured=True, speed_by_battery=0.03), 100, 5)).finding
    assert finding.data.level == "L1"
    assert finding.where.covariate == "battery_v"
    assert finding.fit is not None and finding.fit.height_rmse_after_m is not None
    assert finding.fit.height_rmse_before_m is not None
    assert finding.fit.height_rmse_after_m < 0.7 * finding.fit.height_rmse_before_m


def test_the_same_seed_gives_the_same_answer() -> None:
    data = make_tracks(World(lift_by_temperature=0.02), 30, 6)
    first, second = (make_json(discover(data, BELIEVED, seed=9).finding) for _ in range(2))
    assert first == second


def test_the_answer_has_every_field_of_the_schema(lifted: Investigation) -> None:
    answer = json.loads(make_json(lifted.finding))
    assert answer["schema"] == "truearc.finding/1"
    assert {"data", "mismatch", "where", "what", "verdict", "set", "unknown", "fit", "next"} <= set(answer)
    assert {"shots", "level", "left_out"} <= set(answer["data"])
    assert {"found", "p_value", "false_alarm", "tests"} <= set(answer["mismatch"])
    assert {"stage", "stage_probability", "covariate", "direction", "region", "times_s"} <= set(answer["where"])
    assert set(answer["where"]["stage_probability"]) == {"sensing", "launch", "flight", "arrival"}
    assert {"covariate", "direction", "amplitude", "unit", "formula"} <= set(answer["unknown"])
    assert {"heldout_shots", "log_score_before", "log_score_after", "gain_per_shot", "gain_se", "height_rmse_before_m",
            "height_rmse_after_m", "accuracy_before", "accuracy_after"} <= set(answer["fit"])
    assert answer["what"] == [] and answer["next"] == [] and answer["unknown"]["formula"] is None


def test_the_report_says_the_verdict_first_and_fetches_nothing(lifted: Investigation) -> None:
    page = make_report("tracks <1>", lifted)
    assert page.index("in flight") < page.index("<img") < page.index("Fine print")
    assert page.count("data:image/png;base64,") == 2
    assert "tracks &lt;1&gt;" in page
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:)", page)


def test_data_that_can_say_nothing_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    save_dataset(tmp_path / "mute", Dataset("mute", make_outcomes(World(), 12, 0).facts, shots))
    out = tmp_path / "out.json"
    assert truearc.main(["discover", str(tmp_path / "mute"), "--quiet", "--json", str(out)]) == 0
    assert "cannot say anything" in capsys.readouterr().out
    answer = json.loads(out.read_text())
    assert answer["verdict"] == "none" and answer["mismatch"]["p_value"] is None and answer["fit"] is None


def test_all_outcomes_alike_are_no_mismatch() -> None:
    base = make_outcomes(World(speed_scatter=0.002, angle_scatter_deg=0.1, aim_spread=0.003), 100, 7)
    threes = np.array(base.shots.text("outcome")) == "three"
    assert threes.sum() > 80
    assert discover(replace(base, shots=base.shots.take(threes))).finding.verdict == "none"


@pytest.mark.filterwarnings("error")
def test_odd_but_honest_data_are_judged_without_a_stumble() -> None:
    rng = np.random.default_rng(8)
    t = np.linspace(0.0, 1.2, 20)
    fall = fly(np.array([0.0, 0.0, 10.0, 1e-4, 0.0, -0.5]), t, (0.5, 0.0, 0.0, 0.0, 0.0))
    falls = fall + rng.normal(0.0, 0.02, (14, *fall.shape))
    drops = Dataset("drops", make_tracks(World(), 10, 0).facts, Shots(tuple(map(str, range(14))), {}, {}),
                    Tracks(np.repeat(np.arange(14), 20), np.tile(t, 14), *falls.reshape(-1, 3).T))
    assert discover(drops, BELIEVED).finding.verdict == "none"
    # without drag a fall of 7 m ends 1.5 m too low: upright flight, so the push is along it, backwards
    missing = discover(drops, ("gravity",)).finding
    assert (missing.where.stage, missing.where.direction) == ("flight", "along")
    assert missing.unknown is not None and missing.unknown.amplitude < 0.0
    base = make_outcomes(World(), 100, 9)
    ratio = np.where(np.arange(100) < 20, 0.0, base.shots.number("motor_ratio"))
    stopped = {**base.shots.numbers, "motor_ratio": ratio}
    discover(replace(base, shots=replace(base.shots, numbers=stopped)))
    misses = discover(replace(base, shots=replace(base.shots, texts={"outcome": ("miss",) * 100}))).finding
    assert misses.data.shots == 100


def test_bad_input_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadInput, match="too few"):
        discover(make_tracks(World(), 6, 0), BELIEVED)
    with pytest.raises(BadInput, match="'magic'"):
        discover(make_tracks(World(), 12, 0), ("gravity", "magic"))
    save_dataset(tmp_path / "d", make_tracks(World(), 12, 0))
    (tmp_path / "d" / "tracks.csv").write_text("shot_id,t_s,x_m,y_m,z_m\nnobody,0,0,0,0\n")
    assert truearc.main(["discover", str(tmp_path / "d")]) == 2
    assert "tracks.csv:2: shot_id: 'nobody' is not among the shots" in capsys.readouterr().err
    (tmp_path / "d" / "rig.toml").unlink()
    assert truearc.main(["discover", str(tmp_path / "d")]) == 2
    assert "rig.toml" in capsys.readouterr().err
    assert truearc.main(["discover", str(tmp_path / "d"), "--false-alarm", "5"]) == 2
    assert "--false-alarm" in capsys.readouterr().err
