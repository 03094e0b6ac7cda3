"""Wrong units and angles of shots and rigs are refused by name before a fit makes physics of them."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as changed

import truearc as ta
from tests.sim.check.foam import GEARED, WHEELS, ball, by_motor, faster, numbers, season, tracks, wheels
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.config.rig_spec import DENSEST_KG_M3, MOST, Tracker, Wheel
from truearc.sim.check.believable import TABLE, needed_speed
from truearc.sim.check.check import CHECKS, check_plausible
from truearc.sim.infer.belief import point_belief


@pytest.mark.parametrize(("spoiled", "said"), [
    (lambda one: numbers(one, distance_m=one.shots.number("distance_m") / 0.3048), "distance_m: these look like feet"),
    (lambda one: numbers(one, hood_deg=90.0 - one.shots.number("hood_deg")), "the angle is from the vertical")])
def test_a_shot_without_a_speed_does_not_keep_the_others_from_being_judged(table, spoiled, said):
    lost = {name: np.where(np.arange(len(table.shots)) == 3, np.nan, column) for name, column in
            faster(table, 1.0).items()}
    assert check_plausible(numbers(table, **lost)).accepted == ()
    with pytest.raises(InputError, match=said):
        check_plausible(spoiled(numbers(table, **lost)))


def test_balls_that_are_not_the_rigs_are_warned_of(table: ta.Dataset) -> None:
    other, same = (numbers(table, mass_kg=np.full(40, factor * table.rig.ball.mass_kg)) for factor in (2.0, 1.01))
    (said,) = check_plausible(other).accepted
    assert said.startswith("balls: ") and "which train, aim, gates and paper fit simulate" in said
    light = ball(other, mass_kg=10.0 * 4.0 / 3.0 * np.pi * table.rig.ball.radius_m**3)
    assert [said.split(":")[0] for said in check_plausible(light).accepted] == ["radius", "balls"]
    assert check_plausible(same).accepted == ()


@pytest.mark.parametrize(("factor", "column"), [(3.6, "exit_speed_(km_h|ft_s)"), (1.0 / 0.44704, "exit_speed_mph"),
                                                (1.0 / 0.3048, "exit_speed_ft_s")])
def test_measured_speeds_in_another_unit_are_refused(table: ta.Dataset, factor: float, column: str) -> None:
    rise_m = table.rig.target.centre_height_m - table.rig.launcher.release_height_m if table.rig.target else 0.0
    hood_deg, distance_m = (table.shots.number(name) for name in ("hood_deg", "distance_m"))
    drag_m = 0.3 * np.pi * table.rig.ball.radius_m**2 / table.rig.ball.mass_kg
    speed_m_s = needed_speed(distance_m, rise_m, hood_deg, 9.81, drag_m)
    plain = numbers(table, exit_deg=hood_deg, exit_speed_m_s=speed_m_s)
    assert check_plausible(plain).accepted == ()
    with pytest.raises(InputError, match=rf"exit_speed_m_s: .* rename the column to {column}"):
        check_plausible(numbers(plain, exit_speed_m_s=factor * speed_m_s))
    with pytest.raises(InputError, match=r"exit_deg: .* rename the column to exit_rad"):
        check_plausible(numbers(plain, exit_deg=np.radians(hood_deg)))


def stated(dataset: ta.Dataset, part: str, **keys: Any) -> ta.Dataset:
    """With other numbers in one table of rig.toml."""
    table = changed(getattr(dataset.rig, part) or Tracker(), **keys)
    return replace(dataset, facts=changed(dataset.rig, **{part: table}))


def mixed(dataset: ta.Dataset, every: int, factor: float) -> ta.Dataset:
    """One distance of `every` in another unit."""
    distance_m = dataset.shots.number("distance_m").copy()
    distance_m[::every] *= factor
    return numbers(dataset, distance_m=distance_m)


@pytest.mark.parametrize(("part", "keys", "said"), [
    ("launcher", {"release_height_m": 0.6 / 0.3048}, r"launcher\.release_height_m: this looks like feet: 0\.6 m"),
    ("launcher", {"release_height_m": 75.0}, r"release_height_m: this looks like centimetres: 0.75 m"),
    ("launcher", {"wheel": tuple(changed(one, radius_m=2.0) for one in WHEELS)},
     r"wheel.radius_m: this looks like inches: 0.0508 m"),
    ("launcher", {"wheel": (Wheel("upper", 0.05, 1.0, 0.0), Wheel("lower", 0.05, 1.0, 3.1416))},
     r"launcher\.wheel\.clock_deg: these look like radians; write degrees: 180 for 3\.1416"),
    ("air", {"density_kg_m3": 1200.0}, r"rig\.toml: air\.density_kg_m3: .*check 'air'"),
    ("air", {"density_kg_m3": 0.0012}, r"rig\.toml: air\.density_kg_m3: .*check 'air'"),
    ("target", {"two_half_height_m": 35.0}, r"rig\.toml: target\.two_half_height_m: .*check 'target'"),
    ("target", {"centre_height_m": 244.0}, r"rig\.toml: target\.centre_height_m: .*check 'target'"),
    ("ball", {"radius_m": 1e-300}, r"rig\.toml: ball\.(mass_kg|radius_m)"),
    ("ball", {"radius_m": 1e200}, r"rig\.toml: ball\.(mass_kg|radius_m)"),
    ("world", {"gravity_m_s2": 32.2}, r"world\.gravity_m_s2: 32\.2 is more .* looks like feet .*check 'gravity'"),
    ("world", {"gravity_m_s2": 1.0}, r"world\.gravity_m_s2: 1 is not of this Earth: gravity on Earth is 9\.81"),
    ("noise", {"distance_m": 5.0}, r"noise\.distance_m: 5 is more than .* centimetres or inches .*check 'noise'"),
    ("noise", {"track_m": 1.5}, r"noise\.track_m: 1\.5 is more than .* centimetres or inches"),
    ("tracker", {"scale_sd": 5.0}, r"tracker\.scale_sd: 5 is more than .* per cent; it is a share")])
def test_numbers_of_a_rig_in_another_unit_are_refused(table, part, keys, said):
    with pytest.raises(InputError, match=said):
        ta.fit(stated(table, part, **keys), ("gravity", "drag"))


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda one: numbers(one, hood_deg=np.radians(one.shots.number("hood_deg"))), r"hood_deg: .* radians: rename the"),
    (lambda one: numbers(one, hood_deg=one.shots.number("hood_deg") / 360.0), r"hood_deg: .* like turns: multiply"),
    (lambda one: numbers(one, hood_deg=90.0 - one.shots.number("hood_deg")), r"hood_deg: .* is from the vertical"),
    (lambda one: ball(one, mass_kg=one.rig.ball.mass_kg * 1000.0), r"ball.mass_kg: .* looks like grams"),
    (lambda one: ball(one, radius_m=one.rig.ball.radius_m * 1000.0), r"ball.radius_m: .* looks like millimetres"),
    (lambda one: ball(one, radius_m=one.rig.ball.radius_m * 100.0),
     r"ball.radius_m: .* looks like centimetres: 0\.\d+ m"),
    (lambda one: numbers(one, distance_m=one.shots.number("distance_m") / 0.3048), r"rename the column to distance_ft"),
    (lambda one: by_motor(one, free_speed_rad_s=5500.0), r"free_speed_rad_s: .*looks like revolutions per minute"),
    (lambda one: mixed(one, 2, 1 / 0.3048), r"distance_m: \d+ of 40 judged look like feet: convert these: 0, "),
    (lambda one: mixed(one, 4, 1 / 0.3048), r"distance_m: \d+ of 40 judged look like feet: convert these: 0, "),
    (lambda one: mixed(one, 4, 0.3048), r"distance_m: \d+ of 40 judged look like metres among feet: convert"),
    (lambda one: stated(one, "target", centre_height_m=one.rig.target.centre_height_m / 0.3048),
     r"target.centre_height_m: this looks like feet")])
def test_wrong_units_of_shots_and_rig_are_refused(table: ta.Dataset, wrong: Any, said: str) -> None:
    assert check_plausible(table) == table
    with pytest.raises(InputError, match=said):
        ta.fit(wrong(table), ("gravity", "drag"))


@pytest.mark.parametrize(("odd", "said"), [
    (lambda one: ball(one, mass_kg=0.14, radius_m=0.178), r"radius: rig\.toml: ball\.radius_m: .*the diameter"),
    (lambda one: ball(one, mass_kg=5.0, radius_m=0.0889),
     r"mass: rig\.toml: ball\.mass_kg: a ball of 5 kg and 0\.0889 m radius is as dense as stone or metal; make sure "
     r"that it is not in ounces, which would be 0\.142 kg, and that radius_m is not half of the radius$"),
    (lambda one: wheels(one, [WHEELS[0], changed(WHEELS[1], gear=0.5)]),
     "wheels: .*are equal although the wheels' gears differ"),
    (lambda one: stated(one, "launcher", release_height_m=0.0), r".*launcher\.release_height_m: is not stated")])
def test_what_may_be_another_unit_or_is_not_stated_warns(table: ta.Dataset, odd: Any, said: str) -> None:
    warning, = check_plausible(odd(table)).accepted
    assert re.match(said, warning)
    assert check_plausible(ball(table, mass_kg=7.26, radius_m=0.1085)).accepted == ()  # a bowling ball


@pytest.mark.parametrize(("columns", "said"), [
    ({"mass_kg": 90.0}, r"mass_kg, radius_m: the ball of shot 0 of 90 kg .* rename the column mass_kg to mass_g"),
    ({"radius_m": 0.49}, r"mass_kg, radius_m: .* hardly heavier than .* rename the column radius_m to radius_cm"),
    ({"miss_height_m": -18.0}, r"miss_height_m: these look like centimetres: rename .* to miss_height_cm"),
    ({"miss_height_m": 6.0}, r"miss_height_m: these look like inches: rename .* to miss_height_in"),
    ({"miss_height_m": 0.5}, r"miss_height_m: these look like feet: rename .* to miss_height_ft")])
def test_balls_and_heights_of_shots_in_another_unit_are_refused(table, columns, said):
    foam = ball(table, mass_kg=0.142, radius_m=0.0889)
    ordinary = {"mass_kg": 0.143, "radius_m": 0.089, "miss_height_m": 0.05}
    right, wrong = (numbers(foam, **{name: np.full(40, value) for name, value in one.items()})
                    for one in (ordinary, columns))
    check_plausible(right)            # of another ball than flew: at most a warning
    with pytest.raises(InputError, match=said):
        ta.fit(wrong, ("gravity", "drag"))


@pytest.mark.parametrize(("metres", "said"), [
    (1.0, r"in metres: subtract that of the target's centre, [\d.]+;"),
    (0.3048, r"in feet: subtract .*, [\d.]+, and rename the column to miss_height_ft"), (0.0254, "in inches: subtract"),
    (0.001, "in millimetres: subtract")])
@pytest.mark.parametrize("marked", [True, False])
def test_heights_above_the_floor_are_called_so(table: ta.Dataset, metres: float, said: str, marked: bool) -> None:
    right_m = np.random.default_rng(3).uniform(-0.06, 0.06, 40)
    if not marked:
        table = replace(table, shots=replace(table.shots, texts={}))
        right_m *= 5.0
    assert table.rig.target is not None and check_plausible(numbers(table, miss_height_m=right_m)).accepted == ()
    with pytest.raises(InputError, match=rf"miss_height_m: these look like heights above the floor {said}"):
        ta.fit(numbers(table, miss_height_m=(right_m + table.rig.target.centre_height_m) / metres), ("gravity", "drag"))


def test_heights_that_can_be_pass(table: ta.Dataset) -> None:
    spread = np.random.default_rng(3).normal(0.0, 0.4, 40)
    unmarked = replace(table, shots=replace(table.shots, texts={}))
    assert check_plausible(numbers(unmarked, miss_height_m=spread)).accepted == ()
    with pytest.raises(InputError, match=r"these look like .*check 'height'"):
        check_plausible(numbers(unmarked, miss_height_m=100.0 * spread))


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda one: numbers(one, **faster(one, 1.0 / (2.0 * np.pi))), "these look like revolutions per second"),
    (lambda one: numbers(one, **faster(one, 30.0 / np.pi)), "revolutions per minute"),
    (lambda one: wheels(numbers(one, **faster(one, 1.0 / 0.2)), [changed(wheel, gear=0.2) for wheel in WHEELS]),
     "these look like the motors' speeds, before the gears")])
def test_speeds_of_wheels_that_are_not_theirs_are_called_so(filmed, table, wrong, said):
    for dataset in (table, filmed):
        with pytest.raises(InputError, match=said):
            ta.fit(wrong(dataset), ("gravity", "drag"))


def test_half_of_a_wheels_radius_is_warned_of(filmed: ta.Dataset, table: ta.Dataset) -> None:
    for dataset in (table, filmed):
        halves = wheels(dataset, [changed(one, radius_m=0.025) for one in WHEELS])
        (half,) = check_plausible(halves).accepted
        assert "launcher.wheel.radius_m: this looks like half of the radius: 0.05 m" in half


@pytest.mark.parametrize(("factor", "said"), [
    (30.0 / np.pi, "revolutions per minute: rename each to wheel_lower_rpm"),
    (0.5 / np.pi, "revolutions per second: rename each to wheel_lower_rev_s"),
    (2.5, "the motors' speeds, before the gears: multiply each by its gear")])
def test_speeds_of_wheels_are_those_by_their_motors(table: ta.Dataset, factor: float, said: str) -> None:
    speeds = faster(table, 1.0)
    geared = wheels(numbers(by_motor(table, 1000.0), motor_ratio=speeds["wheel_upper_rad_s"] / 0.4 / 1000.0), GEARED)
    assert check_plausible(numbers(geared, **speeds)).accepted == ()
    with pytest.raises(InputError, match=rf"wheel_upper_rad_s: these look like {said}"):
        ta.fit(numbers(geared, **faster(table, factor)), ("gravity", "drag"))


def test_gears_that_may_be_upside_down_are_called_so(table: ta.Dataset) -> None:
    ratio = table.shots.number("wheel_upper_rad_s") / 1000.0
    slow, fast = (numbers(wheels(by_motor(table, 1000.0), [changed(wheel, gear=gear) for wheel in WHEELS]),
                          motor_ratio=gear * ratio) for gear in (0.2, 1.5))
    with pytest.raises(InputError, match=r"gears look upside down: launcher\.wheel\.gear is wheel speed /"):
        check_plausible(slow)
    (said,) = check_plausible(fast).accepted
    assert "launcher.wheel" in said


def test_heights_at_the_target_are_scores_where_outcomes_are_not_stated(table: ta.Dataset) -> None:
    high_m = np.random.default_rng(1).normal(scale=0.1, size=len(table.shots))
    measured = numbers(replace(table, shots=replace(table.shots, texts={})), miss_height_m=high_m)
    assert check_plausible(measured).accepted == check_plausible(table).accepted
    with pytest.raises(InputError, match=r"distance_ft"):
        check_plausible(numbers(measured, distance_m=measured.shots.number("distance_m") / 0.3048))


def test_train_predict_and_aim_refuse_as_fit_does(table: ta.Dataset) -> None:
    belief = point_belief({"drag": {"cd": 0.4}})
    radians = numbers(by_motor(table, 576.0), hood_deg=np.radians(table.shots.number("hood_deg")))
    for command in (ta.train_gate, ta.predict):
        with pytest.raises(InputError, match=r"hood_deg: .* radians"):
            command(radians, belief)
    with pytest.raises(InputError, match=r"ball\.mass_kg: .* looks like grams"):
        ta.aim(belief, by_motor(ball(table, mass_kg=142.0, radius_m=0.0889), 576.0).rig)
    assert len(ta.predict(radians, belief, accept="hood").rows) == 40


def test_an_unknown_term_of_the_rig_is_named_with_its_key(table: ta.Dataset) -> None:
    believe = changed(table.rig.believe, terms=("gravity", "drga"))
    with pytest.raises(InputError, match=r"rig\.toml: believe\.terms: there is no term 'drga'"):
        ta.fit(replace(table, facts=changed(table.rig, believe=believe)))


def test_an_objection_is_accepted_by_name_and_recorded(table: ta.Dataset, tmp_path: Path, capsys: Any) -> None:
    heavy = ball(table, mass_kg=1000.0)
    with pytest.raises(InputError, match=r"check 'mass'; if the data are right as recorded: --accept mass"):
        ta.fit(heavy, ("gravity",))
    ta.save_dataset(tmp_path / "data", heavy)
    command = ["fit", str(tmp_path / "data"), "--terms", "gravity,drag", "-o", str(tmp_path / "belief.toml")]
    assert main(command) == 2 and "rig.toml: ball.mass_kg" in capsys.readouterr().err
    assert main([*command, "--accept", "mass"]) == 0
    assert "mass: rig.toml: ball.mass_kg" in (tmp_path / "belief.toml").read_text()
    assert "warning: mass: rig.toml" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"accept: there is no check 'masss'"):
        ta.fit(heavy, ("gravity",), accept=("masss",))


@pytest.mark.parametrize(("seed", "rigs", "shots", "near"), [(6, 40, 20, False), (901, 12, 40, True)])
def test_plausible_rigs_pass(seed: int, rigs: int, shots: int, near: bool) -> None:
    refused = []
    for dataset in season(np.random.default_rng(seed), rigs, shots, near):
        try:
            check_plausible(dataset)
        except InputError as error:
            refused.append(str(error))
    assert refused == []


@pytest.mark.data
def test_real_recordings_pass(data_dir: Path, tmp_path: Path) -> None:
    real = data_dir / "real"
    for source, *files in (("mpi", "mpi_launches.csv", "mpi_tracks.csv"), ("ball-drops", "ball_drops.csv"),
                           ("frc-971", "frc971_wheel_to_ball_speed.csv"), ("frc-254", "frc_shot_tables.csv"),
                           ("frc-2910", "frc_shot_tables.csv"), ("frc-3476", "frc3476_tuning_history.csv")):
        home = tmp_path / source
        assert main(["import", source, *(str(real / name) for name in files), "-o", str(home)]) == 0
        said = check_plausible(ta.load_dataset(home)).accepted
        assert [one.partition(":")[0] for one in said] == (["axes", "balls"] if source == "ball-drops" else [])


def test_an_objection_names_columns_as_the_files_do(table: ta.Dataset, filmed: ta.Dataset) -> None:
    feet = numbers(table, distance_m=table.shots.number("distance_m") / 0.3048)
    with pytest.raises(InputError, match=r"shots: Weg: .*\(distance_m is the file's Weg\)"):
        check_plausible(replace(feet, shots=replace(feet.shots, written={"distance_m": ("Weg", 1.0, 0.0)})))
    with pytest.raises(InputError, match=r"tracks: x_m, y_m, z_cm: z points down.*\(z_m is the file's z_cm\)"):
        check_plausible(replace(tracks(filmed, z_m=-filmed.tracks.z_m), track_columns={"z_m": ("z_cm", 0.01, 0.0)}))


@pytest.mark.parametrize(("times", "passes"), [(1.0, True), (60.0, False), (2.0 * np.pi, False)])
def test_spins_in_another_unit_are_refused(table: ta.Dataset, times: float, passes: bool) -> None:
    # as fast at its rim as it flies
    rev_s = faster(table, 1.0)["wheel_upper_rad_s"] * 0.05 / (2.0 * np.pi * table.rig.ball.radius_m)
    spun = numbers(table, exit_spin_rev_s=times * rev_s)
    if passes:
        assert check_plausible(spun).accepted == ()
    else:
        with pytest.raises(InputError, match=r"exit_spin_rev_s: these look like .*rename the column to exit_spin_rpm"):
            check_plausible(spun)


def test_one_shot_with_a_wrong_speed_makes_no_other_angle_likelier(table: ta.Dataset) -> None:
    """A scoring shot of a fifth of the speed, as a sensor may say, among forty: seen once in a season of the demo."""
    slow = {f"wheel_{name}_rad_s": table.shots.number(f"wheel_{name}_rad_s").copy() for name in ("upper", "lower")}
    for column in slow.values():
        column[4] *= 0.2
    assert check_plausible(table).accepted == ()
    (said,) = check_plausible(numbers(table, **slow)).accepted
    assert f"of them: {table.shots.shot_id[4]}; make sure of these rows" in said


def test_the_table_of_slips_agrees_with_the_checks_and_with_limits_of_rigs() -> None:
    rows = [*TABLE["shots"], *TABLE["rig"], *TABLE["tracks"], *TABLE["limits"], *TABLE["remarks"].values(),
            *TABLE["quantities"].values()]
    assert {row["check"] for row in rows} | {*TABLE["checks"].values()} <= {*CHECKS}
    assert TABLE["checks"].keys() - {"launcher.wheel.clock_deg"} == MOST.keys() - {"ball.radius_m"}
    assert max(row["most"] for row in TABLE["limits"] if row["of"] == "ball" and "most" in row) == DENSEST_KG_M3
