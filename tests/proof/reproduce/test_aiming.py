"""Aiming finds a launcher's own speed loss from marks alone, and its proposals land where they are meant to."""

import numpy as np
import pytest

from tests.proof.reproduce.pools import CONFIG, FACTS
from truearc.sim.data.dataset import Shots
from truearc_proof.reproduce.collect import exit_seed, intentions, learn_aiming, propose

SHARES = {"three": 0.5, "two": 0.2, "miss": 0.3}
RISE_M = FACTS.target.centre_height_m - FACTS.launcher.release_height_m


def share(distance_m, hood_deg):
    """What is left of the wheels' speed: a launcher nobody told the aiming about."""
    return 0.8 - 0.02 * (distance_m - 5.0) - 0.002 * (hood_deg - 45.0)


def pass_height_m(shots, speed_error):
    """Height beside the centre of a drag-free parabola (closed form) from that launcher."""
    d, angle = shots.number("distance_m"), np.radians(shots.number("hood_deg"))
    v = exit_seed(FACTS, shots.number("motor_ratio"), 0.0).speed_m_s * share(d, np.degrees(angle)) * np.exp(speed_error)
    return d * np.tan(angle) - 9.81 * d**2 / (2.0 * (v * np.cos(angle))**2) - RISE_M


def practice(count, seed, scatter=0.004):
    rng = np.random.default_rng(seed)
    d, hood_deg = rng.uniform(2.6, 8.0, count), rng.uniform(44.0, 54.0, count)
    angle = np.radians(hood_deg)
    v = np.sqrt(9.81 * d**2 / (2.0 * np.cos(angle)**2 * (d * np.tan(angle) - RISE_M)))
    ratio = v / share(d, hood_deg) / exit_seed(FACTS, 1.0, 0.0).speed_m_s * (1.0 + rng.uniform(-0.08, 0.10, count))
    shots = Shots(tuple(map(str, range(count))), {"distance_m": d, "hood_deg": hood_deg, "motor_ratio": ratio}, {})
    up_m = pass_height_m(shots, rng.normal(0.0, scatter, count))
    outcome = np.select([np.abs(up_m) <= 0.07, np.abs(up_m) <= 0.35], ["three", "two"], "miss")
    side = np.where(outcome == "miss", np.where(up_m > 0.0, "high", "low"), "")
    return Shots(shots.shot_id, shots.numbers, {"outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())})


@pytest.mark.parametrize("seed", [1, 2])
def test_proposals_land_where_they_are_meant_to(seed):
    aiming = learn_aiming(FACTS, practice(300, seed))
    rows = propose(FACTS, CONFIG.collect, aiming, SHARES, 300, np.random.default_rng(seed))
    assert [row.distance_m for row in rows] == sorted(row.distance_m for row in rows)
    columns = {name: np.array([getattr(row, name) for row in rows]) for name in
               ("distance_m", "hood_deg", "motor_ratio")}
    shots = Shots(tuple(map(str, range(300))), columns, {})
    practised = columns["hood_deg"] >= 44.0
    up_m = np.abs(pass_height_m(shots, 0.0))[practised]
    assert np.mean(up_m <= 0.07) == pytest.approx(SHARES["three"], abs=0.12)
    assert np.mean(up_m > 0.35) == pytest.approx(SHARES["miss"], abs=0.1)


def test_without_misses_on_both_sides_nothing_is_learnt():
    shots = practice(200, 3)
    kept = np.array([side != "low" for side in shots.text("side")])
    assert learn_aiming(FACTS, shots.take(kept)) is None


def test_proposals_can_be_shot():
    aiming = learn_aiming(FACTS, practice(200, 4))
    for row in propose(FACTS, CONFIG.collect, aiming, SHARES, 200, np.random.default_rng(0)):
        assert 2.6 <= row.distance_m <= 8.0 and 0.0 < row.motor_ratio <= 1.0
        assert CONFIG.hood.low_deg <= row.hood_deg <= CONFIG.hood.high_deg


def test_what_is_lacking_is_meant_and_what_is_not_is_left():
    shares = intentions({"three": 20, "two": -3, "miss": 10})
    assert shares["two"] == 0.0 and shares["three"] > 2.0 * shares["miss"] > 0.0
    assert sum(shares.values()) == pytest.approx(1.0)
    assert sum(intentions({"three": 0, "two": 0, "miss": 0}).values()) == pytest.approx(1.0)
