"""How track samples scatter: known noise is found again, and whitened away."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from truearc.sim.data.dataset import Tracks
from truearc.sim.infer.likelihood.observations import (
    Samples,
    Scatter,
    gather_samples,
    log_volume,
    measure_scatter,
    whiten,
)

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


def test_noise_without_memory_is_found_again() -> None:
    samples, notes, gross = gather_samples(noisy(0.0))
    scatter = measure_scatter(samples, 1.0)
    assert (notes, gross) == ((), 0)
    assert np.allclose(scatter.sigma_m, SIGMA_M, rtol=0.05)
    assert (np.exp(-STEP_S / np.maximum(scatter.memory_s, 1e-9)) < 0.1).all()


def test_noise_with_memory_becomes_white() -> None:
    samples, _, _ = gather_samples(noisy(MEMORY))
    scatter = measure_scatter(samples, 1.0)
    assert np.allclose(np.exp(-STEP_S / scatter.memory_s), MEMORY, atol=0.04)
    assert np.allclose(scatter.sigma_m, SIGMA_M, rtol=0.06)
    t = samples.time_s
    truth = np.stack([4.0 * t, 0.1 * t, 1.0 + 2.0 * t - 4.9 * t**2], axis=2)
    white = whiten(samples, scatter, (samples.position_m - truth)[..., None]).reshape(N, -1, 3)[:, 1:LENGTH]
    together = (white[:, 1:] * white[:, :-1]).mean() / (white**2).mean()
    assert abs(together) < 0.04
    assert white.std() == pytest.approx(1.0, abs=0.05)


def test_a_gross_sample_is_left_out_and_counted() -> None:
    tracks = noisy(0.0)
    z_m = tracks.z_m.copy()
    z_m[17] += 0.3
    samples, notes, gross = gather_samples(Tracks(tracks.shot, tracks.t_s, tracks.x_m, tracks.y_m, z_m))
    assert gross == 1
    assert "1 track samples" in notes[0]
    assert samples.real.sum() == N * LENGTH - 1


def test_short_tracks_are_left_out_and_counted_and_padding_weighs_nothing() -> None:
    t = 0.01 * np.arange(10)
    shot = np.concatenate([np.zeros(10, int), np.full(4, 1), np.full(7, 2)])
    time_s = np.concatenate([t, t[:4], t[:7]])
    samples, notes, _ = gather_samples(Tracks(shot, time_s, time_s, time_s, time_s))
    assert samples.rows.tolist() == [0, 2]
    assert "1 tracks with fewer" in notes[0]
    assert samples.real.sum(1).tolist() == [10, 7]
    white = whiten(samples, measure_scatter(samples, 0.01), np.ones((*samples.time_s.shape, 3, 1)))
    assert (white.reshape(2, -1, 3)[1, 7:] == 0.0).all()


def test_whitened_noise_has_the_density_of_the_big_normal() -> None:
    rng = np.random.default_rng(5)
    time_s = np.array([0.0, 0.01, 0.03, 0.035])
    scatter = Scatter(np.array([0.004, 0.002, 0.01]), np.array([0.02, 0.0, 0.05]))
    noise = rng.normal(0.0, 0.005, (4, 3))
    samples = Samples(np.zeros(1, int), np.append(time_s, [0.035, 0.035])[None], np.zeros((1, 6, 3)),
                      np.array([[True] * 4 + [False] * 2]))
    white = whiten(samples, scatter, np.concatenate([noise, noise[-1:], noise[-1:]])[None, :, :, None])
    apart = np.abs(time_s[:, None] - time_s)
    exact = 0.0
    for axis, (sigma, memory) in enumerate(zip(scatter.sigma_m, scatter.memory_s, strict=True)):
        together = np.exp(-apart / memory) if memory else np.eye(4)
        exact += multivariate_normal.logpdf(noise[:, axis], cov=sigma**2 * together)
    assert log_volume(samples, scatter)[0] - 0.5 * (white**2).sum() == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(("at", "lost"), [(20, 1), (20, 2), (35, 3)])
def test_stamps_of_a_track_with_lost_frames_are_put_right(at: int, lost: int) -> None:
    """Frames gone in the middle, and what follows stamped as if they were not: in one of ten tracks."""
    tracks = noisy(0.0)
    hurt = tracks.shot % 10 == 3
    frame = np.tile(np.arange(LENGTH), N)
    kept = ~(hurt & (frame >= at) & (frame < at + lost))
    t_s = np.where(hurt & (frame >= at), tracks.t_s - lost * STEP_S, tracks.t_s)
    damaged = Tracks(*(part[kept] for part in (tracks.shot, t_s, tracks.x_m, tracks.y_m, tracks.z_m)))
    samples, notes, _ = gather_samples(damaged)
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
    notes = gather_samples(Tracks(*(part[kept] for part in parts)))[1]
    assert not any("leap" in note for note in notes)
