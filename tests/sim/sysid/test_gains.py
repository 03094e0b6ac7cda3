"""Suggested gains against the loop's frequency response, tables of step tests, and the report."""

import hashlib
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from tests.robot.good_tick import CONFIG
from tests.sim.sysid.wheel import TRUTH, stair_record
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.sim.report import make_png
from truearc.sim.sysid.fit import Record, fit_law
from truearc.sim.sysid.html_report import draw_fit, make_fit_page
from truearc.sim.sysid.session import load_steps
from truearc.sim.sysid.sysid_text import fewest_rad_per_deg, flywheel_gains, hood_gains

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


def test_a_wheel_without_friction_by_speed_still_gets_gains():
    fit = scaled(0.01)
    numbers = fit.numbers | {"kv": SimpleNamespace(name="kv", value=-1e-9, sd=0.0)}
    odd = SimpleNamespace(record=fit.record, law=fit.law, rows=fit.rows, covariance=fit.covariance, numbers=numbers,
                          value=lambda name: numbers[name].value)
    gains = flywheel_gains(odd, CONFIG)
    assert gains.kp > 0.0 and gains.ki == pytest.approx(gains.kp / (8.0 * gains.dead_s))


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
    ("t_s,u_V,w_rad_s\n" + "".join(f"{i / 50},1,0\n" for i in range(100)), "0.0 s of motion"),
])
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
    assert page.count("data:image/png") == 1 and page.index("[feedforward]") < page.index("data:image/png")
    head = page[page.index("<body>"):page.index("[feedforward]")]
    assert "truearc sysid --csv" in head and hashlib.sha256(path.read_bytes()).hexdigest()[:16] in head


def test_the_picture_is_the_same_each_time_and_shows_the_residuals():
    fit = fit_law(stair_record(1.0), windage=False)
    figure = draw_fit(fit)
    residuals = figure.axes[2].lines[-1].get_ydata()
    assert len(residuals) == len(fit.rows) and abs(residuals.std() - fit.rms_rad_s) < 0.1
    assert make_png(draw_fit(fit)) == make_png(draw_fit(fit))
    assert "R^2" in make_fit_page("t", {"wheel": fit}, "[a]", ["a note"])
