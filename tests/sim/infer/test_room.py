"""Room for what the model gets wrong: curves as large as shots speak for, integrated out as random effects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from scipy.optimize import minimize

from truearc.errors import InputError
from truearc.sim.infer import belief as bel
from truearc.sim.infer import room
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.physics.catalogue import CURVE
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

OVER = {"distance_m": (2.0, 6.0), "hood_deg": (30.0, 60.0)}
CURVE_OVER = bel.Curve((0.1, *np.linspace(-0.2, 0.3, 2 * bel.SHAPES).tolist()), 0.0, over=OVER)
UNIT = np.array([0.5, 2.0])
OWNER = np.array([-1, -1, *[0] * 8, *[1] * 8])
PRECISION, CENTRE = np.diag([0.25, 4.0, *np.zeros(16)]), np.array([0.3, -0.2, *np.zeros(16)])


def linear_shots() -> tuple[np.ndarray, np.ndarray]:
    """Slopes [n, P] of shots by two numbers and the points of two curves, and what was seen, with noise of 1."""
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(150, 18)) / np.sqrt(8.0)
    truth = np.concatenate([[0.5, -0.1], rng.normal(size=8) * 0.4 * UNIT[0], rng.normal(size=8) * 1.5 * UNIT[1]])
    return slopes, slopes @ truth + rng.normal(size=150)


def test_curves_are_integrated_out_as_random_effects_are() -> None:
    """The posterior of the other numbers is that of generalised least squares with the curves' covariance in the noise.
    """
    slopes, seen = linear_shots()
    sd = np.array([0.2, 3.0])
    prior = room.with_sizes(PRECISION, OWNER, sd)
    covariance = np.linalg.inv(slopes.T @ slopes + prior)
    mean = covariance @ (slopes.T @ seen + prior @ CENTRE)
    noise = np.eye(150) + (slopes[:, 2:] * sd[OWNER[2:]]**2) @ slopes[:, 2:].T
    weighed = np.linalg.solve(noise, slopes[:, :2])
    alone = np.linalg.inv(slopes[:, :2].T @ weighed + PRECISION[:2, :2])
    assert np.allclose(covariance[:2, :2], alone)
    assert np.allclose(mean[:2], alone @ (weighed.T @ seen + PRECISION[:2, :2] @ CENTRE[:2]))


def test_curves_are_as_large_as_is_most_probable() -> None:
    """The marginal likelihood of what was seen, times the prior of PRIOR_M that counts as WEIGHT points, is at its top.
    """
    slopes, seen = linear_shots()

    def unlikely(log_sd: np.ndarray) -> float:
        own = room.UNIT_M / room.PRIOR_M * np.exp(log_sd)
        spread = np.concatenate([[2.0, 0.5], (np.exp(log_sd) * UNIT)[OWNER[2:]]])
        noise = np.eye(150) + (slopes * spread**2) @ slopes.T
        off = seen - slopes @ CENTRE
        size = float(off @ np.linalg.solve(noise, off) + np.linalg.slogdet(noise)[1])
        return 0.5 * size + 0.5 * room.WEIGHT * float((own**-2.0 + 2.0 * np.log(own)).sum())

    best = np.exp(minimize(unlikely, np.log([0.2, 0.2])).x)
    found = room.sizes_by_em(slopes.T @ slopes, slopes.T @ seen, PRECISION, CENTRE, OWNER, UNIT)
    assert found == pytest.approx(best, rel=0.02)
    assert best[1] > 2.0 * best[0]


def test_without_shots_curves_keep_the_size_of_their_prior() -> None:
    nothing = np.zeros((18, 18))
    sd = room.sizes_by_em(nothing, np.zeros(18), PRECISION, np.zeros(18), OWNER, UNIT)
    assert sd == pytest.approx(room.PRIOR_M / room.UNIT_M)


def test_shapes_vary_as_a_process_does_and_stay_beyond_the_range() -> None:
    x = np.array([2.0, 3.0, 4.3, 6.0, 9.0, np.nan])
    by = CURVE_OVER.by({"distance_m": x, "hood_deg": np.full(6, np.nan)}, 6)
    assert by.shape == (6, len(CURVE_OVER.points))
    assert (by[:, 0] == 1.0).all() and not by[:, 1 + bel.SHAPES:].any() and not by[5, 1:].any()
    assert np.array_equal(by[3], by[4])
    whole = bel.smooth(np.linspace(2.0, 6.0, 101), 2.0, 6.0)
    assert np.allclose(whole.mean(0), 0.0, atol=1e-9)
    apart = ((whole[0] - whole[50])**2).sum()                  # of two places half the range apart
    assert apart == pytest.approx(2.0 * (1.0 - np.exp(-0.5 * (0.5 / bel.LENGTH)**2)), rel=0.05)


def test_a_curve_over_ranges_comes_back_from_disk(tmp_path: Path) -> None:
    belief = replace(bel.point_belief({"free_speed": {"share": 1.0}}), curves={"free_speed": CURVE_OVER})
    replace(belief, provenance={"method": "x"}).save(tmp_path / "c.toml")
    assert bel.load_belief(tmp_path / "c.toml").curves == {"free_speed": CURVE_OVER}
    assert room.has_room(belief) and not room.has_room(bel.point_belief({"drag": {"cd": 0.5}}))
    (line,) = belief.lines()
    assert "room for errors of the model" in line and "share" not in line and "smooth over distance_m, hood_deg" in line
    backwards = {**OVER, "hood_deg": (60.0, 30.0)}
    for bad in (bel.Curve((0.1,), 0.0, over=OVER), structs.replace(CURVE_OVER, over=backwards)):
        with pytest.raises(InputError, match="over"):
            replace(belief, curves={"free_speed": bad}).save(tmp_path / "bad.toml")


def test_without_room_the_fit_is_what_it_was() -> None:
    """And with it, some number is in more doubt."""
    dataset = shoot(make_world({}, "L1", 60, 4, side=True)).in_order()
    bare = fit_believed(Launcher.of(dataset, ("gravity", "drag", "magnus")).shared_only())
    opened = room.open_room(bare, every_column(dataset))
    assert opened is not None and room.open_room(bare, {"distance_m": np.full(60, 4.0)}) is None
    found = opened.fitted
    own = np.array([not column.name.startswith(CURVE) for column in found.scores.columns])
    assert (~own).sum() == len(room.ROOM) * (1 + 3 * bel.SHAPES)
    sd, before = (np.sqrt(np.diag(one.scores.covariance)) for one in (found, bare))
    assert (sd[own] > 1.2 * before).any()
    owner = np.where(own, -1, 0)
    owner[[column.kind == "group" for column in found.scores.columns]] = 1       # balls differ as they were taken to
    none = room.sized(found.model, owner, np.array([1e-9, 1.0]))
    scores = none.linearise(none.extended(bare.point))[0]
    assert np.allclose(scores.score[:, own], bare.scores.score, atol=1e-6)
    assert scores.log_score == pytest.approx(bare.scores.log_score)
    assert np.sqrt(np.diag(scores.covariance))[own] == pytest.approx(before, rel=1e-6)


@pytest.mark.parametrize(("effects", "low", "high"), [({"ball_spread": 0.03}, 0.02, 0.045), ({}, 0.0, 0.018)])
def test_balls_differ_as_much_as_these_do(effects: dict[str, float], low: float, high: float) -> None:
    """A belief says so, and a later session's fit takes its balls to differ by that."""
    dataset = shoot(make_world(effects, "L1", 240, 6, side=True)).in_order()
    bare = fit_believed(Launcher.of(dataset, ("gravity", "drag", "magnus")).shared_only())
    opened = room.open_room(bare, every_column(dataset))
    assert opened is not None and set(opened.balls) == {"speed", "drag.cd"}
    assert low < opened.balls["speed"] < high
    belief = replace(bel.point_belief({"gravity": {}, "drag": {"cd": 0.5}, "magnus": {"cl": 0.1}}), balls=opened.balls)
    groups = Launcher.of(dataset, ("gravity", "drag", "magnus"), belief=belief).layout.groups
    assert groups is not None and groups.scale.tolist() == list(opened.balls.values())


def test_what_balls_differ_by_comes_back_from_disk(tmp_path: Path) -> None:
    belief = replace(bel.point_belief({"drag": {"cd": 0.5}}), balls={"speed": 0.01, "drag.cd": 0.02})
    belief.save(tmp_path / "c.toml")
    assert bel.load_belief(tmp_path / "c.toml").balls == belief.balls
    assert bel.from_table(bel.as_table(belief), "x").balls == belief.balls
    for bad in ({"mass": 0.1}, {"speed": 0.0}):
        with pytest.raises(InputError, match="balls"):
            replace(belief, balls=bad).save(tmp_path / "bad.toml")
