"""Data of a MuJoCo world of another quality than at home, or than rig.toml states: in no respect is it a change.

Names that the NumPy engine also has mean the same: noise_understated (rig.toml states half of it), outliers (2 % of
outcomes noted as another, tracks' noise by Student's t of 3), missing_frames (a quarter of a track's),
battery_with_wear (a voltage that falls as balls wear, and has no effect). scatter: balls, and shots of a ball, differ
by 1.25 times as much; lopsided: practice from far alone. There is no kind for overstated noise: rig.toml overstates it
already.

Effect on the mean flight, measured in 300 shots: none, except for scatter and battery. More scatter lowers the mean
height by 7 mm, less than its standard error of 11 mm (1.4 times as much: 12 mm). The battery moves heights by 3 mm RMS,
along its fall by 7 mm, where shots scatter by 150 mm.
"""

from collections.abc import Sequence

from truearc.robot.config.rig_spec import Noise
from truearc.sim.world.season import ShotSetting
from truearc_proof.world.practice import plan_season
from truearc_proof.world.season import ORDINARY, Sensors

DIRT = ("scatter", "noise_understated", "outliers", "lopsided")
TRACK_DIRT = ("missing_frames",)
DECOY_DIRT = "battery_with_wear"
SCATTER_SCALE = 1.25
UNDERSTATED = 2.0                     # true standard deviations / stated
WRONG_MARKS, TRACK_TAILS, LOST_FRAMES = 0.02, 3, 0.25
FAR_M = 5.0                           # lopsided practice is from there on
# A decoy's battery: from a little above the usual 12.6 V, so that the motors always have what they ask for.
FULL_V, FALL_V = 12.9, 0.8


def dirt_at(level: str) -> tuple[str, ...]:
    """What there can be at a level."""
    return DIRT + (TRACK_DIRT if level == "L2" else ())


def dirty_options(dirt: Sequence[str], shots: int) -> dict[str, float]:
    """Options of the world; `shots`: over which the battery falls."""
    options = {"scatter_scale": SCATTER_SCALE} if "scatter" in dirt else {}
    return options | ({"battery_start_v": FULL_V, "battery_drop_v_per_shot": FALL_V / shots}
                      if DECOY_DIRT in dirt else {})


def dirty_sensors(dirt: Sequence[str], stated: Noise) -> Sensors:
    """How badly it is seen; stated: rig.toml's."""
    sensors = ORDINARY
    if "noise_understated" in dirt:
        distance_m, hood_deg, wheel_rad_s, track_m = (
            UNDERSTATED * one for one in (stated.distance_m, stated.hood_deg, stated.wheel_rad_s, stated.track_m))
        sensors = Sensors(distance_m, hood_deg, wheel_rad_s, track_m)
    if "outliers" in dirt:
        sensors = sensors._replace(wrong_marks=WRONG_MARKS, track_tails=TRACK_TAILS)
    return sensors._replace(lost_frames=LOST_FRAMES) if "missing_frames" in dirt else sensors


def dirty_plan(dirt: Sequence[str], seed: int, shots: int) -> list[ShotSetting]:
    """Which shots are taken."""
    return plan_season(seed, shots, FAR_M) if "lopsided" in dirt else plan_season(seed, shots)
