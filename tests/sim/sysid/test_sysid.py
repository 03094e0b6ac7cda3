"""Identified motors against exact solutions, a strong solver and a team's own numbers; gains, tables, the report."""

import hashlib
import tomllib

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.robot.good_tick import CONFIG
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.sim.sysid import fit as sysid
from truearc.sim.sysid.fit import Record, fit_law
from truearc.sim.sysid.session import load_steps
from truearc.sim.sysid.sysid_text import fewest_rad_per_deg, flywheel_gains, hood_gains

KS, KV, KA, DELAY_S = 0.4, 0.009, 0.0045, 0.03
TRUTH = {"ks": KS, "kv": KV, "ka": KA, "delay_s": DELAY_S}
STAIRS = (2.0, 4.0, 3.0, 6.0, 5.0, 2.5, 4.5, 6.0)
STAIR_S, PERIOD_S = 2.5, 0.02


def exact_speed(t_s):
    """Speed at `t_s` of a wheel that starts from rest and is given each of STAIRS for STAIR_S, by exponentials."""
    speed, out = 0.0, np.zeros(len(t_s))
    for number, effort in enumerate(STAIRS):
        final, since = (effort - KS) / KV, t_s - number * STAIR_S
        mine = since >= 0.0
        out[mine] = final + (speed - final) * np.exp(-since[mine] * KV / KA)
        speed = final + (speed - final) * np.exp(-STAIR_S * KV / KA)
    return out


def stair_record(noise_rad_s, seed=0, delay_s=DELAY_S, effort_rows=True):
    """The steps as a user would record them; without `effort_rows` only the changes of effort are noted."""
    t_s = np.arange(0.0, len(STAIRS) * STAIR_S, PERIOD_S)
    efforts = np.array(STAIRS)[np.minimum((t_s / STAIR_S + 1e-9).astype(int), len(STAIRS) - 1)]
    speed = exact_speed(t_s - delay_s) + noise_rad_s * np.random.default_rng(seed).standard_normal(len(t_s))
    if effort_rows:
        return Record("stairs", "v", t_s, efforts, t_s, speed)
    return Record("stairs", "v", np.arange(len(STAIRS)) * STAIR_S, np.array(STAIRS), t_s, speed)


# frc3512/Robot-2020, src/main/include/controllers/FlywheelController.hpp at 0905181b: what the team got of its wheel
TEAM_3512 = {"ks": 0.47564, "kv": 0.0088813, "ka": 0.0045649}


def test_without_noise_the_numbers_come_back():
    fit = sysid.fit_law(stair_record(0.0), windage=False)
    for name, truth in TRUTH.items():
        assert fit.value(name) == pytest.approx(truth, rel=1e-4), name
    assert fit.r2 > 1.0 - 1e-9


@pytest.mark.parametrize("delay_s", [-0.02, 0.0, 0.013, 0.07])
def test_the_delay_is_found_whether_efforts_are_noted_row_by_row_or_by_their_changes(delay_s):
    for effort_rows in (True, False):
        fit = sysid.fit_law(stair_record(0.3, seed=4, delay_s=delay_s, effort_rows=effort_rows), windage=False)
        assert fit.value("delay_s") == pytest.approx(delay_s, abs=0.002)
        assert fit.value("ka") == pytest.approx(TRUTH["ka"], rel=0.01)


def test_ninety_percent_intervals_cover_about_ninety_percent():
    law, inside = sysid.Law((1.0,), False), []
    for seed in range(40):
        record = stair_record(3.0, seed)
        cuts = sysid.cut(record, sysid.find_runs(record))
        values, start = sysid.fit_least_squares(record, law, cuts)
        sds = np.sqrt(np.diag(sysid.jackknife_covariance(record, law, values, start, cuts)))
        truth = np.array([TRUTH[name] for name in law.names])
        inside.append(np.abs(values - truth) <= sysid.NORMAL90 * sds)
    share = np.mean(inside, axis=0)
    assert np.all(share >= 0.78) and 0.84 <= np.mean(share) <= 0.99, share


def bent_record(noise_rad_s, direction=1.0):
    """Steps either way of a wheel with windage, by a strong solver; slow at the end of each, so that no stop is hit."""
    truth = {"ks": 0.02, "ks_back": 0.03, "kv": 8e-5, "kq": 2e-7, "ka": 1.3e-3}
    t_s = np.arange(0.0, 30.0, 0.01)
    effort_t_s, torque = np.array([0.0, 3.0, 9.0, 12.0, 20.0]), direction * np.array([0.25, 0.0, 0.3, 0.05, 0.15])
    friction = truth["ks"] if direction > 0.0 else truth["ks_back"]

    def pull(t, w):
        asked = torque[np.searchsorted(effort_t_s, t, side="right") - 1]
        lost = direction * friction + truth["kv"] * w + truth["kq"] * w * np.abs(w)
        return (asked - lost) / truth["ka"]

    speed = solve_ivp(pull, (0.0, 30.0), [0.0], t_eval=t_s, method="DOP853", rtol=1e-10, atol=1e-8, max_step=0.05).y[0]
    return sysid.Record("bent", "nm", effort_t_s, torque, t_s,
                  speed + noise_rad_s * np.random.default_rng(1).standard_normal(len(t_s))), truth


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_windage_is_found_where_there_is_some(direction):
    record, truth = bent_record(0.2, direction)
    fit = sysid.fit_motion(record)
    assert fit.law.windage and fit.law.directions == (direction,)
    friction = "ks" if direction > 0.0 else "ks_back"
    for name, rel in ((friction, 0.03), ("kv", 0.1), ("kq", 0.05), ("ka", 0.002)):
        assert fit.value(name) == pytest.approx(truth[name], rel=rel), name


def test_a_straight_law_stays_straight():
    fit = sysid.fit_motion(stair_record(3.0))
    assert not fit.law.windage
    for number in sysid.line(fit):
        assert number.value == pytest.approx(fit.value(number.name))
        assert number.sd == pytest.approx(fit.numbers[number.name].sd)


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda r: sysid.Record("x", "v", r.effort_t_s, r.effort, r.speed_t_s, 0.0 * r.speed_rad_s), "0.0 s of motion"),
    (lambda r: sysid.Record("x", "v", r.effort_t_s, -r.effort, r.speed_t_s, r.speed_rad_s), "no inertia can be seen"),
    (lambda r: sysid.Record("x", "v", r.effort_t_s, 0.0 * r.effort + 3.0, r.speed_t_s, 0.0 * r.speed_rad_s + 300.0),
     "x: "),
    (lambda r: sysid.Record("x", "v", r.effort_t_s[:30], r.effort[:30], r.speed_t_s[:30], r.speed_rad_s[:30]),
     "pieces .* are needed")])
def test_too_little_to_fit_is_said_and_not_guessed(spoil, words):
    with pytest.raises(InputError, match=words):
        sysid.fit_motion(spoil(stair_record(0.1)))


@pytest.mark.data
def test_a_real_flywheel_comes_out_as_its_team_says(data_dir):
    fit = sysid.fit_motion(load_steps(data_dir / "real" / "frc3512_flywheel_step.csv"))
    assert fit.record.unit == "v" and not fit.law.windage
    assert fit.r2 > 0.999 and fit.rms_rad_s < 4.0
    for name, theirs in TEAM_3512.items():
        number = fit.numbers[name]
        assert number.low90 <= theirs <= number.high90, name
    assert 0.0 < fit.value("delay_s") < 0.06


FREQUENCIES = np.logspace(-2, 3.5, 4000) * 1j


def scaled(factor):
    """The stairs with efforts in other units: the same wheel, driven by torque."""
    record = stair_record(0.2)
    return fit_law(Record("stairs", "nm", record.effort_t_s, factor * record.effort, record.speed_t_s,
                          record.speed_rad_s), windage=False)


def sensitivity(loop):
    """The peak of |S|: how much the loop makes of a disturbance at worst; 1 / distance to -1."""
    return float(np.max(np.abs(1.0 / (1.0 + loop))))


@pytest.mark.parametrize("factor", [0.01, 0.3])
def test_the_flywheel_loop_keeps_its_distance_from_instability(factor):
    fit = scaled(factor)
    gains = flywheel_gains(fit, CONFIG)
    assert gains.dead_s == pytest.approx(0.03 + 0.01 + 0.0025, abs=0.002)
    s = FREQUENCIES
    plant = np.exp(-s * gains.dead_s) / (fit.value("ka") * s + fit.value("kv"))
    assert 1.3 < sensitivity((gains.kp + gains.ki / s) * plant) < 1.75
    assert sensitivity(3.5 * (gains.kp + gains.ki / s) * plant) > 3.0         # the check can fail


def test_the_hood_loop_keeps_its_distance_wherever_the_hood_is():
    fit = scaled(0.01)
    gains = hood_gains(fit, CONFIG)
    assert gains.ki == 0.0
    s = FREQUENCIES
    for share in (1.0, 0.8):                                      # turns of the screw per degree: the fewest, and more
        deg_per_rad = share / fewest_rad_per_deg(CONFIG)
        plant = deg_per_rad * np.exp(-s * gains.dead_s) / (fit.value("ka") * s**2 + fit.value("kv") * s)
        assert sensitivity((gains.kp + gains.kd * s) * plant) < 2.0


def test_the_fewest_turns_are_really_the_fewest():
    hood = CONFIG.hood
    turns = 2 * np.pi / hood.screw_lead_m / hood.screw_gear
    angle = np.radians(hood.included_deg + np.linspace(hood.low_deg, hood.high_deg, 500))
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    slopes = turns * np.radians(1.0) * a * b * np.sin(angle) / np.sqrt(a * a + b * b - 2 * a * b * np.cos(angle))
    assert fewest_rad_per_deg(CONFIG) == pytest.approx(slopes.min(), rel=0.01)


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def stairs_csv(path, noise_rad_s=0.5):
    record = stair_record(noise_rad_s)
    rows = zip(record.speed_t_s, record.effort, record.speed_rad_s, strict=True)
    return write(path, "t_s,input_V,wheel_rad_s,note\n" + "".join(f"{100 + t:.3f},{u},{w:.5f},x\n" for t, u, w in rows))


def test_columns_are_found_by_their_units(tmp_path):
    record = load_steps(stairs_csv(tmp_path / "a.csv"))
    assert record.unit == "v" and record.speed_t_s[0] == 0.0 and len(record.effort) == len(record.speed_rad_s)
    other = load_steps(write(tmp_path / "b.csv", "t_s,motor_Nm,speed_rad_s\n0,1,2\n1,1,3\n"))
    assert other.unit == "nm" and list(other.speed_rad_s) == [2.0, 3.0]


@pytest.mark.parametrize(("text", "words"), [
    ("t_s,u_V,w_rad_s\n0,1,2\n0,1,3\n", "a.csv:3: column t_s: time does not go on"),
    ("t_s,u_V,w_rad_s\n0,1,2\n1,x,3\n", "a.csv:3: u_V: 'x' is not a finite number"),
    ("t_s,u_V,w_rad_s\n0,1,2\n1,1,nan\n", "a.csv:3: w_rad_s: 'nan' is not a finite number"),
    ("t_s,u_V,w_rad_s\n0,1,\n1,1,2\n", "a.csv:2: w_rad_s: is missing"),
    ("t_s,u_V,w_rad_s\n0,1,2,3\n", "a.csv:2: 4 cells"),
    ("t_s,u_V,w_rad_s\n0,1,2\n", "a.csv: 1 rows; expected at least 2"),
    ("t_s,u_V,v_V,w_rad_s\n0,1,2,3\n", r"a.csv:1: 2 columns end in _nm or _v \(u_V, v_V\)"),
    ("t_s,u_V,w_rpm\n0,1,2\n", "a.csv:1: 0 columns end in _rad_s"),
    ("time,u_V,w_rad_s\n0,1,2\n", "a.csv:1: column t_s is missing"),
    ("t_s,u_V,w_rad_s\n" + "".join(f"{i / 50},1,0\n" for i in range(100)), "0.0 s of motion")])
def test_a_bad_table_is_named_by_file_line_and_column(tmp_path, text, words, capsys):
    path = write(tmp_path / "a.csv", text)
    with pytest.raises(InputError, match=words):
        fit_law(load_steps(path), windage=False)
    assert main(["sysid", "--csv", str(path), "--quiet"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_door_answers_in_toml_that_says_what_it_is_worth(tmp_path, capsys):
    path = stairs_csv(tmp_path / "a.csv")
    assert main(["sysid", "--csv", str(path), "--quiet", "--report", str(tmp_path / "a.html")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("[feedforward]\nks_v = ")
    said = tomllib.loads(out)["feedforward"]
    for key, name in (("ks_v", "ks"), ("kv_v_s", "kv"), ("ka_v_s2", "ka")):
        assert said[key] == pytest.approx(TRUTH[name], rel=0.02)
    assert "R^2 0.99" in out and "90 %" in out
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page.count("<svg ") == 1 and page.index("[feedforward]") < page.index("<svg ")
    head = page[page.index("<body>"):page.index("[feedforward]")]
    assert "truearc sysid --csv" in head and hashlib.sha256(path.read_bytes()).hexdigest()[:16] in head
