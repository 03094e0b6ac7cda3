"""What data could tell: against least squares, the non-central chi-squared, facts of the flight; the two doors."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import multivariate_normal, norm

import truearc.cli.main as truearc
from tests.sim.discover.made import make_linear, shared, term
from tests.sim.discover.worlds import FACTS
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset, save_rig
from truearc.sim.discover.identifiability import (
    TAKEN,
    Sight,
    TermIdentifiability,
    foresee,
    foresee_dataset,
    rehearse,
    sight_of,
)

BELIEVED = ("gravity", "drag", "magnus")
FLAT = np.array([1e-12, 1e-12])


def by_name(sight: Sight) -> dict[str, TermIdentifiability]:
    return {one.term: one for one in sight.terms}


@given(st.integers(0, 10_000), st.integers(6, 30), st.floats(0.1, 3.0))
def test_what_is_left_is_what_least_squares_leaves(seed: int, n: int, usual: float) -> None:
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(n, 2, 4))
    columns = (term("a", usual), term("b", usual), shared("p"), shared("q"))
    sight = by_name(sight_of(make_linear(slopes, columns, FLAT), "L0", ()))
    rows = slopes.reshape(-1, 4)
    left = rows[:, :2] - rows[:, 2:] @ np.linalg.lstsq(rows[:, 2:], rows[:, :2], rcond=None)[0]
    square = left.T @ left
    assert sight["a"].information == pytest.approx(square[0, 0], rel=1e-6)
    assert sight["a"].share_left == pytest.approx(square[0, 0] / (rows[:, 0] ** 2).sum(), rel=1e-6)
    assert sight["a"].like == "b"
    assert sight["a"].correlation == pytest.approx(square[0, 1] / np.sqrt(square[0, 0] * square[1, 1]), abs=1e-6)
    force = square[0, 0] * usual**2
    # 3 % of false alarms, of the two terms' larger: both scores below the threshold, by their joint normal
    rho = sight["a"].correlation
    both = multivariate_normal(cov=[[1.0, rho], [rho, 1.0]], allow_singular=True)
    threshold = brentq(lambda z: 1.0 - both.cdf([z, z], lower_limit=[-z, -z]) - 0.03, 1.0, 4.0, xtol=1e-4)
    power = norm.sf(threshold - force**0.5) + norm.sf(threshold + force**0.5)
    assert sight["a"].power == pytest.approx(power, abs=0.04)
    needed = n * (threshold + norm.ppf(0.8))**2 / force
    assert sight["a"].shots_needed is not None
    assert 0.92 * needed <= sight["a"].shots_needed <= 1.08 * needed + 1.0         # rounded up to a whole shot


def test_copies_are_one_class_and_what_the_fit_mimics_is_never_seen() -> None:
    rng = np.random.default_rng(2)
    a, free, p, q = rng.normal(size=(4, 60))
    parts = [a, -2.0 * a + 0.01 * rng.normal(size=60), free, 3.0 * p, 0.0 * p, p, q]
    columns = (*(term(name) for name in ("a", "copy", "free", "mimic", "idle")), shared("p"), shared("q"))
    sight = sight_of(make_linear(np.stack(parts, axis=1)[:, None], columns, np.ones(2)), "L0", ())
    assert sight.classes == (("a", "copy"),)
    mimic, idle = by_name(sight)["mimic"], by_name(sight)["idle"]
    assert (mimic.why, mimic.taken_by, mimic.shots_needed, mimic.power) == (TAKEN, ("p",), None, 0.0)
    assert (idle.why, idle.taken_by) == ("untouched", ())
    assert by_name(sight)["free"].why is None


def test_outcomes_cannot_tell_the_target_from_the_release_height() -> None:
    outcomes = foresee(FACTS, BELIEVED, "L0", 120)
    assert any({"target_height", "release_height"} <= set(group) for group in outcomes.classes)
    seen = by_name(outcomes)
    # a quicker ball is a lighter one to outcomes: gravity's scale is that of the speed squared
    assert any({"exit_efficiency", "buoyancy"} <= set(group) for group in outcomes.classes)
    assert seen["battery_sag"].why == seen["wind_y"].why == seen["track_tilt"].why == "untouched"
    assert (seen["ball_compression"].why, seen["ball_compression"].taken_by) == (TAKEN, ("magnus.cl",))
    assert not {one.term for one in outcomes.terms} & set(BELIEVED)


def test_tracks_see_spin_and_crosswind_but_never_weight_from_added_mass() -> None:
    tracks = foresee(FACTS, BELIEVED, "L2", 40)
    seen = by_name(tracks)
    for name in ("spin_decay", "wind_y", "wind_z"):
        assert seen[name].power > 0.99, name
    assert any({"buoyancy", "added_mass"} <= set(group) for group in tracks.classes)
    assert not any({"target_height", "release_height"} <= set(group) for group in tracks.classes)
    assert {"track_scale.share", "track_tilt.angle_deg", "track_clock.share"} <= {one.name for one in tracks.fitted}
    # of balls' own speeds only the size is uncertain, and a size has no slope
    assert seen["ball_spread"].shots_needed is None


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="level 'L7'"):
        foresee(FACTS, BELIEVED, "L7", 50)
    with pytest.raises(InputError, match="reach the target"):
        rehearse(_with_target(FACTS, Target(60.0)), BELIEVED, "L0", 20)
    blank = replace(rehearse(FACTS, BELIEVED, "L0", 20), shots=Shots(tuple("abcdefghijkl"), {}, {}))
    with pytest.raises(InputError, match="no shot can say anything: distance_m"):
        foresee_dataset(blank, BELIEVED)
    with pytest.raises(InputError, match=r"\[target\]"):
        rehearse(_with_target(FACTS, None), BELIEVED, "L1", 20)
    thrown = rehearse(_with_target(FACTS, None), BELIEVED, "L2", 20)
    assert isinstance(thrown, Dataset) and thrown.tracks is not None


def _with_target(facts: Rig, target: Target | None) -> Rig:
    return msgspec.structs.replace(facts, target=target)


def test_before_any_data_a_rig_is_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, page, rig = tmp_path / "out.json", tmp_path / "out.html", tmp_path / "rig.toml"
    save_rig(rig, FACTS)
    assert truearc.main(["identifiability", str(rig), "--shots", "64", "--json", str(out), "--report",
                         str(page), "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("64 shots of this kind (L0)") and "never seen: battery_sag" in shown
    answer = json.loads(out.read_text())
    assert answer["schema"] == "truearc.identifiability/1" and answer["believed"] == list(FACTS.believe.terms)
    assert {one["term"] for one in answer["terms"]} & {"drag", "gravity"} == set()
    assert "rig.toml" in page.read_text() and "<svg " in page.read_text()


def test_a_directory_of_settings_is_enough_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planned = rehearse(FACTS, BELIEVED, "L0", 64)
    bare = Dataset("plan", FACTS, type(planned.shots)(planned.shots.shot_id, planned.shots.numbers, {}))
    save_dataset(tmp_path / "plan", bare)
    assert truearc.main(["identifiability", str(tmp_path / "plan"), "--sides", "--quiet"]) == 0
    assert capsys.readouterr().out.startswith("64 shots of this kind (L0)")


def test_compiled_code_is_kept_where_the_user_keeps_things(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = jax.config.jax_compilation_cache_dir
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        blocked = tmp_path / "a file"
        blocked.write_text("")
        monkeypatch.setenv("HOME", str(blocked))
        keep_compiled()
        assert jax.config.jax_compilation_cache_dir is None
        monkeypatch.setenv("HOME", str(tmp_path))
        keep_compiled()
        assert Path(jax.config.jax_compilation_cache_dir).is_relative_to(tmp_path)
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "mine"))
        keep_compiled()
        assert jax.config.jax_compilation_cache_dir == str(tmp_path / "mine")
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
