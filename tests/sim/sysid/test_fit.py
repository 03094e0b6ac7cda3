"""The fit against exact solutions, against a strong solver, and against a team's own numbers of its flywheel."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.sim.sysid.wheel import TRUTH, stair_record
from truearc.errors import InputError
from truearc.sim.sysid import fit as sysid
from truearc.sim.sysid.session import load_steps

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


def test_the_line_for_feedforward_is_near_the_bent_friction():
    fit = sysid.fit_motion(bent_record(0.2)[0])
    ks, kv = sysid.line(fit)
    speeds = np.linspace(80.0, np.abs(fit.record.speed_rad_s).max(), 30)
    bent = fit.value("ks") + fit.value("kv") * speeds + fit.value("kq") * speeds**2
    assert np.abs(ks.value + kv.value * speeds - bent).max() < 0.12 * bent.max()


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
     "pieces .* are needed"),
])
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
