"""Conditions of a shot beside its configuration, which a term may follow."""

from typing import Any, NamedTuple


class Circumstances(NamedTuple):
    """Conditions that a term may follow: arrays [n], or numbers; by default those of an ordinary shot.

    truearc.sim.data.shot_conditions gathers them from a dataset.
    """

    battery: Any = 0.0                # (battery_v - median) / median
    since_last_shot_s: Any = 1e9      # unknown, or the first of its session: long ago
    age: Any = 0.0                    # 0 to 1: how far through its session, or with ball_id through that ball's shots
    droop: Any = 1.0                  # dip of the wheels while the ball passes, by traces, / its mean; 1 without traces
    density: Any = 0.0                # of the air, / its median, - 1
    hood_change: Any = 0.0            # sign of this hood_deg less that of the session's shot before
    closing_speed_m_s: Any = 0.0      # of the robot, toward the target positive
    ball: Any = 0.0                   # a ball's own departure in units of the balls' spread; unknown: 0
    free_speed: Any = 0.0             # sizes of unexplained effects, by truearc.sim.infer.belief,
    free_elevation: Any = 0.0
    free_distance: Any = 0.0
    free_push: Any = 0.0
    curve_by: Any = 0.0               # and their derivatives by their curves' points, one curve after another [n, K]


# What has to be recorded of shots for a circumstance to be known.
RECORDED = {
    "battery": "battery_v of each shot",
    "age": "ball_id or t_s of each shot",
    "droop": "wheel speeds through the shot (traces.csv)",
    "density": "temperature_c and pressure_pa",
    "hood_change": "hood_deg of shots in their order",
    "closing_speed_m_s": "robot_speed_m_s of each shot",
    "ball": "ball_id of each shot",
}
