"""One set point of a table: what to command, how likely it scores, and what errors cost."""

from typing import NamedTuple

DISTANCE_M, HOOD_DEG, SPEED_RPM = 0.10, 1.0, 50.0       # errors whose cost is reported


class AimRow(NamedTuple):
    """A set point.

    Fields:
        distance_m: For which it is.
        hood_deg: Launch elevation.
        motor_ratio: Motor speed over free speed.
        motor_rad_s: Motor speed.
        lead_deg: By how much to aim to the left of the target, against wind across.
        flight_s: From the exit to the target.
        p_two, p_three: Probability of at least two points, and of three.
        points: Expected.
        lost_10cm, lost_1deg, lost_50rpm: Points that such an error of distance, hood or motor speed costs, the mean of
            both directions.
        slowest_rad_s, fastest_rad_s: Motor speeds between which at least half of the points are left.
        note: What of it is outside the range of the shots that the belief was fitted to.
    """

    distance_m: float
    hood_deg: float
    motor_ratio: float
    motor_rad_s: float
    lead_deg: float
    flight_s: float
    p_two: float
    p_three: float
    points: float
    lost_10cm: float
    lost_1deg: float
    lost_50rpm: float
    slowest_rad_s: float
    fastest_rad_s: float
    note: str
