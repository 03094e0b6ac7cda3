"""Which shots a dataset has evidence of, and why others are left out."""

import numpy as np
from jaxtyping import Bool

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import has_wheels

FEWEST_SHOTS = 10                     # by which a simulation is judged

Which = Bool[np.ndarray, " n"]


def say_few(count: int) -> str:
    """Say what so few shots cannot tell."""
    few = "1 shot is" if count == 1 else f"{count} shots are"
    return f"{few} too few to judge a simulation by; {FEWEST_SHOTS} at least"


def say_left_out(rig: Rig, shots: Shots, use: Which, marked: Which, tracked: Which) -> tuple[str, ...]:
    """A line for each reason why a shot, or its outcome, is not used.

    use: any of it is. marked: it has an outcome, side or height that tells how high it was. tracked: it has a track.
    """
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    aimed = np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg"))
    beside = np.isin(shots.text("side"), ("left", "right")) & ~marked
    placed = np.isfinite(shots.number("distance_m"))
    launched = sped & aimed
    reasons = (
        (~use & launched & beside, "missed left or right, without information about the height"),
        (~use & launched & ~marked & ~beside,
         "nothing was seen of their flight: no outcome, side, miss_height_m, exit_*, track or time"),
        (~use & marked & ~placed, "no distance_m"),
        (use & marked & launched & ~placed, "their outcome only: no distance_m"),
        (~use & ~sped, "no launch speed: motor_ratio (with launcher.free_speed_rad_s in rig.toml), every "
                       "wheel_<name>_rad_s, or exit_speed_m_s"),
        (~use & ~aimed, "no hood_deg or exit_deg"),
        (marked & tracked & ~launched, "their outcome only: no launch, the track alone counts"),
    )
    return tuple(f"{int(which.sum())} of {len(shots)} shots: {why} ({_names(shots, which)})" for which, why in reasons
                 if which.any())


def _names(shots: Shots, which: Which, most: int = 3) -> str:
    names = [shots.shot_id[row] for row in np.flatnonzero(which)]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
