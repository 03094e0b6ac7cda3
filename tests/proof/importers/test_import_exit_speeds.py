"""Importing measured exit speeds: wheels and speeds as they stand, backspin positive, every bad row named."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc.cli.main as truearc
from tests.sim.same_dataset import assert_same
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.data.files import load_dataset
from truearc.sim.physics.simulate import launch_of
from truearc_proof.importers.set_points import import_971, import_fuel

SPEEDS = ("ball_speed_mps", "accelerator_rad_s", "finisher_rad_s")
FUEL = ("hood_elevation_deg", "motor_rpm", "exit_speed_mps", "spin_rev_s", "ball_mass_kg", "ball_radius_m")
CONSTANTS = """
  // {{9.9, {200.0, kVelocityFinisher}}
  constexpr double kVelocityFinisher = 350.0;
  shots = Table({{1.0, {0.01, 10.7}}, {1.2, {0.01, 10.7}}});
  r->flywheel_shot_interpolation_table = Table({{10.6, {250.0, kVelocityFinisher}},
                  {17.0, {500.0,
                          kVelocityFinisher}}});
"""


def write(path: Path, header: tuple[str, ...], rows: list[tuple[object, ...]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return path


def test_wheels_on_both_sides_drive_the_ball_at_surface_speed_without_spin(tmp_path: Path) -> None:
    dataset = import_971(write(tmp_path / "s.csv", SPEEDS, [(10.6, 250, 350), (17, 500, 350)]))
    shots = dataset.shots
    unmeasured = Shots(shots.shot_id, {k: v for k, v in shots.numbers.items() if k != "exit_speed_m_s"}, {})
    leaving = launch_of(dataset.facts, unmeasured)
    assert leaving.speed_m_s == pytest.approx([12.7, 25.4])       # 250 and 500 rad/s of a 4-inch wheel
    assert leaving.spin_rev_s == pytest.approx([0.0, 0.0], abs=1e-12)
    assert dataset.shots.number("exit_speed_m_s").tolist() == [10.6, 17.0]
    assert "distance_m" not in dataset.shots.numbers


def test_the_teams_own_file_says_the_same_as_the_table(tmp_path: Path) -> None:
    original = tmp_path / "constants.cc"
    original.write_text(CONSTANTS)
    shots = import_971(original).shots
    assert shots.number("exit_speed_m_s").tolist() == [10.6, 17.0]
    assert shots.number("wheel_left_rad_s").tolist() == [250.0, 500.0]
    original.write_text(CONSTANTS.replace("kVelocityFinisher}", "340.0}"))        # a finisher of its own in each row
    assert import_971(original).shots.number("exit_speed_m_s").tolist() == [10.6, 17.0]
    original.write_text(CONSTANTS.replace("17.0", "kFast"))
    with pytest.raises(InputError, match=r"constants\.cc:6: ball_speed_mps: 'kFast' is not a finite number"):
        import_971(original)
    original.write_text("int main() {}")
    with pytest.raises(InputError, match=r"constants\.cc: holds no numbers"):
        import_971(original)


SHOOTER = """
# m = 9.0
m = 0.215 # Mass of the ball (kg)
R = 0.075 # Radius
A = np.pi * R**2
angle_min = 46.0 # Minimum
test_rpm = np.array([3000.0, 4000.0, 3000.0, 4000.0]) # RPM
test_speed = np.array([5.5, 7.0, 5.25, 7.25,]) # m/s
test_spin = np.array([-20.0, -25.0,
                      -21.0, -26.0])
def m():
    R = 1
"""


def test_the_simulations_own_file_says_the_same_as_the_table(tmp_path: Path) -> None:
    original = tmp_path / "shooter.py"
    original.write_text(SHOOTER)
    dataset = import_fuel(original)
    rows = [(46, rpm, speed, spin / (2.0 * np.pi), 0.215, 0.075) for rpm, speed, spin in
            ((3000, 5.5, -20.0), (4000, 7.0, -25.0))]
    left_out = (f"{original}:7: 2 more, where motor speeds start again: at another elevation, which is not stated",)
    assert dataset.left_out == left_out
    assert_same(dataset, import_fuel(write(tmp_path / "f.csv", FUEL, rows)), 1e-12)
    original.write_text(SHOOTER.replace(", 3000.0, 4000.0", ", 5000.0, 6000.0"))
    assert len(import_fuel(original).shots) == 4
    assert import_fuel(original).left_out == ()


@pytest.mark.parametrize(("was", "becomes", "says"), [
    ("7.0", "fast", "shooter.py:7: exit_speed_mps: 'fast' is not a finite number"),
    ("-25.0", "", "shooter.py:7: spin_rev_s: is missing"),
    ("5.25, ", "", "shooter.py: test_rpm, test_speed and test_spin have 4, 3 and 4 numbers"),
    ("= 46.0", "= 46.0 * np.pi / 180.0", "shooter.py:6: angle_min: '46.0 * np.pi / 180.0' is not a finite number"),
    ("= 0.215", "= -0.215", "shooter.py:7: ball_mass_kg: -0.215 must be above 0"),
    ("R = 0.075", "R = 0.075\nR = 0.08", "shooter.py:5: stands in line 4 already"),
    ("test_rpm", "rpm", "shooter.py: holds no numbers where expected"),
])
def test_what_is_wrong_with_it_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], was: str, becomes: str,
                                        says: str) -> None:
    path = tmp_path / "shooter.py"
    path.write_text(SHOOTER.replace(was, becomes))
    assert truearc.main(["import", "fuel", str(path), "-o", str(tmp_path / "d")]) == 2
    assert says in capsys.readouterr().err


def test_what_lifts_the_ball_is_backspin(tmp_path: Path) -> None:
    path = write(tmp_path / "f.csv", FUEL, [(46, 3000, 5.6, -3.2, 0.215, 0.075), (46, 6000, 8.1, -6.7, 0.215, 0.075)])
    dataset = import_fuel(path)
    assert dataset.shots.number("exit_spin_rev_s").tolist() == [3.2, 6.7]
    assert dataset.shots.number("hood_deg").tolist() == [46.0, 46.0]
    assert (dataset.facts.ball.mass_kg, dataset.facts.ball.radius_m) == (0.215, 0.075)
    assert dataset.facts.launcher.wheel == ()


@pytest.mark.parametrize(("line", "column", "cell", "says"), [
    (3, "exit_speed_mps", "fast", "f.csv:3: exit_speed_mps: 'fast' is not a finite number"),
    (3, "exit_speed_mps", "-1", "f.csv:3: exit_speed_mps: -1 must be above 0"),
    (2, "motor_rpm", "", "f.csv:2: motor_rpm: is missing"),
    (2, "ball_mass_kg", "0", "f.csv:2: ball_mass_kg: 0 must be above 0"),
])
def test_a_bad_cell_is_named(tmp_path: Path, line: int, column: str, cell: str, says: str) -> None:
    rows: list[list[object]] = [[46, 3000, 5.6, -3.2, 0.215, 0.075], [46, 6000, 8.1, -6.7, 0.215, 0.075]]
    rows[line - 2][FUEL.index(column)] = cell
    with pytest.raises(InputError) as caught:
        import_fuel(write(tmp_path / "f.csv", FUEL, [tuple(row) for row in rows]))
    assert says in str(caught.value)


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"s\.csv:1: column accelerator_rad_s is missing"):
        import_971(write(tmp_path / "s.csv", SPEEDS[:1], [(10.6,)]))


def test_too_few_to_judge_by_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "f.csv", FUEL, [(46, 3000, 5.6, -3.2, 0.215, 0.075)])
    assert truearc.main(["import", "fuel", str(path), "-o", str(tmp_path / "d")]) == 0
    assert truearc.main(["discover", str(tmp_path / "d")]) == 2
    assert "1 shot is too few" in capsys.readouterr().err


@settings(max_examples=40, deadline=None)
@given(rows=st.lists(st.tuples(st.floats(0.1, 60.0), st.floats(1.0, 900.0)), min_size=1, max_size=20))
def test_every_row_arrives(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]]) -> None:
    home = tmp_path_factory.mktemp("speeds")
    table = [(speed, wheel, 350.0) for speed, wheel in rows]
    assert truearc.main(["import", "frc-971", str(write(home / "s.csv", SPEEDS, table)), "-o", str(home / "d")]) == 0
    shots = load_dataset(home / "d").shots
    assert shots.number("exit_speed_m_s").tolist() == [speed for speed, _ in rows]
    assert shots.number("wheel_right_rad_s").tolist() == [wheel for _, wheel in rows]


@pytest.mark.data
def test_the_real_speeds(data_dir: Path) -> None:
    shots = import_971(data_dir / "real/frc971_wheel_to_ball_speed.csv").shots
    with (data_dir / "real/frc971_wheel_to_ball_speed.csv").open(newline="") as file:
        stated = [float(row["ball_over_surface"]) for row in csv.DictReader(file)]
    share = shots.number("exit_speed_m_s") / (shots.number("wheel_left_rad_s") * 0.0508)
    assert share == pytest.approx(stated, abs=1e-3)
    # the share falls from its highest on, at wheel speeds that the team stepped by 25 rad/s
    assert np.all(np.diff(share[2:]) < 0.0)
    fuel = import_fuel(data_dir / "real/fuel_exit_speed_spin_46deg.csv").shots
    assert len(fuel) == 4
    assert np.all(np.diff(fuel.number("exit_spin_rev_s")) > 0.0)


@pytest.mark.data
def test_the_real_speeds_are_the_same_out_of_their_own_form(tmp_path: Path, data_dir: Path) -> None:
    table, path = data_dir / "real/fuel_exit_speed_spin_46deg.csv", tmp_path / "shooter.py"
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    arrays = {"test_rpm": "motor_rpm", "test_speed": "exit_speed_mps", "test_spin": "spin_rad_s"}
    one = {"m": "ball_mass_kg", "R": "ball_radius_m", "angle_min": "hood_elevation_deg"}
    path.write_text("".join(f"{name} = np.array([{', '.join(row[column] for row in rows)}])\n"
                            for name, column in arrays.items())
                    + "".join(f"{name} = {rows[0][column]} # of all\n" for name, column in one.items()))
    assert_same(import_fuel(path), import_fuel(table), 1e-4)
