"""An encoder that hangs says the same for ever: a speed, and a position that does not go with it. No IO."""

from hw.reading import MotorReading

STILL_NS = 50_000_000                 # a position that does not change for so long, at a speed, is stuck
MOVING_RAD_S = 10.0


class Stillness:
    """Since when a motor has said that it turns and stands still at once."""

    def __init__(self) -> None:
        self._since_ns = 0                        # 0: it does not

    def take(self, before: MotorReading, reading: MotorReading) -> None:
        """One reading and the one before it."""
        if reading.t_ns != before.t_ns:
            still = reading.position_rad == before.position_rad and abs(reading.velocity_rad_s) > MOVING_RAD_S
            self._since_ns = (self._since_ns or before.t_ns) if still else 0

    def fault(self, device: str, reading: MotorReading) -> str:
        """In words; "" for an encoder that goes with its motor."""
        if not self._since_ns or reading.t_ns - self._since_ns < STILL_NS:
            return ""
        return f"{device} says {reading.velocity_rad_s:.0f} rad/s, but its position stands still: encoder stuck?"
