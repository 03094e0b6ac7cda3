"""What the sensors of a concealed world say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from truearc.robot.config.rig_spec import Noise
from truearc.sim.data.files import hash_dataset, load_dataset
from truearc_proof.truth.flight import wheel_dip
from truearc_proof.truth.generate import play, shoot, write
from truearc_proof.truth.world import DIRT, EFFECTS, LEVELS, make_world

# --- truth sensors

ALL = {effect.name: effect.typical for effect in EFFECTS}


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_written_reads_back_the_same(tmp_path, level):
    dirt = ("balls", "missing_frames", "noise_overstated")
    world = make_world({"wind_x": 0.8}, level, 40, seed=5, dirt=dirt, side=True)
    write(world, tmp_path / "world5")
    loaded, made = load_dataset(tmp_path / "world5"), shoot(world)
    assert hash_dataset(loaded) == hash_dataset(made) and loaded.name == made.name
    assert loaded.facts == made.facts
    assert (loaded.tracks is None, loaded.traces is None) == (level != "L2", level == "L0")
    columns = {"distance_m", "hood_deg", "motor_ratio", "t_s"}
    assert set(loaded.shots.numbers) == columns if level == "L0" else set(loaded.shots.numbers) > columns


def test_the_same_world_gives_the_same_bits_and_another_seed_another():
    worlds = [make_world(ALL, "L2", 20, seed, dirt=DIRT[:3]) for seed in (9, 9, 10)]
    first, again, other = (hash_dataset(shoot(world)) for world in worlds)
    assert first == again != other


def test_sensors_scatter_as_rig_toml_says():
    season = play(make_world(level="L2", shots=600, seed=11))
    shots, noise = season.dataset.shots, season.dataset.facts.noise
    lower = season.wheels_rad_s[0]
    for seen, true, sd in ((shots.number("distance_m"), season.plan.distance_m, noise.distance_m),
                           (shots.number("hood_deg"), season.plan.hood_deg, noise.hood_deg),
                           (shots.number("wheel_lower_rad_s"), lower, noise.wheel_rad_s)):
        assert stats.kstest((seen - true) / sd, "norm").pvalue > 1e-3
    aim = shots.number("motor_ratio") * 594.0
    assert np.std(lower / aim - 1.0) == pytest.approx(0.003, rel=0.15)


def track_noise(world):
    """Residuals [shots, 3, frames] of tracks whose frames are all there, in true units."""
    season, clean = play(world), play(replace(world, noise=Noise(0.03, 0.2, 0.5, 0.0)))
    seen, true = season.dataset.tracks, clean.dataset.tracks
    assert np.array_equal(seen.shot, true.shot)
    return seen.shot, np.stack([seen.x_m - true.x_m, seen.y_m - true.y_m, seen.z_m - true.z_m])


def test_track_noise_is_white_and_gaussian_unless_dirty():
    _, noise = track_noise(make_world(level="L2", shots=100, seed=12))
    assert stats.kstest(noise.ravel() / 0.015, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(noise[0, :-1], noise[0, 1:])[0, 1]) < 0.05
    shot, noise = track_noise(make_world(level="L2", shots=100, seed=12, dirt=("track_memory",)))
    next_to = shot[1:] == shot[:-1]
    assert np.corrcoef(noise[0, :-1][next_to], noise[0, 1:][next_to])[0, 1] == pytest.approx(0.8, abs=0.04)
    assert noise.std() == pytest.approx(0.015, rel=0.08)
    _, noise = track_noise(make_world(level="L2", shots=100, seed=12, dirt=("outliers",)))
    assert stats.kstest(noise.ravel() / 0.015, stats.t(3).cdf).pvalue > 1e-3


def test_frames_are_lost_and_views_clipped():
    whole, holes, cut = (play(make_world(level="L2", shots=200, seed=15, dirt=dirt)).dataset.tracks
                         for dirt in ((), ("missing_frames",), ("clipped",)))
    assert len(holes.t_s) / len(whole.t_s) == pytest.approx(0.75, abs=0.02)
    assert 0.5 < len(cut.t_s) / len(whole.t_s) < 0.8
    for tracks in (holes, cut):
        assert np.all(tracks.t_s[np.flatnonzero(np.diff(tracks.shot, prepend=-1))] == 0.0)


def test_two_percent_of_outcomes_are_noted_wrong():
    right, noted = (play(make_world(shots=2000, seed=16, dirt=dirt, side=True)).dataset.shots
                    for dirt in ((), ("outliers",)))
    wrong = [a != b for a, b in zip(right.text("outcome"), noted.text("outcome"), strict=True)]
    assert 25 <= sum(wrong) <= 57
    assert all((side == "") == (outcome == "three")
               for side, outcome in zip(noted.text("side"), noted.text("outcome"), strict=True))


@pytest.mark.parametrize(("dirt", "factor"), [("noise_understated", 0.5), ("noise_overstated", 2.0)])
def test_wrongly_stated_noise_changes_rig_toml_alone(dirt, factor):
    honest, lying = (shoot(make_world(level="L2", shots=30, seed=17, dirt=d)) for d in ((), (dirt,)))
    assert lying.facts.noise.track_m == factor * honest.facts.noise.track_m
    assert lying.facts.noise.distance_m == factor * honest.facts.noise.distance_m
    assert np.array_equal(lying.tracks.x_m, honest.tracks.x_m)


def test_traces_show_the_dip_of_the_wheels():
    season = play(make_world(level="L1", shots=60, seed=18))
    traces, dip = season.dataset.traces, wheel_dip(make_world(level="L1", shots=60, seed=18), season.plan,
                                                   season.wheels_rad_s)
    lower = np.array([signal == "wheel_lower_rad_s" for signal in traces.signal])
    for k in range(60):
        rows = lower & (traces.shot == k)
        before = traces.value[rows][traces.t_s[rows] < 0.1].mean()
        lowest = traces.value[rows][np.isclose(traces.t_s[rows], 0.14)][0]
        assert 1.0 - lowest / before == pytest.approx(dip[k], abs=0.012)
    assert 0.03 < dip.mean() < 0.12 and 0.2 < dip.std() / dip.mean() < 0.45


@pytest.mark.parametrize("name", ["distance_bias", "ball_wear", "wind_x"])
def test_the_operator_corrects_the_level_of_a_hidden_effect(name):
    off = play(make_world({name: 2.0 * ALL[name]}, shots=300, seed=20)).flown.arrival.height_m - 2.44
    assert abs(np.nanmedian(off)) < 0.12
