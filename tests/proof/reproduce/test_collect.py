"""What is collected for a reproduction: aims, draws, sessions, and one that was broken off and goes on."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.proof.reproduce.pools import CONFIG, FACTS, SMALL, Launcher
from truearc.errors import InputError
from truearc.robot.aim_file import with_plan
from truearc.robot.config.schema import Prescribed
from truearc.robot.recording.session import load_trials
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.synthetic import AXES
from truearc.sim.physics.simulate import classify, predict
from truearc_proof.reproduce import Settings, collect
from truearc_proof.reproduce.collect import Recording

SHARES = {"three": 0.5, "two": 0.2, "miss": 0.3}
RISE_M = FACTS.target.centre_height_m - FACTS.launcher.release_height_m


def share(distance_m, hood_deg):
    """What is left of the wheels' speed: a launcher nobody told the aiming about."""
    return 0.8 - 0.02 * (distance_m - 5.0) - 0.002 * (hood_deg - 45.0)


def pass_height_m(shots, speed_error):
    """Height beside the centre of a drag-free parabola (closed form) from that launcher."""
    d, angle = shots.number("distance_m"), np.radians(shots.number("hood_deg"))
    wheels_m_s = collect.exit_seed(FACTS, shots.number("motor_ratio"), 0.0).speed_m_s
    v = wheels_m_s * share(d, np.degrees(angle)) * np.exp(speed_error)
    return d * np.tan(angle) - 9.81 * d**2 / (2.0 * (v * np.cos(angle))**2) - RISE_M


def practice(count, seed, scatter=0.004):
    rng = np.random.default_rng(seed)
    d, hood_deg = rng.uniform(2.6, 8.0, count), rng.uniform(44.0, 54.0, count)
    angle = np.radians(hood_deg)
    v = np.sqrt(9.81 * d**2 / (2.0 * np.cos(angle)**2 * (d * np.tan(angle) - RISE_M)))
    ratio = v / share(d, hood_deg) / collect.exit_seed(FACTS, 1.0, 0.0).speed_m_s
    ratio *= 1.0 + rng.uniform(-0.08, 0.10, count)
    shots = Shots(tuple(map(str, range(count))), {"distance_m": d, "hood_deg": hood_deg, "motor_ratio": ratio}, {})
    up_m = pass_height_m(shots, rng.normal(0.0, scatter, count))
    outcome = np.select([np.abs(up_m) <= 0.07, np.abs(up_m) <= 0.35], ["three", "two"], "miss")
    side = np.where(outcome == "miss", np.where(up_m > 0.0, "high", "low"), "")
    return Shots(shots.shot_id, shots.numbers, {"outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())})


@pytest.mark.parametrize("seed", [1, 2])
def test_proposals_land_where_they_are_meant_to(seed):
    aiming = collect.learn_aiming(FACTS, practice(300, seed))
    rows = collect.propose(FACTS, CONFIG.collect, aiming, SHARES, 300, np.random.default_rng(seed))
    assert [row.distance_m for row in rows] == sorted(row.distance_m for row in rows)
    columns = {name: np.array([getattr(row, name) for row in rows]) for name in
               ("distance_m", "hood_deg", "motor_ratio")}
    shots = Shots(tuple(map(str, range(300))), columns, {})
    assert all(2.6 <= row.distance_m <= 8.0 and 0.0 < row.motor_ratio <= 1.0
               and CONFIG.hood.low_deg <= row.hood_deg <= CONFIG.hood.high_deg for row in rows)
    practised = columns["hood_deg"] >= 44.0
    up_m = np.abs(pass_height_m(shots, 0.0))[practised]
    assert np.mean(up_m <= 0.07) == pytest.approx(SHARES["three"], abs=0.12)
    assert np.mean(up_m > 0.35) == pytest.approx(SHARES["miss"], abs=0.1)


def test_without_misses_on_both_sides_nothing_is_learnt():
    shots = practice(200, 3)
    kept = np.array([side != "low" for side in shots.text("side")])
    assert collect.learn_aiming(FACTS, shots.take(kept)) is None


def test_what_is_lacking_is_meant_and_what_is_not_is_left():
    shares = collect.intentions({"three": 20, "two": -3, "miss": 10})
    assert shares["two"] == 0.0 and shares["three"] > 2.0 * shares["miss"] > 0.0
    assert sum(shares.values()) == pytest.approx(1.0)
    assert sum(collect.intentions({"three": 0, "two": 0, "miss": 0}).values()) == pytest.approx(1.0)


SETTINGS = Settings(base_seed=5)


def shots(column, **counts):
    outcomes = tuple(outcome for outcome, count in counts.items() for _ in range(count))
    return Shots(tuple(map(str, range(len(outcomes)))), {}, {column: outcomes})


REAL = shots("outcome", miss=90, two=120, three=80)
LAUNCHED = shots("simulated", miss=60, two=40, three=30)


def test_a_draw_is_the_papers_100_and_50_even_by_outcome():
    drawn = collect.draw(REAL, LAUNCHED, SETTINGS, 3)
    assert (len(drawn.train), len(drawn.test), len(drawn.validation), len(drawn.transfer)) == (80, 20, 16, 50)
    for rows, column, pool in ((drawn.train, "outcome", REAL), (drawn.test, "outcome", REAL),
                               (drawn.validation, "outcome", REAL), (drawn.transfer, "simulated", LAUNCHED)):
        counts = [np.array(pool.text(column))[rows].tolist().count(kind) for kind in ("miss", "two", "three")]
        assert max(counts) - min(counts) <= 1, counts
    assert not set(drawn.train) & set(drawn.test) and set(drawn.validation) <= set(drawn.train)


def test_the_same_number_draws_alike_another_draws_otherwise():
    first, again, other = (collect.draw(REAL, LAUNCHED, SETTINGS, number) for number in (1, 1, 2))
    assert all(np.array_equal(*pair) for pair in zip(first, again, strict=True))
    assert not np.array_equal(first.test, other.test) and not np.array_equal(first.transfer, other.transfer)


@settings(deadline=None)
@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 30), st.integers(0, 60))
def test_a_rare_outcome_is_made_up_for_by_the_others(miss, two, three, count):
    outcomes = np.array(["miss"] * miss + ["two"] * two + ["three"] * three, dtype="U5")
    chosen = collect._even(outcomes, count, np.random.default_rng(0))
    assert len(chosen) == min(count, len(outcomes)) == len(set(chosen.tolist()))
    counts = {kind: int((outcomes[chosen] == kind).sum()) for kind in ("miss", "two", "three")}
    # water filling: nobody who is not exhausted has two fewer than another
    for kind, there in (("miss", miss), ("two", two), ("three", three)):
        assert counts[kind] == there or counts[kind] >= max(counts.values()) - 1


PLAN = with_plan(CONFIG, (Prescribed(4.0, 0.5, 47.0),), 1)


def record(folder, recordings):
    return collect.make_record(folder, 1, lambda what: lambda done, note: None)(recordings, "test")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    return folder, record(folder, [Recording("one", PLAN, 1, 7)])


def test_it_is_not_made_twice(recorded):
    folder, sessions = recorded
    before = (sessions[0] / "telemetry.mcap").stat().st_mtime_ns
    assert record(folder, [Recording("one", PLAN, 1, 7)]) == sessions
    assert (sessions[0] / "telemetry.mcap").stat().st_mtime_ns == before


@pytest.mark.parametrize("other", [Recording("one", PLAN, 1, 8), Recording("one", PLAN, 2, 7),
                                   Recording("one", with_plan(CONFIG, (), 1), 1, 7)])
def test_one_of_something_else_is_never_taken_for_it(recorded, other):
    with pytest.raises(InputError, match="one: recorded with other settings"):
        record(recorded[0], [other])


def test_one_that_was_broken_off_is_recorded_anew(recorded):
    folder, sessions = recorded
    whole = (sessions[0] / "telemetry.mcap").read_bytes()
    (sessions[0] / collect.DONE).unlink()
    (sessions[0] / "telemetry.mcap").write_bytes(whole[:1000])
    record(folder, [Recording("one", PLAN, 1, 7)])
    assert (sessions[0] / "telemetry.mcap").read_bytes() == whole


def test_sessions_recorded_by_other_processes_are_known_again(tmp_path):
    """Worker processes get configurations by pickle, in which a default is an equal value and another object."""
    recordings = [Recording(name, CONFIG, 1, seed) for name, seed in (("one", 7), ("two", 8))]
    sessions = collect.make_record(tmp_path, 2, lambda what: lambda done, note: None)(recordings, "test")
    assert [len(load_trials(session)) for session in sessions] == [1, 1]


FEW = replace(SMALL, practice_trials=75, session_rows=12, most_rounds=6, launched=24)
NO_PROGRESS = staticmethod(lambda done, note: None).__func__


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    launcher = Launcher(tmp_path_factory.mktemp("collect"))
    return launcher, collect.collect(CONFIG, FEW, launcher, NO_PROGRESS)


def test_every_outcome_is_there_as_often_as_asked_each_session_by_a_seed_of_its_own(collected):
    launcher, pool = collected
    assert any(name.startswith("launched") for name in launcher.made)
    assert len(set(launcher.seeds)) == len(launcher.seeds) > 4
    outcomes = pool.real.shots.text("outcome")
    assert min(outcomes.count(kind) for kind in ("miss", "two", "three")) >= FEW.pool_each
    assert (pool.real.shots.number("repeats") == FEW.repeats).all()
    assert pool.real.facts == FACTS


def test_what_was_launched_is_on_the_seeds_grid_within_reach_and_knows_what_was_simulated(collected):
    _, pool = collected
    shots = pool.launched.shots
    assert 0 < len(shots) <= FEW.launched
    for axis in AXES:
        values = shots.number(axis.name)
        low, high = collect.LAUNCHABLE[axis.name]
        assert (values >= low - 1e-9).all() and (values <= high + 1e-9).all()
        assert np.allclose(values * axis.per_unit, np.rint(values * axis.per_unit), atol=1e-6)
    assert set(shots.text("simulated")) == {"miss", "two", "three"}
    assert tuple(classify(FACTS, predict(FACTS, pool.coefficients, shots).height_m)) == shots.text("simulated")


def test_a_broken_off_collection_goes_on_and_comes_to_the_same(collected, tmp_path):
    launcher, pool = collected
    again = Launcher(tmp_path)
    kept = [name for name in launcher.made if not name.startswith("launched")][:-1]
    for name in kept:
        shutil.copytree(launcher.folder / name, tmp_path / name)
    repeated = collect.collect(CONFIG, FEW, again, NO_PROGRESS)
    assert again.asked == launcher.asked and set(again.made) == set(launcher.made) - set(kept)
    assert repeated.real.shots.shot_id == pool.real.shots.shot_id
    assert np.array_equal(repeated.launched.shots.number("motor_ratio"), pool.launched.shots.number("motor_ratio"))


def test_too_little_is_told_with_what_there_is(tmp_path):
    few = replace(FEW, most_rounds=1, session_rows=3)
    with pytest.raises(InputError, match=r"4 sessions gave \d+ miss, \d+ two, \d+ three: too few"):
        collect.collect_real(CONFIG, few, Launcher(tmp_path))
