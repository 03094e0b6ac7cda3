"""The data prepared from a dataset: which shots, how tracks scatter, measurements beside it, what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from tests.sim.discover.mixed import FLOWN, LANDED, MEASURED, SHOTS, THROWN, make_mixed
from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, NoisyTracks, Traces, Tracks
from truearc.sim.discover.select.terms import nats_measured
from truearc.sim.infer.likelihood import observations as obs
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, Intake, take_in
from truearc.sim.infer.likelihood.forward_model import DEVIATES
from truearc.sim.infer.likelihood.layout import Measurement, read_measured
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world


@pytest.fixture(scope="module")
def mixed() -> Dataset:
    return make_mixed()


@pytest.fixture(scope="module")
def intake(mixed: Dataset) -> Intake:
    return take_in(mixed)


def changed(dataset: Dataset, name: str, rows: np.ndarray, value: float) -> Dataset:
    column = dataset.shots.number(name).copy()
    column[rows] = value
    return replace(dataset, shots=replace(dataset.shots, numbers={**dataset.shots.numbers, name: column}))


def test_every_shot_brings_what_was_seen_of_it(intake: Intake) -> None:
    assert intake.rows.tolist() == list(range(SHOTS))
    assert intake.tracked.tolist() == np.setdiff1d(np.arange(SHOTS), LANDED).tolist()
    assert intake.marked.tolist() == np.setdiff1d(np.arange(SHOTS), [*FLOWN, *THROWN]).tolist()
    assert np.isfinite(intake.exits).all(1).nonzero()[0].tolist() == MEASURED.tolist()
    assert np.asarray(intake.lanes.free).nonzero()[0].tolist() == THROWN.tolist()
    assert intake.left_out == ()


def test_measured_exits_are_evidence_and_do_not_replace_wheels_and_hood(mixed: Dataset, intake: Intake) -> None:
    shots = mixed.shots
    rolled = (shots.number("wheel_lower_rad_s") * 0.0508 + shots.number("wheel_upper_rad_s") * 0.0349) / 2.0
    launched = np.setdiff1d(np.arange(SHOTS), THROWN)
    assert np.asarray(intake.lanes.rolling.speed_m_s)[launched] == pytest.approx(rolled[launched])
    assert intake.exits[MEASURED, 0] == pytest.approx(np.log(shots.number("exit_speed_m_s")[MEASURED]))
    assert intake.exits[MEASURED, 1] == pytest.approx(np.radians(shots.number("exit_deg")[MEASURED]))
    assert intake.exit_sd[MEASURED, 0] == pytest.approx(0.05 / shots.number("exit_speed_m_s")[MEASURED])


def test_doubt_is_the_sensors_own(intake: Intake) -> None:
    """By hand from rig.toml's noise: an encoder each, the hood, the distance; spin scatter and release by the house."""
    variance = dict(zip(DEVIATES, intake.noise_var.T, strict=True))
    row = int(LANDED[0])
    speed = float(np.asarray(intake.lanes.rolling.speed_m_s)[row])
    wheel = 0.5 * np.hypot(0.0508, 0.0349) / 2.0
    assert variance["log_speed"][row] == pytest.approx((wheel / speed)**2, rel=1e-6)
    assert variance["elevation_rad"][row] == pytest.approx(np.radians(0.2)**2)
    assert variance["distance_m"][row] == 0.0              # it is one of what scatters, by a multiple that is fitted
    assert variance["spin_share"][row] > 0.05**2
    assert (variance["vx_m_s"][THROWN] > 1.0).all() and variance["vx_m_s"][row] == 0.0
    assert (variance["log_speed"][THROWN] == 0.0).all() and (variance["elevation_rad"][THROWN] == 0.0).all()
    assert intake.scattered[row] == pytest.approx([1.0, 1.0, 1.0, 0.03**2, 1.0, 1.0])
    assert not intake.scattered[THROWN, :3].any()


def test_a_thrown_ball_starts_where_its_track_does(mixed: Dataset, intake: Intake) -> None:
    assert mixed.tracks is not None
    for row in THROWN:
        here = mixed.tracks.shot == row
        first = [float(column[here][0]) for column in (mixed.tracks.x_m, mixed.tracks.y_m, mixed.tracks.z_m)]
        assert np.asarray(intake.lanes.start_m)[row] == pytest.approx(first, abs=0.06)
        ahead = np.polyfit(mixed.tracks.t_s[here], mixed.tracks.x_m[here], 2)[1]
        assert np.asarray(intake.lanes.start_m_s)[row, 0] == pytest.approx(ahead, abs=1e-6)


def test_levels() -> None:
    plain, telemetry, tracked = (shoot(make_world({}, level, 12, 1)) for level in ("L0", "L1", "L2"))
    assert [take_in(one).level for one in (plain, telemetry, tracked)] == ["L0", "L1", "L2"]
    traces = Traces(np.arange(12), np.zeros(12), ("battery_v",) * 12, np.full(12, 12.0))
    assert take_in(replace(plain, traces=traces)).level == "L1"
    battery = {**plain.shots.numbers, "battery_v": np.linspace(12.0, 11.0, 12)}
    assert take_in(replace(plain, shots=replace(plain.shots, numbers=battery))).level == "L1"
    timed = {**plain.shots.numbers, "t_s": np.arange(12.0), "miss_height_m": np.full(12, 0.1)}
    assert take_in(replace(plain, shots=replace(plain.shots, numbers=timed))).level == "L0"


def test_what_is_left_out_is_said_and_counted(mixed: Dataset) -> None:
    blind = changed(mixed, "distance_m", LANDED[:3], np.nan)
    intake = take_in(blind)
    assert any(note.startswith(f"3 of {SHOTS} shots: no distance_m") for note in intake.left_out)
    assert set(range(SHOTS)) - set(intake.rows.tolist()) == set(LANDED[:3].tolist())
    assert mixed.tracks is not None
    short = ~((mixed.tracks.shot == FLOWN[0]) & (mixed.tracks.t_s > 0.05))
    cut = replace(mixed, tracks=Tracks(*(column[short] for column in vars(mixed.tracks).values())),
                  left_out=("row 3: no such ball",))
    said = take_in(cut)
    assert said.left_out[0] == "row 3: no such ball"
    assert any(note.startswith("1 tracks with fewer than") for note in said.left_out)
    assert FLOWN[0] not in said.rows


def test_bad_input_is_named(mixed: Dataset) -> None:
    few = replace(mixed, shots=mixed.shots.take(np.arange(FEWEST_SHOTS - 1)), tracks=None)
    with pytest.raises(InputError, match=f"{FEWEST_SHOTS - 1} shots are too few.*{FEWEST_SHOTS} at least"):
        take_in(few)
    facts = type(mixed.facts)(ball=mixed.facts.ball, launcher=mixed.facts.launcher, noise=mixed.facts.noise)
    with pytest.raises(InputError, match=r"centre_height_m: missing key"):
        take_in(replace(mixed, facts=facts))


SIGMA_M, MEMORY, N, LENGTH, STEP_S = 0.004, 0.6, 60, 50, 0.01


def noisy(memory: float, seed: int = 0) -> Tracks:
    """Parabolas with first-order autoregressive noise."""
    rng = np.random.default_rng(seed)
    t = STEP_S * np.arange(LENGTH)
    noise = rng.normal(0.0, SIGMA_M, (N, LENGTH, 3))
    for k in range(1, LENGTH):
        noise[:, k] = memory * noise[:, k - 1] + np.sqrt(1.0 - memory**2) * noise[:, k]
    path = np.stack([4.0 * t, 0.1 * t, 1.0 + 2.0 * t - 4.9 * t**2], axis=1) + noise
    return Tracks(np.repeat(np.arange(N), LENGTH), np.tile(t, N), *path.reshape(-1, 3).T)


def test_noise_with_memory_becomes_white() -> None:
    samples, _, _ = obs.gather_samples(noisy(MEMORY))
    scatter = obs.measure_scatter(samples, 1.0)
    assert np.allclose(np.exp(-STEP_S / scatter.memory_s), MEMORY, atol=0.04)
    assert np.allclose(scatter.sigma_m, SIGMA_M, rtol=0.06)
    t = samples.time_s
    truth = np.stack([4.0 * t, 0.1 * t, 1.0 + 2.0 * t - 4.9 * t**2], axis=2)
    white = obs.whiten(samples, scatter, (samples.position_m - truth)[..., None]).reshape(N, -1, 3)[:, 1:LENGTH]
    together = (white[:, 1:] * white[:, :-1]).mean() / (white**2).mean()
    assert abs(together) < 0.04
    assert white.std() == pytest.approx(1.0, abs=0.05)


def test_stated_noise_weighs_samples_by_their_ratio() -> None:
    tracks = noisy(0.0, 3)
    rough = np.arange(len(tracks.t_s)) % 4 == 0
    wider = np.where(rough, 4.0, 1.0)
    smooth = np.stack([4.0 * tracks.t_s, 0.1 * tracks.t_s, 1.0 + 2.0 * tracks.t_s - 4.9 * tracks.t_s**2])
    x_m, _, z_m = smooth + wider * (np.stack([tracks.x_m, tracks.y_m, tracks.z_m]) - smooth)
    y_m = np.zeros_like(x_m)
    stated = NoisyTracks(tracks.shot, tracks.t_s, x_m, y_m, z_m, 0.7 * wider, 0.2 * wider)
    samples, _, _ = obs.gather_samples(stated)
    assert samples.wider is not None and np.allclose(samples.wider[0, :5, 0], [4.0, 1.0, 1.0, 1.0, 4.0])
    assert np.allclose(obs.measure_scatter(samples, 1.0).sigma_m[[0, 2]], SIGMA_M, rtol=0.1)
    alike, _, _ = obs.gather_samples(Tracks(tracks.shot, tracks.t_s, x_m, y_m, z_m))
    assert (obs.measure_scatter(alike, 1.0).sigma_m[[0, 2]] > 1.5 * SIGMA_M).all()


def test_a_gross_sample_is_left_out_and_counted() -> None:
    tracks = noisy(0.0)
    z_m = tracks.z_m.copy()
    z_m[17] += 0.3
    samples, notes, gross = obs.gather_samples(Tracks(tracks.shot, tracks.t_s, tracks.x_m, tracks.y_m, z_m))
    assert gross == 1
    assert "1 track samples" in notes[0]
    assert samples.real.sum() == N * LENGTH - 1


def test_short_tracks_are_left_out_and_counted_and_padding_weighs_nothing() -> None:
    t = 0.01 * np.arange(10)
    shot = np.concatenate([np.zeros(10, int), np.full(4, 1), np.full(7, 2)])
    time_s = np.concatenate([t, t[:4], t[:7]])
    samples, notes, _ = obs.gather_samples(Tracks(shot, time_s, time_s, time_s, time_s))
    assert samples.rows.tolist() == [0, 2]
    assert "1 tracks with fewer" in notes[0]
    assert samples.real.sum(1).tolist() == [10, 7]
    white = obs.whiten(samples, obs.measure_scatter(samples, 0.01), np.ones((*samples.time_s.shape, 3, 1)))
    assert (white.reshape(2, -1, 3)[1, 7:] == 0.0).all()


def test_whitened_noise_has_the_density_of_the_big_normal() -> None:
    rng = np.random.default_rng(5)
    time_s = np.array([0.0, 0.01, 0.03, 0.035])
    scatter = obs.Scatter(np.array([0.004, 0.002, 0.01]), np.array([0.02, 0.0, 0.05]))
    noise = rng.normal(0.0, 0.005, (4, 3))
    samples = obs.Samples(np.zeros(1, int), np.append(time_s, [0.035, 0.035])[None], np.zeros((1, 6, 3)),
                      np.array([[True] * 4 + [False] * 2]))
    white = obs.whiten(samples, scatter, np.concatenate([noise, noise[-1:], noise[-1:]])[None, :, :, None])
    apart = np.abs(time_s[:, None] - time_s)
    exact = 0.0
    for axis, (sigma, memory) in enumerate(zip(scatter.sigma_m, scatter.memory_s, strict=True)):
        together = np.exp(-apart / memory) if memory else np.eye(4)
        exact += multivariate_normal.logpdf(noise[:, axis], cov=sigma**2 * together)
    assert obs.log_volume(samples, scatter)[0] - 0.5 * (white**2).sum() == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(("at", "lost"), [(20, 1), (20, 2), (35, 3)])
def test_stamps_of_a_track_with_lost_frames_are_put_right(at: int, lost: int) -> None:
    """Frames gone in the middle, and what follows stamped as if they were not: in one of ten tracks."""
    tracks = noisy(0.0)
    hurt = tracks.shot % 10 == 3
    frame = np.tile(np.arange(LENGTH), N)
    kept = ~(hurt & (frame >= at) & (frame < at + lost))
    t_s = np.where(hurt & (frame >= at), tracks.t_s - lost * STEP_S, tracks.t_s)
    damaged = Tracks(*(part[kept] for part in (tracks.shot, t_s, tracks.x_m, tracks.y_m, tracks.z_m)))
    samples, notes, _ = obs.gather_samples(damaged)
    for row in range(N):
        mine = tracks.shot == row
        assert samples.time_s[row][samples.real[row]] == pytest.approx(tracks.t_s[mine & kept], abs=1e-9)
    assert notes == (f"{N // 10} tracks that leap ahead as if frames had been lost in between: their stamps are put "
                     "right",)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), memory=st.sampled_from([0.0, MEMORY]), slow=st.sampled_from([1.0, 0.1]))
def test_noise_gaps_in_the_stamps_and_stray_samples_are_no_leaps(seed: int, memory: float, slow: float) -> None:
    tracks = noisy(memory, seed)
    rng = np.random.default_rng(seed)
    z_m, kept = tracks.z_m.copy(), rng.random(len(tracks.t_s)) > 0.1
    z_m[rng.integers(0, len(z_m), 5)] += 0.3
    parts = (tracks.shot, tracks.t_s, slow * tracks.x_m, tracks.y_m, z_m)
    notes = obs.gather_samples(Tracks(*(part[kept] for part in parts)))[1]
    assert not any("leap" in note for note in notes)


TARGET = "target_height.rise_m"


def test_nats_are_the_ratio_of_two_likelihoods() -> None:
    said = nats_measured({TARGET: Measurement(0.09, 0.02)}, TARGET, 0.1, 0.03)
    assert said == pytest.approx(norm.logpdf(0.09, 0.1, np.hypot(0.02, 0.03)) - norm.logpdf(0.09, 0.0, 0.02))
    assert said > 5.0 and nats_measured({TARGET: Measurement(0.0, 0.02)}, TARGET, 0.1, 0.03) < -2.0
    assert nats_measured({TARGET: Measurement(0.09, 0.02)}, "wind_x.speed_m_s", 1.0, 0.1) == 0.0


@pytest.mark.parametrize("word", ["wind_x", "wind_x=1", "wind_x=1,0", "wind_x=1,-1", "wind_x=nan,1", "wind_x=a,b",
                                  "winds=1,1", "=1,1", "wind_x=1,2,3"])
def test_what_is_no_measurement_is_refused_by_option_and_word(word: str) -> None:
    with pytest.raises(InputError, match="--measured"):
        read_measured([word], "--measured")
    assert read_measured(["wind_x=-1.5,0.2"], "--measured") == {"wind_x.speed_m_s": (-1.5, 0.2)}
