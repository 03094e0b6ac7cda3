"""truearc fit, predict and paper fit as a user with a spreadsheet meets them."""

import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest

import truearc.sim.infer.fit
from tests.sim.discover.made import column, gaussian
from tests.sim.infer.independent import make_dataset
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.cli.main import main
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import hash_dataset, load_dataset, save_dataset
from truearc.sim.infer.belief import load_belief
from truearc.sim.infer.fit_report import CrossValidation, say_estimates, say_prediction, say_tracker_errors
from truearc.sim.infer.intervals import ProfileInterval, tracker_errors
from truearc.sim.infer.launcher import ODD, Sought, odd_places
from truearc.sim.physics.catalogue import catalogue, find_parameter
from truearc.sim.physics.term import from_scale, to_scale

TERMS = "drag,magnus,exit_efficiency"


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp("shots") / "d"
    save_dataset(path, make_dataset(11, 100, side=True))
    return path


def test_a_fit_is_told_in_words_and_written_as_a_belief(directory, tmp_path, capsys):
    out = tmp_path / "coefficients.toml"
    arguments = ["fit", str(directory), "--terms", TERMS, "-o", str(out), "--quiet"]
    assert main(arguments) == 0
    said, errors = capsys.readouterr()
    assert errors == ""
    for words in ("fitted to 100 of 100 shots", "100 outcomes", "drag coefficient", "90 % interval",
                  "from shot to shot the height at", "held out (100 in", "hard to tell apart"):
        assert words in said, words
    belief = load_belief(out)
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency"}
    assert set(belief.scatter) == {"speed", "elevation_deg"}
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    provenance = load_belief(out).provenance
    assert (provenance["method"], provenance["dataset_sha256"]) == ("ml", hash_dataset(load_dataset(directory)))
    low, high = provenance["interval90"]["drag.cd"]
    assert low < belief.coefficients["drag"]["cd"] < high
    assert main(["predict", str(directory), "--coefficients", str(out), "-o", str(tmp_path / "p.csv")]) == 0


def test_a_fit_that_does_not_settle_writes_nothing(directory, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(truearc.sim.infer.fit, "ROUNDS", 1)
    out = tmp_path / "coefficients.toml"
    assert main(["fit", str(directory), "--terms", TERMS, "-o", str(out), "--quiet"]) == 1
    assert "did not settle" in capsys.readouterr().err
    assert not out.exists()


ROWS = [(3.0, 0.5, 50.0), (15.0, 0.3, 40.0), (4.0, 0.6, 60.0), (2.0, 0.45, 60.0)]
OUTCOMES = ("three", "miss", "two", "three")


@pytest.fixture
def home(tmp_path):
    columns = dict(zip(("distance_m", "motor_ratio", "hood_deg"), np.array(ROWS).T, strict=True))
    shots = Shots(("a", "b,c", "d", "e"), columns, {"outcome": OUTCOMES})
    save_dataset(tmp_path / "shots", Dataset("shots", GUPPY, shots))
    return tmp_path / "shots"


def test_predict_prints_the_columns_of_formats_md(home, capsys):
    assert main(["predict", str(home), "--cd", "0.91", "--cl", "0.06"]) == 0
    printed = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["shot_id"] for row in printed] == ["a", "b,c", "d", "e"]
    assert list(printed[0]) == ["shot_id", "height_m", "deviation_m", "outcome", "note"]
    for row, shot in zip(printed, ROWS, strict=True):
        height_m = reference.integrate(*shot, 0.91, 0.06).height_m
        if np.isnan(height_m):
            assert (row["height_m"], row["deviation_m"], row["outcome"]) == ("", "", "miss")
        else:
            assert float(row["height_m"]) == pytest.approx(height_m, abs=1e-5)
            assert float(row["deviation_m"]) == pytest.approx(height_m - 2.44, abs=1e-5)
    assert printed[1]["height_m"] == ""


def test_fit_writes_what_predict_reads(home, tmp_path, capsys):
    out, grid = tmp_path / "coefficients.toml", tmp_path / "map.npz"
    assert main(["paper", "fit", str(home), "--step", "0.5", "-o", str(out), "--map", str(grid), "--quiet"]) == 0
    printed = capsys.readouterr()
    assert "11 x 11" in printed.out
    assert printed.err == ""
    chosen = load_belief(out).coefficients
    saved = np.load(grid)
    at = (round(chosen["drag"]["cd"] / 0.5), round(chosen["magnus"]["cl"] / 0.5))
    assert saved["tied"][at]
    assert saved["share_three"][at] == saved["share_three"].max()
    assert load_belief(out).provenance["dataset_sha256"] == hash_dataset(load_dataset(home))
    assert load_belief(out).provenance["tied_pairs"] == saved["tied"].sum()
    assert main(["predict", str(home), "--coefficients", str(out), "-o", str(tmp_path / "p.csv")]) == 0
    assert main(["predict", str(home), "--cd", str(chosen["drag"]["cd"]), "--cl", str(chosen["magnus"]["cl"])]) == 0
    assert capsys.readouterr().out == (tmp_path / "p.csv").read_text()


@pytest.mark.parametrize(("column", "message"), [
    ("hood_deg", "hood_deg or exit_deg is needed, and no shot has it"),
    ("distance_m", "distance_m is needed, and no shot has it"),
    ("motor_ratio", "motor_ratio (with launcher.free_speed_rad_s in rig.toml), every wheel_<name>_rad_s, or"),
    ("outcome", "outcome: fit by grid needs at least one shot whose outcome is three")])
def test_a_column_that_is_not_there_is_named_with_its_file(home, capsys, column, message):
    path = home / "shots.csv"
    path.write_text(path.read_text().replace(column, "unheard_of"))
    assert main(["paper", "fit", str(home), "--quiet"]) == 2
    assert f"truearc paper fit: {path}: {message}" in capsys.readouterr().err


def test_fit_says_what_it_found_and_where_to_be_careful(home, tmp_path, capsys):
    """Four shots: the tied pairs are listed, and one or two three-pointers are called few."""
    tied, picture = tmp_path / "tied.csv", tmp_path / "map.png"
    assert main(["paper", "fit", str(home), "--step", "0.1", "--tied", str(tied), "--picture", str(picture),
                 "--quiet"]) == 0
    said = capsys.readouterr().out
    rows = list(csv.DictReader(tied.open()))
    assert f"{len(rows)} pairs do so equally well (tied)" in said
    assert "chosen: cd {:.3f}, cl {:.3f}".format(float(rows[0]["cd"]), float(rows[0]["cl"])) in said
    means = [float(row["mean_deviation_m"]) for row in rows]
    assert means == sorted(means)
    for row in rows[:3]:
        off_m = [abs(reference.integrate(*shot, float(row["cd"]), float(row["cl"])).height_m - 2.44)
                 for shot, outcome in zip(ROWS, OUTCOMES, strict=True) if outcome == "three"]
        assert float(row["mean_deviation_m"]) == pytest.approx(np.mean(off_m), abs=1e-5)
    assert "warning: only 2 three-pointers" in said
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_fit_in_words_when_no_pair_reaches_all(tmp_path, capsys):
    """One three-pointer no drag and lift can have flown: never `inf`, and no deviation in the file."""
    rows = [*ROWS[:1], (16.0, 0.1, 20.0)]
    columns = dict(zip(("distance_m", "motor_ratio", "hood_deg"), np.array(rows).T, strict=True))
    save_dataset(tmp_path / "odd", Dataset("odd", GUPPY, Shots(("a", "b"), columns, {"outcome": ("three",) * 2})))
    out = tmp_path / "c.toml"
    assert main(["paper", "fit", str(tmp_path / "odd"), "--step", "0.05", "--quiet", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "do not reach the target at all" in said and "inf" not in said
    assert "warning: no drag and lift explain these shots well" in said
    assert "mean_deviation_m" not in load_belief(out).provenance
    assert main(["paper", "fit", str(tmp_path / "odd"), "--step", "-1"]) == 2


DRAG = Sought("drag.cd", "1", "drag coefficient", False, 0, 0.5, 0.5)


def test_an_estimate_that_was_all_but_impossible_is_warned_of() -> None:
    for value, warned in ((0.2, False), (1.5, False), (8.3, True), (-0.9, True)):
        one = ProfileInterval("drag.cd", value, 0.9 * value, 1.1 * value, True, True, True)
        said = list(say_estimates((one,), (DRAG,), {}))
        assert ("warning: drag.cd" in said[-1] and "truearc discover" in said[-1]) == warned


def odd(sd: float, **values: float) -> dict[str, str]:
    """The remarks on a fit with these coefficients, "drag__cd" for drag.cd, each known to `sd`."""
    columns = tuple(column(name.replace("__", "."), "shared") for name in values)
    scores = gaussian(np.zeros(len(values)), np.eye(len(values)) / sd, columns)
    return odd_places(replace(scores, point=np.array(list(values.values()))), catalogue())


def test_a_coefficient_beyond_its_declared_range_is_remarked() -> None:
    for value, remarked in ((0.05, False), (-0.002, False), (-0.05, True)):
        said = odd(0.01, magnus__cl=value)
        assert any("magnus.cl is below 0" in line and "clock_deg" in line for line in said.values()) == remarked
    assert odd(0.1, spin_decay__rate_per_s=-0.4)["spin_decay.rate_per_s"].endswith("which physics seldom has")


def test_a_ball_that_leaves_faster_than_its_wheels_is_remarked() -> None:
    said = odd(0.02, drag__cd=0.77, exit_efficiency__loss=-0.035)
    assert list(said) == ["exit_efficiency.loss"]
    assert "(-0.035), so, other terms aside, balls leave faster than the wheels' surfaces run: make sure " in said[
        "exit_efficiency.loss"]
    assert not odd(0.02, drag__cd=0.65, exit_efficiency__loss=0.05) and not odd(0.3, exit_efficiency__loss=-0.035)
    fitted = Sought("exit_efficiency.loss", "1", "share lost", True, 0, 0.2, 0.24)
    one = ProfileInterval("exit_efficiency.loss", -0.035, -0.068, -0.002, True, True, True)
    assert f"warning: {said['exit_efficiency.loss']}" in list(say_estimates((one,), (fitted,), said))


def test_a_share_odd_of_rigs_drawn_from_the_priors_is_remarked() -> None:
    rng, terms = np.random.default_rng(0), ("drag.cd", "hood_offset.angle_deg", "release_height.above_m")
    priors = [find_parameter(name).prior for name in terms]
    draws = [[float(from_scale(one.scale, to_scale(one.scale, one.centre) + rng.normal() * one.sd)) for one in priors]
             for _ in range(400)]
    said = sum(bool(odd(1e-3, **{name.replace(".", "__"): value for name, value in zip(terms, drawn, strict=True)}))
               for drawn in draws)
    assert 0.5 * ODD < said / len(draws) < 1.7 * ODD


def errors_of(scale: float, clock: float, apart: float, seed: int = 0) -> list[str]:
    """What is said of a tracker with these errors, whose clock does what half its lengths do but for `apart`."""
    rng = np.random.default_rng(seed)
    pull = rng.normal(1.0, 0.1, 40) / 0.003
    slopes = np.stack([pull, -2.0 * pull + apart * rng.normal(size=40)], axis=1)
    columns = tuple(replace(column(f"{name}.share", "shared"), unit="1", usual=0.05)
                    for name in ("track_scale", "track_clock"))
    y = slopes @ [scale, clock] + rng.normal(size=40)
    scores = gaussian(y, slopes, columns, np.full(2, 0.05**-2.0))
    at = scores.covariance @ slopes.T @ y
    left = gaussian(y - slopes @ at, slopes, columns, np.full(2, 0.05**-2.0), -at * 0.05**-2.0)
    return say_tracker_errors(tracker_errors(replace(left, point=at), catalogue()), catalogue())


def test_lengths_or_clock_are_known_to_be_off_though_neither_is() -> None:
    line, = errors_of(0.02, 0.0, apart=1.0)
    assert re.fullmatch(r"the tracker is off: the tracker sees lengths (2\.0|1\.9)\d \(± 0\.0\d\) % too long, or the "
                        r"tracker's clock runs (1\.0|0\.9)\d \(± 0\.0\d\) % fast, or a part of each: measure one", line)


def test_an_error_of_the_tracker_that_is_known_alone_is_said_alone() -> None:
    line, = errors_of(0.02, 0.0, apart=1000.0)
    assert "lengths" in line and "clock" not in line and line.endswith("too long; measure it")


def test_a_tracker_without_errors_is_seldom_said_to_be_off() -> None:
    assert sum(bool(errors_of(0.0, 0.0, apart, seed)) for apart in (1.0, 1000.0) for seed in range(100)) <= 18


def test_a_fit_that_predicts_no_better_than_plain_shares_is_warned_of() -> None:
    for log_score, warned in ((-0.7, False), (-1.5, True)):
        said = list(say_prediction(CrossValidation(48, 48, log_score, -1.0, 0.1, 0.4, 0.4)))
        assert any("warning: on shots held out" in line and "rig.toml" in line for line in said) == warned
