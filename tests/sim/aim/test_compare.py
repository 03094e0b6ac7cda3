"""Tables in the shapes of teams' code, and two tables beside each other."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import truearc as ta
from tests.sim.physics.rigs import GUPPY
from truearc.cli.main import main
from truearc.sim.aim.make_table import flown
from truearc.sim.aim.snippets import TEAMS
from truearc.sim.data.table import gathered
from truearc.sim.infer.belief import Belief, point_belief
from truearc_proof.importers.set_points import load_3476

LAUNCHER = Path(__file__).parents[3] / "robot" / "launcher.toml"


@pytest.fixture(scope="module")
def belief() -> Belief:
    return point_belief({"drag": {"cd": 0.45}, "magnus": {"cl": 0.1}}, {"speed": 0.015, "elevation_deg": 0.5})


@pytest.fixture(scope="module")
def table(belief: Belief) -> ta.AimTable:
    return ta.aim(belief, GUPPY, distances_m=[2.5, 3.5, 4.5, 5.5], hood_deg=(30.0, 60.0))


def test_time_of_flight_is_that_of_dop853() -> None:
    drag = 0.5 * 0.45 * math.pi * GUPPY.ball.radius_m**2 * GUPPY.air.density_kg_m3 / GUPPY.ball.mass_kg
    ratio, elevation, distance_m = 0.6, math.radians(50.0), 4.0
    free_rad_s = GUPPY.launcher.free_speed_rad_s
    assert free_rad_s is not None
    surface = [wheel.radius_m * wheel.gear * ratio * free_rad_s for wheel in GUPPY.launcher.wheel]
    speed = sum(surface) / len(surface)

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], [0.0, -9.81] - drag * np.hypot(*y[2:]) * y[2:]])

    def there(_: float, y: np.ndarray) -> float:
        return float(y[0] - distance_m)

    start = [0.0, 0.0, speed * math.cos(elevation), speed * math.sin(elevation)]
    found = solve_ivp(rate, (0.0, 5.0), start, "DOP853", events=there, rtol=1e-10, atol=1e-12)
    side_m, flown_s = flown(GUPPY, point_belief({"drag": {"cd": 0.45}}), np.array([distance_m]), np.array([50.0]),
                            np.array([ratio]))
    assert flown_s[0] == pytest.approx(found.t_events[0][0], abs=1e-4) and side_m[0] == 0.0


def test_shapes_of_teams_code_have_the_tables_numbers(table: ta.AimTable, tmp_path: Path) -> None:
    hood, motor = [row.hood_deg for row in table.rows], np.array([row.motor_rad_s for row in table.rows])
    text = table.to_text("java-6328")
    tilted = re.findall(r"shotHoodAngleMap\.put\(([\d.]+), Rotation2d\.fromDegrees\(([\d.]+)\)\);", text)
    assert [90.0 - float(deg) for _, deg in tilted] == pytest.approx(hood, abs=0.006)
    assert [float(at) for at, _ in tilted] == [row.distance_m for row in table.rows]
    assert [float(one) for one in re.findall(r"shotFlywheelSpeedMap\.put\([\d.]+, ([\d.]+)\);", text)] == pytest.approx(
        motor, abs=0.006)
    times = [float(one) for one in re.findall(r"timeOfFlightMap\.put\([\d.]+, ([\d.]+)\);", text)]
    assert times == pytest.approx([row.flight_s for row in table.rows], abs=6e-4)
    (tmp_path / "shooterconfig.json").write_text(table.to_text("json-3476"))
    with gathered() as problems:
        (read,) = load_3476(tmp_path / "shooterconfig.json", problems)      # as the team's own file is read
    assert [float(str(one)) for one in read.columns["hood_eject_angle_deg"]] == pytest.approx(hood, abs=0.006)
    assert [float(str(one)) for one in read.columns["distance_m"]] == pytest.approx([2.5, 3.5, 4.5, 5.5], abs=2e-4)
    rows = [line.split(",") for line in table.to_text("csv-2928").splitlines()[1:]]      # as the robot's code does
    assert [2.0 * math.pi * float(row[2]) for row in rows] == pytest.approx(motor, abs=0.01)
    inches = re.findall(r"kLaserRPMMap\.put\(new InterpolatingDouble\(([\d.]+)\), new InterpolatingDouble\(([\d.]+)\)",
                        table.to_text("java-254"))
    assert [(float(at) * 0.0254, float(rpm) * math.pi / 30.0) for at, rpm in inches] == [
        pytest.approx((row.distance_m, row.motor_rad_s), abs=0.02) for row in table.rows]


def test_a_table_against_itself_gains_nothing_in_any_form(table: ta.AimTable, belief: Belief, tmp_path: Path) -> None:
    feet = [f"{row.distance_m / 0.3048},{row.hood_deg},{row.motor_rad_s * 30.0 / math.pi}" for row in table.rows]
    forms = {"a.csv": table.to_csv(), "b.json": table.to_json(), "c.csv": table.to_text("csv-2928"),
             "d.csv": "\n".join(["Distance_ft,hood_deg,motor_rpm", *feet])}
    for name, text in forms.items():
        (tmp_path / name).write_text(text)
    first, *others = (ta.load_set_points(tmp_path / name, GUPPY) for name in forms)
    for other in others:
        found = ta.compare(first, other, belief, GUPPY)
        assert len(found.distance_m) == 4 and np.abs(found.gained).max() < 0.01
    assert found.old_points == pytest.approx([row.points for row in table.rows], abs=1e-6)


SETTINGS = st.lists(st.tuples(st.integers(5, 300), st.floats(0.0, 90.0), st.floats(0.05, 1.0),
                              st.sampled_from([0.0, 2.0])), min_size=1, max_size=8, unique_by=lambda one: one[0])


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(said=SETTINGS, form=st.sampled_from(["csv", "json", "java", *TEAMS]))
def test_every_form_that_aim_writes_is_read_to_its_rounding(said: list[tuple[int, float, float, float]], form: str,
                                                            table: ta.AimTable, tmp_path: Path) -> None:
    free = GUPPY.launcher.free_speed_rad_s or math.nan
    rows = tuple(table.rows[0]._replace(distance_m=0.05 * step, hood_deg=hood, motor_ratio=ratio,
                                        motor_rad_s=ratio * free, lead_deg=lead,
                                        note="beyond" if step % 2 else "") for step, hood, ratio, lead in said)
    path = tmp_path / f"t.{form.split('-')[0]}"
    path.write_text({"csv": ta.AimTable.to_csv, "json": ta.AimTable.to_json}.get(form, lambda one: one.to_text(form))(
        replace(table, rows=rows)))
    found, wanted = ta.load_set_points(path, GUPPY), sorted(rows, key=lambda row: row.distance_m)
    np.testing.assert_allclose(found.distance_m, [row.distance_m for row in wanted], rtol=0.0, atol=1.3e-4)
    np.testing.assert_allclose(found.hood_deg, [row.hood_deg for row in wanted], rtol=0.0, atol=0.0051)
    np.testing.assert_allclose(found.motor_ratio, [row.motor_ratio for row in wanted], rtol=0.0, atol=0.0055 / free)


@pytest.mark.parametrize(("text", "said"), [
    ("hoodDeg.put(2.0, 40.0);\nmotorRpm.put(2.0, fast);", "t.java:2: 'fast' is not a number"),
    ("hoodDeg.put(2.0, 40.0);\nmotorRpm.put(2.0, 3000.0)", "t.java:2: 'motorRpm.put(2.0, 3000.0)' is not an entry"),
    ("hoodDeg.put(2.0, 40.0);\nhoodDeg.put(2.0, 41.0);", "t.java:2: hood_deg at 2.0 stands in line 1 already"),
    ("hoodDeg.put(2.0, 40.0);\nhoodDeg.put(3.0, 40.0);\nmotorRpm.put(2.0, 3000.0);", "t.java:2: 3.0 has no motor_rpm"),
    ("hoodDeg.put(2.0, 40.0);", "t.java: is not a table of truearc aim"), ("", "t.java: is not a table of truearc aim"),
    ("hoodDeg.put(2.0, 140.0);\nmotorRpm.put(2.0, 3000.0);", "t.java:1: hood_deg: 140 is not between 0 and 90"),
    ("foo.put(2.0, 40.0);", "t.java:1: 'foo.put(2.0, 40.0);' is not an entry"),
    ("hoodDeg.put(2.0, 40.0); // mine", "t.java:1: 'hoodDeg.put(2.0, 40.0); // mine' is not an entry")])
def test_java_that_is_no_table_is_named_by_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "t.java").write_text(text)
    with pytest.raises(ta.InputError, match=re.escape(said)):
        ta.load_set_points(tmp_path / "t.java", GUPPY)


def test_what_is_worse_is_said_with_where(table: ta.AimTable, belief: Belief, tmp_path: Path) -> None:
    rows = [row._replace(motor_ratio=row.motor_ratio * (1.04 if row.distance_m == 4.5 else 1.0)) for row in table.rows]
    (tmp_path / "old.csv").write_text(table.to_csv())
    (tmp_path / "new.csv").write_text(replace(table, rows=tuple(rows[1:])).to_csv())
    old, new = (ta.load_set_points(tmp_path / name, GUPPY) for name in ("old.csv", "new.csv"))
    found = ta.compare(old, new, belief, GUPPY)
    assert list(found.distance_m) == [3.5, 4.5, 5.5] and found.gained[1] < -0.3
    assert f"most at 4.50 m: {found.gained[1]:+.2f}" in str(found)
    assert ta.compare(new, old, belief, GUPPY).gained == pytest.approx(-found.gained)
    middle = ta.compare(old, replace(new, distance_m=np.array([3.0, 4.0, 5.0])), belief, GUPPY)
    assert list(middle.distance_m) == [3.0, 3.5, 4.0, 4.5, 5.0]         # between rows as robots interpolate
    with pytest.raises(ta.InputError, match="no distance in common"):
        ta.compare(old, replace(new, distance_m=new.distance_m + 10.0), belief, GUPPY)


@pytest.mark.parametrize(("name", "text", "said"), [
    ("t.csv", "distance_m,hood_deg\n3,40\n", "t.csv:1: motor_ratio: is missing"),
    ("t.csv", "distance_m,hood_deg,motor_rpm\n3,40,3000\n4,high,3100\n", "t.csv:3: hood_deg: 'high' is not a number"),
    ("t.csv", "distance_m,hood_deg,motor_ratio\n", "t.csv: has no set point"),
    ("t.csv", "distance_ft,hood_deg,motor_ratio\n-2,40,0.5\n", "t.csv:2: distance_ft: -2 is not between 0 and"),
    ("t.csv", "distance_m,hood_deg,motor_ratio\n2,140,0.5\n", "t.csv:2: hood_deg: 140 is not between 0 and 90"),
    ("t.csv", "distance_m,hood_deg,motor_rpm\n2,40,9000\n", "t.csv:2: motor_rpm: 9000 is not between 0 and"),
    ("t.csv", "distance_m,hood_deg,motor_ratio\n3,40,0.5\n3,41,0.5\n", "t.csv: a distance stands twice"),
    ("t.json", '{"shooterConfigs": [{"distance": "far", "hoodEjectAngle": 4, "flywheelSpeed": 3000}]}',
     "t.json: is not a table of truearc aim"),
    ("t.json", "{}", "t.json: is not a table of truearc aim"), ("t.json", "[1", "t.json: is not a table of truearc")])
def test_a_table_that_is_none_is_named(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ta.InputError, match=re.escape(said)):
        ta.load_set_points(tmp_path / name, GUPPY)
    bare = replace_free_speed()
    with pytest.raises(ta.InputError, match="free_speed_rad_s"):
        ta.load_set_points(tmp_path / name, bare)


def replace_free_speed() -> ta.Rig:
    import msgspec
    return msgspec.structs.replace(GUPPY, launcher=msgspec.structs.replace(GUPPY.launcher, free_speed_rad_s=None))


def test_the_command_compares_what_aim_wrote(belief: Belief, tmp_path: Path,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    belief.save(tmp_path / "belief.toml")
    for name, form in (("a.csv", "csv"), ("b.json", "json"), ("ShotTable.java", "java-6328")):
        assert main(["aim", str(tmp_path / "belief.toml"), "--rig", str(LAUNCHER), "--distances", "3:5:1", "--hood",
                     "35:55", "--format", form, "-o", str(tmp_path / name), "--quiet"]) == 0
    assert json.loads((tmp_path / "b.json").read_text())["rows"][0]["flight_s"] > 0.1
    assert main(["compare", str(tmp_path / "a.csv"), str(tmp_path / "b.json"), "--belief",
                 str(tmp_path / "belief.toml"), "--rig", str(LAUNCHER)]) == 0
    out = capsys.readouterr().out
    assert "scores +0.00 points a ball" in out and len(out.splitlines()) == 6
    assert main(["compare", str(tmp_path / "a.csv"), str(tmp_path / "ShotTable.java"), "--belief",
                 str(tmp_path / "belief.toml"), "--rig", str(LAUNCHER)]) == 0
    assert main(["compare", str(tmp_path / "none.csv"), str(tmp_path / "b.json"), "--belief",
                 str(tmp_path / "belief.toml"), "--rig", str(LAUNCHER)]) == 2
