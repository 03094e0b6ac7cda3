"""Tracks and times at heights as padded arrays, and their noise.

Noise has a standard deviation per axis and a correlation between successive samples. Where samples of tracks are not
equally accurate, that is the standard deviation of a typical one.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.data.dataset import Dataset, NoisyTracks, Times, Tracks
from truearc.sim.infer.likelihood.noise import STILL_M, TIMED_M, UNMEASURED_M

Array = np.ndarray
# Chosen: twice the three numbers of a parabola
FEWEST_SAMPLES = 6                    # per track; fewer cannot say more than where it started and how fast
# Chosen: one above the cubic that drag makes of a parabola
SMOOTH_DEGREE = 4                     # of the polynomial that stands for "any smooth flight" when scatter is measured
# Chosen: over twice the five numbers of that polynomial
ENOUGH_SAMPLES = 12                   # per track, to measure scatter from it
# Derived: normal noise goes so far once in 10^15
GROSS = 8.0                           # robust standard deviations off a smooth flight: not a sample of the ball
# Chosen: more than the two frames in a row that a camera may lose
LEAPS, MOST_LOST = 3, 4               # the longest steps of a track, and frames that may be lost behind each
# Measured: with COMMON, leaps are found in 296 of 300 tracks that lost two frames, in 2 of 2700 that lost none (git
# show 0acad92d)
SURE_NATS = 30.0                      # that stamps put right must gain,
# Measured: git show 264fc724
COMMON = 0.03                         # and share of tracks that must leap: of those with bad noise alone 2 in 300 do
MEMORIES = np.linspace(0.0, 0.97, 50)  # correlations of neighbouring samples that are told apart; steps of 0.02
LEAST_MEMORY = 0.03                   # of less, white noise is as good
PAD = 16                              # tracks are padded to a multiple of this, since each length is compiled


@dataclass(frozen=True)
class Samples:
    """n tracks padded to L samples (padding repeats the last); `time_s` [n, L] from 0, `position_m` [n, L, 3].

    clock_s [n, L]: of times at heights, standard deviations of the times; the release stands before
    them. None: of a film. wider [n, L, 3]: by which a sample is noisier than a typical one; None: all are alike.
    """

    rows: Int[Array, " n"]            # shot of each track
    time_s: Float[Array, "n L"]
    position_m: Float[Array, "n L 3"]
    real: Bool[Array, "n L"]          # False = padding
    clock_s: Float[Array, "n L"] | None = None
    wider: Float[Array, "n L 3"] | None = None


@dataclass(frozen=True)
class Scatter:
    """Noise of the samples: `sigma_m` [3], and memory: correlation exp(-dt / memory_s) [3], 0 = none."""

    sigma_m: Float[Array, " 3"]
    memory_s: Float[Array, " 3"]


def samples_of(dataset: Dataset) -> tuple[Samples | None, Scatter | None, tuple[str, ...]]:
    """Return (times at heights or tracks of a dataset, their noise, notes on excluded data); None without any."""
    if dataset.times is not None and len(dataset.times.t_s):
        return *gather_times(dataset.times), ()
    if dataset.tracks is None or len(dataset.tracks.t_s) == 0:
        return None, None, ()
    samples, notes, _ = gather_samples(dataset.tracks)
    if not len(samples.rows):
        return None, None, notes
    return samples, measure_scatter(samples, dataset.facts.noise.track_m), notes


def gather_samples(tracks: Tracks) -> tuple[Samples, tuple[str, ...], int]:
    """Return (padded tracks, notes on excluded data, number of excluded gross outliers)."""
    kept, widths, short, gross = [], [], 0, 0
    wider = _relative_noise(tracks)
    for shot, where in tracks.by_shot():
        data = np.stack([tracks.t_s[where], tracks.x_m[where], tracks.y_m[where], tracks.z_m[where]], axis=1)
        sound = _sound(data)
        gross += int((~sound).sum())
        data = data[sound]
        if len(data) >= FEWEST_SAMPLES:
            kept.append((shot, data))
            widths.append(wider[where][sound])
        elif len(data):
            short += 1
    notes: tuple[str, ...] = (f"{short} tracks with fewer than {FEWEST_SAMPLES} samples",) if short else ()
    if gross:
        notes += (f"{gross} track samples more than {GROSS:g} standard deviations off a smooth flight",)
    right = [put_right(data) for _, data in kept]
    leapt = sum(bool((stamps != data[:, 0]).any()) for stamps, (_, data) in zip(right, kept, strict=True))
    if leapt > COMMON * len(kept):
        for stamps, (_, data) in zip(right, kept, strict=True):
            data[:, 0] = stamps
        notes += (f"{leapt} tracks that leap ahead as if frames had been lost in between: their stamps are put right",)
    samples = _pad(kept)
    if isinstance(tracks, NoisyTracks):
        padded = np.ones_like(samples.position_m)
        for row, width in zip(padded, widths, strict=True):
            row[:len(width)] = width
        samples = replace(samples, wider=padded)
    return samples, notes, gross


def _relative_noise(tracks: Tracks) -> Float[Array, "rows 3"]:
    """Standard deviation of each sample / the median one, an axis; 1 where none is stated."""
    if not isinstance(tracks, NoisyTracks):
        return np.ones((len(tracks.t_s), 3))
    x, z = (sigma / np.median(sigma) for sigma in (tracks.sigma_x_m, tracks.sigma_z_m))
    return np.stack([x, np.ones_like(x), z], axis=1)


def gather_times(times: Times) -> tuple[Samples, Scatter]:
    """Return times at heights as tracks of which only the height was measured, and their scatter if time has none."""
    rows, mine = np.unique(times.shot), [mine for _, mine in times.by_shot()]
    width = -(-(1 + max(map(len, mine))) // PAD) * PAD
    time_s, height_m, clock_s = np.zeros((3, len(rows), width))
    real = np.zeros((len(rows), width), dtype=bool)
    for k, chosen in enumerate(mine):
        place = slice(1, 1 + len(chosen))
        time_s[k, place], height_m[k, place], clock_s[k, place] = (
            times.t_s[chosen], times.height_m[chosen], times.sigma_s[chosen])
        time_s[k, place.stop:], real[k, place] = times.t_s[chosen[-1]], True
    position_m = np.stack([np.zeros_like(height_m), np.zeros_like(height_m), height_m], axis=2)
    return (Samples(rows, time_s, position_m, real, clock_s),
            Scatter(np.array([UNMEASURED_M, UNMEASURED_M, TIMED_M]), np.zeros(3)))


def put_right(data: Float[Array, "L 4"]) -> Float[Array, " L"]:
    """Return timestamps [L] of samples (t, x, y, z), corrected by whole frames where some were silently lost.

    A smooth flight through samples that leap ahead along their own way fits far better once the stamps leap, too. No
    force on a ball does that.
    """
    time_s = data[:, 0]
    if len(data) < ENOUGH_SAMPLES:
        return time_s
    frame_s = float(np.median(np.diff(time_s)))
    length = np.linalg.norm(np.diff(data[:, 1:], axis=0), axis=1) / np.maximum(np.diff(time_s), 1e-9)
    places = np.argsort(-length, kind="stable")[:LEAPS] + 1
    tried = [time_s + lost * frame_s * (np.arange(len(data)) >= place) for place in places
             for lost in range(1, MOST_LOST + 1)]
    left = np.array([(_detrend(stamps, data[:, 1:])**2).sum() for stamps in (time_s, *tried)])
    best = int(left[1:].argmin())
    # three coordinates, half a logarithm each
    gain = 1.5 * len(data) * np.log(left[0] / max(left[1 + best], 1e-300))
    return tried[best] if gain > SURE_NATS else time_s


def measure_scatter(samples: Samples, believed_m: float) -> Scatter:
    """Measure noise about the smoothest flight that each track allows; the believed figure if no track is long
    enough.

    A smooth curve takes some of the noise with it, most of slow noise. Size and memory are those that would leave what
    was found after the same curve was taken out of a typical track. An axis whose samples are all alike was not
    measured: it gets a noise beside which nothing shows.
    """
    unmeasured = np.ptp(samples.position_m[samples.real], axis=0) < STILL_M
    long = [k for k, real in enumerate(samples.real) if real.sum() >= ENOUGH_SAMPLES]
    if not long:
        return Scatter(np.where(unmeasured, UNMEASURED_M, believed_m), np.zeros(3))
    residuals = [_detrend(samples.time_s[k][samples.real[k]], samples.position_m[k][samples.real[k]],
                          None if samples.wider is None else samples.wider[k][samples.real[k]]) for k in long]
    square = sum((r**2).sum(0) for r in residuals) / sum(len(r) for r in residuals)
    together = sum((r[1:] * r[:-1]).sum(0) for r in residuals) / sum(len(r) for r in residuals)
    typical = sorted(long, key=lambda k: samples.real[k].sum())[len(long) // 2]
    time_s = samples.time_s[typical][samples.real[typical]]
    gap_s = float(np.median(np.diff(time_s)))
    left = np.array([_left_over(time_s, memory, gap_s) for memory in MEMORIES])
    found = np.interp(together / np.maximum(square, 1e-300), left[:, 1] / left[:, 0], MEMORIES)
    sigma_m = np.sqrt(square / np.interp(found, MEMORIES, left[:, 0]))
    memory_s = np.where(found > LEAST_MEMORY, -gap_s / np.log(np.maximum(found, 1e-12)), 0.0)
    return Scatter(np.where(unmeasured, UNMEASURED_M, np.maximum(sigma_m, 1e-6)), np.where(unmeasured, 0.0, memory_s))


def _left_over(time_s: Float[Array, " L"], memory: float, gap_s: float) -> tuple[float, float]:
    """(mean square, mean product of neighbours) of unit noise with memory after a smooth curve is taken out."""
    apart = np.abs(time_s[:, None] - time_s[None]) / gap_s
    left = _detrend(time_s, _detrend(time_s, np.where(apart == 0.0, 1.0, memory**apart)).T)
    return float(np.diag(left).mean()), float(np.diag(left, 1).sum() / len(time_s))


def timed_noise(samples: Samples, speed_m_s: Float[Array, "n L"]) -> Float[Array, "n L"]:
    """Return the factor by which heights scatter more because the times do, at that vertical speed."""
    assert samples.clock_s is not None
    return np.asarray(np.hypot(1.0, samples.clock_s * np.abs(speed_m_s) / TIMED_M))


def whiten(samples: Samples, scatter: Scatter, columns: Float[Array, "n L 3 k"]) -> Float[Array, "n 3*L k"]:
    """Transform position-like columns to independent unit noise; padding becomes 0.

    First-order autoregression in continuous time: each sample less its forecast from the one before.
    """
    memory = _memory(samples, scatter)
    clean = columns / scatter.sigma_m[:, None]
    new = (clean[:, 1:] - memory[..., None] * clean[:, :-1]) / np.sqrt(1.0 - memory**2 + 1e-12)[..., None]
    joined = np.concatenate([clean[:, :1], new], axis=1) * samples.real[:, :, None, None]
    return np.asarray(joined.reshape(len(columns), 3 * columns.shape[1], columns.shape[-1]))


def log_volume(samples: Samples, scatter: Scatter) -> Float[Array, " n"]:
    """Return the log density of each track's noise if everything that `whiten` returns is 0."""
    new = np.log(scatter.sigma_m) + 0.5 * np.log(1.0 - _memory(samples, scatter)**2 + 1e-12)
    first = np.log(scatter.sigma_m).sum() + 1.5 * np.log(2.0 * np.pi)
    later = ((new.sum(2) + 1.5 * np.log(2.0 * np.pi)) * samples.real[:, 1:]).sum(1)
    return np.asarray(-(first * samples.real[:, 0] + later))


def _memory(samples: Samples, scatter: Scatter) -> Float[Array, "n gaps 3"]:
    """Correlation of each sample's noise with that of the one before."""
    gaps_s = np.diff(samples.time_s, axis=1)[:, :, None]
    return np.exp(-gaps_s / np.where(scatter.memory_s > 0.0, scatter.memory_s, 1e-9))


def _detrend(time_s: Float[Array, " L"], position_m: Float[Array, "L k"],
             wider: Float[Array, "L k"] | None = None) -> Float[Array, "L k"]:
    """What a smooth curve leaves of positions; / wider, and weighted by that, where it is given."""
    basis = _smooth(time_s)
    if wider is not None:
        return np.stack([_detrend_one(basis / wide[:, None], one / wide)
                         for one, wide in zip(position_m.T, wider.T, strict=True)], axis=1)
    return np.asarray(position_m - basis @ np.linalg.lstsq(basis, position_m, rcond=None)[0])


def _detrend_one(basis: Float[Array, "L 5"], one: Float[Array, " L"]) -> Float[Array, " L"]:
    return np.asarray(one - basis @ np.linalg.lstsq(basis, one, rcond=None)[0])


def _smooth(time_s: Float[Array, " L"]) -> Float[Array, "L 5"]:
    """Legendre polynomials up to SMOOTH_DEGREE over the track."""
    scaled = (time_s - time_s[0]) / max(float(np.ptp(time_s)), 1e-9) * 2.0 - 1.0
    return np.polynomial.legendre.legvander(scaled, SMOOTH_DEGREE)


def _sound(data: Float[Array, "L 4"]) -> Bool[Array, " L"]:
    """Samples that could be the ball: twice over, so that a gross one does not hide another."""
    sound = np.ones(len(data), dtype=bool)
    for _ in range(2):
        if sound.sum() < ENOUGH_SAMPLES:
            return np.ones(len(data), dtype=bool)
        basis = _smooth(data[:, 0])
        off = np.abs(data[:, 1:] - basis @ np.linalg.lstsq(basis[sound], data[sound, 1:], rcond=None)[0])
        # 1.4826: of a normal deviation by its median size
        sigma = 1.4826 * np.median(off[sound], axis=0) + 1e-9
        sound = (off <= GROSS * sigma).all(axis=1)
    return sound


def _pad(kept: list[tuple[int, Float[Array, "_ 4"]]]) -> Samples:
    longest = -(-max((len(data) for _, data in kept), default=1) // PAD) * PAD
    padded = np.zeros((len(kept), longest, 4))
    real = np.zeros((len(kept), longest), dtype=bool)
    for k, (_, data) in enumerate(kept):
        padded[k, :len(data)], padded[k, len(data):] = data, data[-1]
        padded[k, :, 0] -= data[0, 0]
        real[k, :len(data)] = True
    return Samples(np.array([shot for shot, _ in kept], dtype=int), padded[..., 0], padded[..., 1:], real)
