"""Systems of the user's own, against SciPy's integrator and worlds with a concealed effect."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

import truearc as ta
from tests.conftest import DATA
from truearc.cli.main import main
from truearc.sim.systems.files import load_runs
from truearc.sim.systems.noise import noise_gains, whiten
from truearc.sim.systems.score_table import SystemModel
from truearc.sim.systems.system import Believed

SAMPLES, STEP_S = 120, 0.02
Pushed = Callable[[float, float], float]


def rate(state: Any, inputs: Any, p: Any) -> Any:
    """A mass on a spring, in NumPy."""
    place, speed = state
    return speed, (inputs["force_n"] - p.k * place - p.c * speed) / inputs["mass_kg"]


def spring(**changed: Any) -> ta.System:
    """The believed mass on a spring."""
    given: dict[str, Any] = {"state": ["x_m", "v_m_s"], "observe": {"x_m": 0.002, "v_m_s": 0.01},
                             "believed": {"k": ta.positive(8.0, factor=2), "c": ta.positive(0.3, factor=3)}}
    return ta.System(**{"rate": rate, **given, **changed})


def frame(seed: int, runs: int = 12, push: Pushed = lambda x, v: 0.0, noise: float = 1.0) -> dict[str, np.ndarray]:
    """Runs of a mass on a spring (k 10, c 0.4) with a further force, by DOP853 at 1e-8."""
    rng, rows = np.random.default_rng(seed), []
    for run in range(runs):
        mass, t = rng.uniform(0.5, 2.0), STEP_S * np.arange(SAMPLES)
        force = np.repeat(rng.uniform(-4.0, 4.0, 6), SAMPLES // 6)

        def law(s: float, y: Any, force: np.ndarray = force, mass: float = mass) -> list[float]:
            at = force[min(int(s / STEP_S + 1e-9), SAMPLES - 1)]
            return [y[1], (at - 10.0 * y[0] - 0.4 * y[1] + push(y[0], y[1])) / mass]
        y = np.array([rng.uniform(-0.3, 0.3), 0.0])
        for k in range(SAMPLES):
            rows.append((run, t[k], force[k], mass, y[0] + 0.002 * noise * rng.normal(),
                         y[1] + 0.01 * noise * rng.normal()))
            y = solve_ivp(law, (t[k], t[k] + STEP_S * (1 - 1e-9)), y, method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
    return dict(zip(("run", "t_s", "force_n", "mass_kg", "x_m", "v_m_s"), np.array(rows).T, strict=True))


def runs_of(table: dict[str, np.ndarray], **changed: Any) -> ta.Runs:
    given: dict[str, Any] = {"inputs": ["force_n"], "conditions": ["mass_kg"]}
    return ta.Runs(table, **{**given, **changed})


def test_simulation_equals_scipys() -> None:
    table = frame(1, runs=3, noise=0.0)
    system = spring(believed={"k": ta.positive(10.0), "c": ta.positive(0.4)})
    found = system.simulate(runs_of(table))
    assert np.abs(found["x_m"] - table["x_m"]).max() < 1e-5
    assert np.abs(found["v_m_s"] - table["v_m_s"]).max() < 1e-4


def test_slopes_equal_differences_of_flights() -> None:
    from dataclasses import replace
    model = SystemModel.of(spring(), runs_of(frame(2, runs=3)), rows=1)
    point = model.starts()[0]
    flown = model.fly(point)
    for column, number in zip(model.layout.columns, model.layout.source, strict=True):
        if number < 0 or "delay" in column.name:         # of a recorded signal only straight lines between samples
            continue
        entry, size = model.entries[number], 1e-3 * column.usual
        ends = []
        for sign in (1.0, -1.0):
            values = point.values.copy()
            values[number] += sign * size
            ends.append(model.flights(replace(point, values=values)))
        there = (ends[0] - ends[1]) / (2.0 * size)
        own = flown.slopes[..., flown.slots.index(entry.slot)] * entry.weight[:, None, None]
        assert np.abs(there - own)[model.recording.real].max() <= 0.03 * np.abs(there).max() + 1e-12, column.name


def test_whitened_noise_has_the_likelihood_of_its_covariance() -> None:
    rng = np.random.default_rng(3)
    t, noise = np.arange(30) * 0.1, np.log([[0.5, 0.8, 0.4]])
    known = np.ones((1, 30, 1), dtype=bool)
    known[0, 7:9] = False
    gains = noise_gains(noise, np.full((1, 29), 0.1), known)
    covariance = 0.64 * np.exp(-np.abs(t[:, None] - t) / 0.4) + 0.25 * np.eye(30)
    seen = known[0, :, 0]
    covariance = covariance[np.ix_(seen, seen)]
    y = rng.normal(size=30)
    white = whiten(np.where(known, y[None, :, None], 0.0)[..., None], *gains)
    assert np.isclose((white**2).sum(), y[seen] @ np.linalg.solve(covariance, y[seen]))
    assert np.isclose(np.log(gains[1][known]).sum(), np.linalg.slogdet(covariance)[1])


def test_scores_are_marginal_likelihoods_and_pieces_add_up() -> None:
    model = SystemModel.of(spring(), runs_of(frame(2, runs=3)), rows=1)
    point = model.starts()[0]
    flown = model.fly(point)
    off, t = (model.recording.seen - flown.seen)[0], model.recording.time_s[0]
    covariance = block_diag(*(np.exp(2.0 * white) * np.eye(SAMPLES) + np.exp(
        2.0 * slow - np.abs(t[:, None] - t) / np.exp(time)) for white, slow, time in point.noise))
    by_start = np.concatenate([flown.by_start[0, :, k] for k in range(2)])
    whole, pieces = (model.linearise(point, flown, count)[0] for count in (1, 10))
    covariance += by_start @ by_start.T
    assert np.isclose(whole.log_score[0], multivariate_normal.logpdf(off.T.ravel(), cov=covariance))
    assert len(pieces.rows) == 10 * len(whole.rows) and np.isclose(pieces.log_score.sum(), whole.log_score.sum())
    np.testing.assert_allclose(pieces.score.sum(0), whole.score.sum(0), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(pieces.information, whole.information, rtol=1e-6, atol=1e-6)


def test_fit_finds_the_parameters_within_their_intervals() -> None:
    found = ta.fit(spring(), runs_of(frame(4)))
    assert found.converged
    rows = {row[0]: row[1:] for row in found.table().rows}
    for name, true in (("k", 10.0), ("c", 0.4)):
        value, low, high = rows[name]
        assert low < value < high and abs(value - true) < 2.0 * (high - low)
    assert "runs left out" in str(found)


@pytest.mark.slow
def test_dry_friction_is_found_and_adopted() -> None:
    friction = frame(5, push=lambda x, v: -0.3 * float(np.tanh(v / 0.01)))
    found = ta.discover(spring(), runs_of(friction), seed=0)
    assert found.record.set == ("force_n_sign_v_m_s",), str(found)
    size = found.effects[0].interval90
    assert size[0] <= -0.3 <= size[1], str(found)
    unseen = frame(6, push=lambda x, v: -0.3 * float(np.tanh(v / 0.01)))
    better, before = found.adopt(), ta.fit(spring(), runs_of(friction)).system
    errors = [np.sqrt(np.mean((one.simulate(runs_of(unseen))["x_m"] - unseen["x_m"])**2)) for one in (better, before)]
    assert errors[0] < 0.7 * errors[1]


@pytest.mark.slow
def test_end_stop_is_found_with_its_level() -> None:
    stop = frame(15, push=lambda x, v: -10.0 * max(x - 0.35, 0.0))
    found = ta.discover(spring(), runs_of(stop), seed=0)
    assert any(name.endswith("above_x_m") for name in found.record.set or ()), str(found)
    level = re.search(r"level (\d+\.\d+)", found.sentence)
    assert level is not None and abs(float(level[1]) - 0.35) < 0.02, str(found)


@pytest.mark.slow
def test_nothing_missing_is_mostly_reported_as_nothing() -> None:
    """At a rate of 5 %, three alarms of eight come once in 170 times."""
    said = [ta.discover(spring(), runs_of(frame(seed)), seed=0).verdict for seed in range(7, 15)]
    assert said.count("none") >= 6, said


def wrong_rate(kind: str) -> Callable[..., Any]:
    def law(state: Any, inputs: Any, p: Any) -> Any:
        place, speed = state
        size = (inputs["force_n"] - p.k * place - p.c * speed) / inputs["mass_kg"]
        return {"nan": (speed, size * np.nan), "one": (size,), "deaf": (speed, size + p.c * speed / inputs["mass_kg"])
                }[kind]
    return law


@pytest.mark.parametrize(("kind", "said"), [
    ("nan", "not finite for v_m_s in run"), ("one", "returned 1 value; expected 2, one per state"),
    ("deaf", "c changes nothing that is observed")])
def test_bad_rate_is_reported(kind: str, said: str) -> None:
    with pytest.raises(ta.InputError, match=said):
        ta.fit(spring(rate=wrong_rate(kind)), runs_of(frame(8, runs=2)))


def test_bad_runs_are_reported() -> None:
    table = frame(9, runs=6)
    back = {**table, "t_s": np.where(np.arange(len(table["t_s"])) == 5, 0.0, table["t_s"])}
    with pytest.raises(ta.InputError, match=r"run 0\.0: t_s goes back or stands still, from 0.08 to 0 s"):
        runs_of(back)
    with pytest.raises(ta.InputError, match="there is no column 'torque'"):
        runs_of(table, inputs=["torque"])
    slip = {**table, "x_m": np.where(table["run"] == 3, 1000.0, 1.0) * table["x_m"]}
    with pytest.raises(ta.InputError, match=r"run 3\.0: x_m is .* a unit and its thousandth may have been mixed"):
        ta.fit(spring(), runs_of(slip))
    with pytest.raises(ta.InputError, match="force_n varies within the run; a condition is constant"):
        runs_of(table, conditions=["force_n"])
    with pytest.raises(ta.InputError, match="start: v_m_s is not observed"):
        ta.fit(spring(observe={"x_m": 0.002}), runs_of(table))


def test_gaps_and_uneven_steps_are_noted() -> None:
    table = frame(10, runs=2)
    table["t_s"] = np.where((table["run"] == 1) & (table["t_s"] > 1.0), table["t_s"] + 1.0, table["t_s"])
    table["t_s"] = np.where((table["run"] == 0) & (np.arange(len(table["t_s"])) % 7 == 3), table["t_s"] + 0.005,
                            table["t_s"])
    notes = "\n".join(SystemModel.of(spring(), runs_of(table), rows=1, testing=False).recording.notes)
    assert "run 1.0: has 1 gaps in t_s, the first at 1 s; it is cut there" in notes
    assert "run 0.0: time steps differ by up to" in notes


def test_one_short_run_cannot_test() -> None:
    found = ta.discover(spring(), runs_of(frame(11, runs=1)), seed=0)
    assert found.p_value is None and "cannot test the simulator: 1 runs give 3 rows" in found.sentence


def test_identifiability_needs_no_outputs() -> None:
    table = frame(12, runs=10)
    inputs = {name: values for name, values in table.items() if name not in ("x_m", "v_m_s")}
    answer = ta.identifiability(spring(start={"x_m": ta.normal(0.0, sd=0.1), "v_m_s": ta.normal(0.0, sd=0.1)}),
                                runs_of(inputs))
    power = dict(zip(answer.table().column("candidate"), answer.table().column("power"), strict=True))
    assert 0.2 < power["v_m_s_sign_v_m_s"] < 0.9


def test_closed_program_is_fitted_by_differences() -> None:
    def closed(inputs: Any, parameters: Any, start: Any) -> Any:
        y, seen = np.array([start["x_m"], start["v_m_s"]]), []
        for force in inputs["force_n"]:
            seen.append(y)
            for _ in range(4):
                size = (force - parameters["k"] * y[0] - parameters["c"] * y[1]) / inputs["mass_kg"]
                speed = y[1] + 0.25 * STEP_S * size
                y = np.array([y[0] + 0.125 * STEP_S * (y[1] + speed), speed])
        return {"x_m": np.array(seen)[:, 0], "v_m_s": np.array(seen)[:, 1]}

    found = ta.fit(spring(rate=None, simulate=closed), runs_of(frame(13, runs=4)))
    assert abs({row[0]: row[1] for row in found.table().rows}["k"] - 10.0) < 0.3


def test_prior_of_a_positive_number_is_a_factor() -> None:
    assert ta.positive(5.0, factor=3) == Believed(5.0, float(np.log(3.0)), log=True)
    with pytest.raises(ta.InputError, match="expected a number above 0 and a factor above 1"):
        ta.positive(-1.0)


def test_command_ends_with_code_2_for_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = tmp_path / "spring.py"
    code.write_text("system = 3\ncolumns = {}\n")
    table = tmp_path / "runs.csv"
    table.write_text("run,t_s,x\n0,0,1\n")
    assert main(["discover", "--system", str(code), str(table)]) == 2
    assert "spring.py: system: got int; expected system = truearc.System(...)" in capsys.readouterr().err


@pytest.mark.parametrize(("rows", "said"), [
    ("0,0.0,1,2\n0,0.1,1,abc\n", r"runs\.csv:3: x_m: got 'abc'; expected a number"),
    ("0,0.0,1,2\n0,0.1,1\n", r"runs\.csv:3: has 3 cells; expected 4"),
    ("", r"runs\.csv: has no rows below its header")])
def test_bad_tables_of_runs_are_named_with_their_line(tmp_path: Path, rows: str, said: str) -> None:
    (tmp_path / "runs.csv").write_text("run,t_s,force_n,x_m\n" + rows)
    with pytest.raises(ta.InputError, match=said):
        load_runs(tmp_path / "runs.csv", {"run": "run", "time": "t_s", "inputs": ["force_n"]})


@pytest.mark.data
def test_real_servo_recordings_are_read(tmp_path: Path) -> None:
    (tmp_path / "servo.csv").write_bytes(gzip.decompress((DATA / "systems" / "servo_pendulum.csv.gz").read_bytes()))
    runs = load_runs(tmp_path / "servo.csv", {"run": "run", "time": "t_s", "inputs": ["goal_rad", "torque_on"],
                                              "conditions": ["mass_kg", "length_m", "kp"]})
    assert len(runs.labels) == 32 and np.isfinite(runs.number("position_rad")).all()


@pytest.mark.slow
def test_traced_rate_gives_the_same_answer() -> None:
    import jax.numpy as jnp

    def traced(state: Any, inputs: Any, p: Any) -> Any:
        place, speed = state
        return speed, (inputs["force_n"] - p.k * place - p.c * jnp.tanh(speed)) / inputs["mass_kg"]

    def plain(state: Any, inputs: Any, p: Any) -> Any:
        place, speed = state
        return speed, (inputs["force_n"] - p.k * place - p.c * np.tanh(speed)) / inputs["mass_kg"]
    runs, answers = runs_of(frame(14, runs=3)), []
    for law in (traced, plain):
        model = SystemModel.of(spring(rate=law), runs, rows=1)
        answers.append(model.fly(model.starts()[0]))
    assert np.allclose(answers[0].seen, answers[1].seen, atol=1e-9)
    assert np.allclose(answers[0].slopes, answers[1].slopes, atol=1e-4 * np.abs(answers[1].slopes).max())


@pytest.mark.slow
def test_tutorial_finds_its_dry_friction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).parents[3] / "docs" / "tutorials" / "your-simulator.md"
    record, system, fit, discover = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_system.py").write_text(system)
    names: dict[str, Any] = {}
    for code in (record, fit, discover):
        exec(code, names)
    assert names["found"].record.set == ("force_n_sign_v_m_s",)
    assert capsys.readouterr().out.startswith("parameter")
    assert main(["discover", "--system", "my_system.py", "runs.csv", "--report", "finding.html"]) == 0
    assert "dry friction" in (tmp_path / "finding.html").read_text(encoding="utf-8")
