"""Tracks that go on after the ball has touched something."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from truearc.sim.data.model import Dataset, Tracks
from truearc.sim.infer.plausibility.flaw import Flaw

RISEN, NOISES = 0.1, 8.0              # share of its heights, and times its noise, by which a track rises again
KICK = 4.0                            # times its usual change of the vertical speed in the same time
WINDOW = 1.0 / 12.0                   # share of a track on either side, in which these speeds are taken
SAMPLES = 8                           # fewest of a track that is judged
DIFFERENCES = 20.0                    # variance of a third difference, by that of a sample
MEDIAN = 0.6745                       # of the size of a normal deviate


def judge_bounces(dataset: Dataset, tracks: Tracks) -> Iterator[Flaw]:
    """Yield an objection where a ball turns upward again at once, which no force of the air does."""
    found = []
    for shot, mine in tracks.by_shot():
        here = mine[np.isfinite(tracks.z_m[mine])]
        at = _turn(tracks.t_s[here], tracks.z_m[here])
        if at is not None:
            found.append(f"{dataset.shots.shot_id[shot]} at t_s = {tracks.t_s[here[at]]:.4g}")
    if found:
        shown = ", ".join(found[:3]) + (" ..." if len(found) > 3 else "")
        yield Flaw("bounce", "tracks: z_m", f"{len(found)} tracks turn upward again, as a ball does that touches "
                   f"something ({shown}): cut each track before that")


def _turn(t_s: Float[np.ndarray, " n"], z_m: Float[np.ndarray, " n"]) -> int | None:
    """The sample from which a track rises at once after it has fallen; None where it does not. In any unit."""
    if len(z_m) < SAMPLES or (np.diff(t_s) <= 0.0).any():
        return None
    fallen = np.maximum.accumulate(z_m) - z_m
    risen = np.maximum.accumulate(z_m[::-1])[::-1] - z_m
    both, noise_m = np.minimum(fallen, risen), np.median(np.abs(np.diff(z_m, 3))) / MEDIAN / np.sqrt(DIFFERENCES)
    span = max(round(WINDOW * len(z_m)), 2)
    slope = (z_m[span:] - z_m[:-span]) / (t_s[span:] - t_s[:-span])
    change = slope[span:] - slope[:-span]                 # at the samples from `span` on
    at = int(both[span:-span].argmax())
    if both[at + span] < max(RISEN * np.ptp(z_m), NOISES * noise_m) or change[at] < KICK * np.median(np.abs(change)):
        return None
    return at + span
