"""Forecasts say where they go beyond the shots that the coefficients were fitted to, and why a height is missing."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as changed

import truearc as ta
from truearc.cli.main import main
from truearc.sim.infer.belief import launcher_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "spreadsheet"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A dataset with three shots: as fitted, from far away, and far too slow."""
    shutil.copytree(EXAMPLE, tmp_path / "shots")
    (tmp_path / "shots" / "shots.csv").write_text("shot_id,distance_m,hood_deg,motor_ratio\nas_ever,3.2,47,0.58\n"
                                                  "far,9.5,47,0.58\nslow,3.2,47,0.1\n")
    return tmp_path


def test_wheels_outside_the_fitted_range_are_noted() -> None:
    shots = ta.load_dataset(EXAMPLE)
    turned = shots.shots.number("motor_ratio") * 594.0
    wheels = {f"wheel_{one.name}_rad_s": one.gear * turned for one in shots.rig.launcher.wheel}
    numbers = {name: column for name, column in shots.shots.numbers.items() if name != "motor_ratio"} | wheels
    measured = replace(shots, shots=replace(shots.shots, numbers=numbers))
    belief = ta.fit(measured).belief
    notes = ta.predict(replace(measured, shots=replace(measured.shots, numbers=numbers | {
        "wheel_lower_rad_s": 3.0 * wheels["wheel_lower_rad_s"]})), belief, accept="reach").column("note")
    assert all("wheel_lower_rad_s" in note and "is outside the fitted" in note for note in notes)


def test_each_row_outside_the_fitted_range_is_noted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fitted = folder / "coefficients.toml"
    assert main(["paper", "fit", str(EXAMPLE), "-o", str(fitted), "--step", "0.5", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["predict", str(folder / "shots"), "--coefficients", str(fitted)]) == 0
    said = capsys.readouterr()
    ever, far, slow = csv.DictReader(said.out.splitlines())
    distance_m = ta.load_dataset(EXAMPLE).shots.number("distance_m")
    assert ever["note"] == ""
    assert f"distance_m 9.5 is outside the fitted {distance_m.min():.4g} to {distance_m.max():.4g}" in far["note"]
    assert slow["height_m"] == "" and "meets the floor or turns back" in slow["note"]
    assert "motor_ratio 0.1 is outside the fitted" in slow["note"] and "2 of 3 forecasts have a note" in said.err


def test_a_belief_of_another_rig_is_noted_wherever_it_is_used(folder: Path) -> None:
    week, belief = ta.load_dataset(EXAMPLE), ta.load_belief(written(folder))
    fitted = replace(belief, provenance={"rig": launcher_of(week.rig)})
    fitted.save(folder / "fitted.toml")
    fitted = ta.load_belief(folder / "fitted.toml")
    light = replace(week, facts=changed(week.rig, ball=changed(week.rig.ball, mass_kg=0.07)))
    said = "fitted to another rig: ball.mass_kg is 0.07, was 0.14"
    assert set(ta.predict(week, fitted).column("note")) == {""}
    assert all(said in note for note in ta.predict(light, fitted).column("note"))
    assert all(row.note == "" for row in ta.aim(fitted, week.rig, distances_m=[3.0, 4.0]).rows)
    assert all(said in row.note for row in ta.aim(fitted, light.rig, distances_m=[3.0, 4.0]).rows)
    assert f"warning: the belief was {said}" in str(ta.train_gate(light, fitted))


def test_a_negative_drag_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "negative.toml"
    path.write_text('schema = "truearc.coefficients/1"\n[drag]\ncd = -0.5\n')
    with pytest.raises(ta.InputError, match=r"negative\.toml: drag\.cd: -0\.5 is below 0, which it cannot be"):
        ta.load_belief(path)
    assert main(["predict", str(EXAMPLE), "--cd", "-0.5", "--cl", "0"]) == 2
    assert "--cd: got -0.5; expected at least 0" in capsys.readouterr().err


def written(folder: Path) -> Path:
    path = folder / "plain.toml"
    path.write_text('schema = "truearc.coefficients/1"\n[drag]\ncd = 0.5\n[magnus]\ncl = 0.1\n')
    return path


def test_topspin_presses_the_ball_down() -> None:
    rng = np.random.default_rng(2)
    rig = ta.load_dataset(EXAMPLE).rig
    spin = rng.uniform(-40.0, -20.0, 60)
    elevation, speed, distance = rng.uniform(35.0, 55.0, 60), rng.uniform(8.0, 9.0, 60), rng.uniform(2.0, 4.0, 60)
    base = ta.dataset({"shot_id": [str(k) for k in range(60)], "distance_m": distance, "exit_deg": elevation,
                       "exit_speed_m_s": speed, "exit_spin_rev_s": spin}, rig=rig)
    flown = ta.predict(base, ta.load_belief(Path(__file__).parents[1] / "golden" / "inputs" / "coefficients.toml"))
    height = np.array(flown.column("deviation_m"), float) + rng.normal(0.0, 0.02, 60)
    shots = {"shot_id": base.shots.shot_id, **base.shots.numbers, "miss_height_m": height}
    found = ta.discover(ta.dataset(shots, rig=rig), believe=["gravity", "drag"])
    assert found.best is not None and found.best.term == "magnus" and found.best.value > 0.0
    assert found.change.startswith("Topspin presses the ball down") and "ackspin" not in found.sentence


def test_each_shots_own_ball_is_flown() -> None:
    """A shot that states its ball flies as every shot does of a rig with that ball."""
    week, belief = ta.load_dataset(EXAMPLE), ta.Belief({"drag": {"cd": 0.5}}, {}, (), np.zeros((0, 0)))
    mass_kg = np.where(np.arange(len(week.shots)) % 2, 0.1, np.nan)
    numbers = week.shots.numbers | {"mass_kg": mass_kg, "radius_m": np.full(len(week.shots), np.nan)}
    mixed = replace(week, shots=replace(week.shots, numbers=numbers))
    light = replace(week, facts=changed(week.rig, ball=changed(week.rig.ball, mass_kg=0.1)))
    usual, all_light = (np.array(ta.predict(one, belief).column("height_m"), float) for one in (week, light))
    found = np.array(ta.predict(mixed, belief).column("height_m"), float)
    np.testing.assert_allclose(found, np.where(np.arange(len(found)) % 2, all_light, usual), rtol=1e-12)
    assert np.nanmax(np.abs(all_light - usual)) > 0.05
