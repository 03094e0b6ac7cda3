"""Plausibility of times at heights: no dropped ball falls faster than gravity has it, or from where it was not."""

from collections.abc import Iterator

import numpy as np

from truearc.sim.data.model import Dataset, Times
from truearc.sim.infer.plausibility.flaw import LENGTHS, Flaw
from truearc.sim.physics.simulate import has_wheels

FASTEST = 1.15                        # acceleration of a fall from rest, by the rig's gravity: times err
SLOWEST = 0.02                        # of a shuttlecock's last metres: slower are times in another unit
LIKELY = (0.3, 1.05)                  # of a ball's, in the unit that a message names


def judge_times(dataset: Dataset, times: Times) -> Iterator[Flaw]:
    """Those of shots of which no launch is known: they were dropped from the release height."""
    rig, shots = dataset.rig, dataset.shots
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    aimed = np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg"))
    dropped = ~(sped & aimed)[times.shot]
    fallen_m = (rig.launcher.release_height_m - times.height_m)[dropped]
    if not len(fallen_m):
        return
    if (fallen_m <= 0.0).any():
        yield Flaw("release", "times: height_m", "balls of which no launch is known are taken as dropped from "
                   f"launcher.release_height_m = {rig.launcher.release_height_m:g} of rig.toml, and one is timed at "
                   f"{times.height_m[dropped].max():g} m; state the height that they fell from, or their launch")
        return
    each = 2.0 * fallen_m / times.t_s[dropped]**2 / rig.world.gravity_m_s2
    pull = float(np.median(each))
    if pull > FASTEST:
        units = [name for name, (_, metres) in LENGTHS.items() if LIKELY[0] < pull * metres < LIKELY[1]]
        yield Flaw("gravity", "times: height_m", f"balls dropped from rest fall {pull:.3g} times as fast as gravity "
                   f"has it{'; heights look like ' + ' or '.join(units) if units else '; times may be halved'}")
    elif pull < SLOWEST:
        looks = "milliseconds" if LIKELY[0] < pull * 1e6 < LIKELY[1] else "another unit"
        yield Flaw("gravity", "times: t_s", f"balls dropped from rest fall with {pull:.2g} of gravity; times look like "
                   f"{looks}")
    elif len(odd := np.flatnonzero((each > FASTEST) | (each < SLOWEST))):
        name = shots.shot_id[times.shot[np.flatnonzero(dropped)[odd[0]]]]
        yield Flaw("gravity", "times: t_s", f"{name} falls with {each[odd[0]]:.2g} of gravity, where drops have "
                   f"{pull:.2g} in the middle ({len(odd)} of {len(each)} are so far off); correct its time or height")
