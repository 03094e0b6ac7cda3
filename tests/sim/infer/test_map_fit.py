"""The fit on shots of other code: what it recovers, what it says of what it cannot, and what it leaves out."""

import dataclasses

import msgspec
import numpy as np
import pytest

import truearc.sim.infer.fit
from tests.sim.infer.independent import CENTRE_M, Truth, heights, make_dataset, make_tracks
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Tracker
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.infer.fit_report import aliased_pairs, cross_validate
from truearc.sim.infer.intervals import Profile, profile_interval
from truearc.sim.infer.launcher import MapFit, fit_map
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.statistics import Z90

TERMS = ("drag", "magnus", "exit_efficiency")
TRUTH = Truth()
TRUE = {"drag.cd": TRUTH.cd, "magnus.cl": TRUTH.cl, "exit_efficiency.loss": TRUTH.loss,
        "scatter.speed": TRUTH.speed_sd, "scatter.elevation_deg": TRUTH.elevation_sd_deg}


@pytest.fixture(scope="module")
def outcomes() -> MapFit:
    return fit_map(make_dataset(11, 100), TERMS)


def test_outcomes_alone_recover_what_is_behind_them(outcomes):
    assert outcomes.converged
    for name, value in TRUE.items():
        assert deviance_at(outcomes, name, value) < 9.0          # three standard errors, each
    assert outcomes.values["drag.cd"] == pytest.approx(0.5, abs=0.2)
    assert outcomes.values["magnus.cl"] == pytest.approx(0.06, abs=0.015)


def test_the_optimum_is_one_whatever_the_order_of_shots(outcomes):
    dataset = make_dataset(11, 100)
    turned = dataclasses.replace(dataset, shots=dataset.shots.take(np.arange(100)[::-1]))
    again = fit_map(turned, TERMS)
    assert list(again.values.values()) == pytest.approx(list(outcomes.values.values()), rel=1e-3)
    assert fit_map(dataset, TERMS).values == outcomes.values


def deviance_at(fit: MapFit, name: str, value: float) -> float:
    """Twice the adjusted log posterior lost with one parameter held at `value`; at most 2.706 inside its interval."""
    one = fit.sought[fit.names.index(name)]
    walk = Profile(fit, one)
    there = walk.flown(walk.at(one.at(value) - float(fit.scores.point[one.column])).change)
    return 2.0 * (there.cost - walk.ground.cost)


@pytest.mark.slow
def test_sides_and_heights_know_more(outcomes):
    def doubt(fit: MapFit) -> float:
        return fit.covariance[fit.names.index("drag.cd")][fit.names.index("drag.cd")]

    side, height = (fit_map(make_dataset(11, 100, **{what: True}), TERMS) for what in ("side", "height"))
    assert side.converged and height.converged
    assert doubt(height) < doubt(side) < doubt(outcomes)
    for fit in (side, height):
        for name, value in TRUE.items():
            assert deviance_at(fit, name, value) < 9.0


def test_profiles_end_where_the_deviance_says(outcomes):
    for name in ("drag.cd", "scatter.speed"):
        found = profile_interval(outcomes, name)
        assert found.low90 < found.value < found.high90
        for end in (found.low90, found.high90):
            assert np.sqrt(deviance_at(outcomes, name, end)) == pytest.approx(Z90, rel=0.03)
        assert found.closed and found.low_by_data and found.high_by_data


def test_a_prior_that_closes_an_interval_is_told(outcomes):
    """The angle's scatter moves heights less than the speed's: outcomes do not bound it on both sides."""
    found = profile_interval(outcomes, "scatter.elevation_deg")
    assert not (found.low_by_data and found.high_by_data)
    place = outcomes.names.index("scatter.elevation_deg")
    assert np.sqrt(outcomes.covariance[place, place]) > 0.5


def test_held_out_outcomes_are_predicted_better_than_by_their_shares(outcomes):
    score = cross_validate(outcomes)
    assert score.shots == 100
    assert score.groups > 95         # random configurations
    assert score.log_score > score.share_log_score + 2 * score.gain_se
    assert score.accuracy > score.share_accuracy


@pytest.mark.slow
def test_slip_and_loss_at_one_speed_are_one_number():
    """u (1 - loss) / (1 + k u) at a single u: only d k + (1 + k u) / (u (1 - loss)) d loss moves the ball."""
    ratio = 0.6
    dataset = make_dataset(12, 100, height=True)
    same = dataset.shots.numbers | {"motor_ratio": np.full(100, ratio)}
    rng = np.random.default_rng(12)
    speed, spin = reference.exit_of(ratio)
    flown = heights(same["distance_m"], speed * 0.75 * np.exp(rng.normal(0, 0.015, 100)), np.radians(same["hood_deg"]),
                    spin, TRUTH) - CENTRE_M
    shots = Shots(dataset.shots.shot_id, same | {"miss_height_m": flown}, {})
    fit = fit_map(Dataset("d", GUPPY, shots), (*TERMS, "wheel_slip"))
    pair = next(one for one in aliased_pairs(fit) if {one.a, one.b} == {"wheel_slip.loss_per_m_s",
                                                                         "exit_efficiency.loss"})
    loss, k = fit.values["exit_efficiency.loss"], fit.values["wheel_slip.loss_per_m_s"]
    per_loss = (1 + k * speed) / (speed * (1 - loss))
    assert pair.correlation < -0.9
    assert pair.factor == pytest.approx(per_loss if pair.a.startswith("wheel") else 1 / per_loss, rel=0.25)


@pytest.mark.slow
def test_tracks_recover_coefficients_scatter_and_noise():
    tracks = make_tracks(21, 12)
    fit = fit_map(tracks, TERMS)
    assert fit.converged
    assert fit.fitted.model.data.used == {"tracks": 12}
    for name, value in (TRUE | {"track_scale.share": 0.0, "track_tilt.angle_deg": 0.0}).items():
        assert deviance_at(fit, name, value) < 9.0
    assert fit.fitted.model.data.scatter.sigma_m[[0, 2]] == pytest.approx(0.012, rel=0.1)
    assert "track_scale.share" not in fit.belief.names
    rig = msgspec.structs.replace(GUPPY, tracker=Tracker(calibrated=True))
    sure = fit_map(dataclasses.replace(tracks, facts=rig), TERMS)
    assert sure.values["drag.cd"] == pytest.approx(0.5, abs=0.06)
    doubts = [one.covariance[one.names.index("drag.cd"), one.names.index("drag.cd")] for one in (fit, sure)]
    assert doubts[1] < 0.7 * doubts[0]


@pytest.mark.slow
def test_thrown_balls_need_no_launcher():
    rig = msgspec.structs.replace(GUPPY, launcher=msgspec.structs.replace(GUPPY.launcher, wheel=()))
    fit = fit_map(dataclasses.replace(make_tracks(22, 8, wheels=False), facts=rig), ("drag",))
    assert fit.converged
    assert fit.names == ("drag.cd", "track_scale.share", "track_tilt.angle_deg", "track_clock.share")
    assert deviance_at(fit, "drag.cd", 0.5) < 9.0
    assert fit.belief.scatter == {}


def test_a_mixed_dataset_uses_each_shot_for_what_it_has():
    n, nan = 8, np.nan
    numbers = {"distance_m": np.full(n, 4.0), "hood_deg": np.full(n, 45.0), "motor_ratio": np.full(n, 0.6),
               "miss_height_m": np.array([0.1] + [nan] * (n - 1)),
               "exit_speed_m_s": np.array([nan, 9.5] + [nan] * (n - 2))}
    numbers["motor_ratio"][2] = nan
    numbers["distance_m"][3] = nan
    texts = {"outcome": ("two", "two", "two", "two", "miss", "", "three", "miss"),
             "side": ("high", "low", "", "", "left", "", "", "low")}
    tracks = Tracks(np.zeros(3, np.int64), np.arange(3) * 0.02, *np.ones((3, 3)))
    shots = Shots(tuple("abcdefgh"), numbers, texts)
    intake = take_in(Dataset("d", GUPPY, shots, tracks), fewest=1)
    assert intake.used == {"outcome": 3, "miss_height_m": 1}
    assert [shots.shot_id[row] for row in intake.rows] == ["a", "b", "g", "h"]
    told = "\n".join(intake.left_out)
    for name, reason in (("c", "no launch speed"), ("d", "no distance_m"), ("e", "left or right"),
                         ("f", "nothing was seen")):
        assert any(reason in line and f"({name})" in line for line in intake.left_out), told


def test_nothing_to_fit_to_is_bad_input():
    shots = Shots(("a",), {"distance_m": np.array([4.0]), "hood_deg": np.array([45.0])}, {"outcome": ("two",)})
    with pytest.raises(InputError, match=r"^shots: there is nothing to fit to.*: no launch speed: motor_ratio"):
        fit_map(Dataset("d", GUPPY, shots), TERMS)
    with pytest.raises(InputError, match="no term 'dragg'"):
        fit_map(make_dataset(1, 20), ("dragg",))


def test_a_search_cut_short_does_not_claim_to_have_settled(monkeypatch):
    monkeypatch.setattr(truearc.sim.infer.fit, "ROUNDS", 1)
    assert not fit_map(make_dataset(11, 100), TERMS).converged


def test_one_height_that_is_a_slip_moves_nothing():
    """A height of 30 m among 60: as if it had not been recorded."""
    dataset = make_dataset(11, 60, height=True)
    height_m = dataset.shots.numbers["miss_height_m"].copy()
    clean = fit_map(dataclasses.replace(dataset, shots=dataset.shots.take(np.arange(1, 60))), TERMS).values
    height_m[0] = 30.0
    slipped = dataclasses.replace(dataset.shots, numbers=dataset.shots.numbers | {"miss_height_m": height_m})
    found = fit_map(dataclasses.replace(dataset, shots=slipped), TERMS).values
    assert list(found.values()) == pytest.approx(list(clean.values()), rel=0.05)


def test_a_fit_starts_far_from_its_heights_and_still_fits_them_all():
    """No height may be written off as a slip because the prior's centre is far from it."""
    dataset = make_dataset(12, 60, dataclasses.replace(TRUTH, loss=0.5), height=True)
    fit = fit_map(dataset, TERMS)
    assert deviance_at(fit, "exit_efficiency.loss", 0.5) < 9.0
