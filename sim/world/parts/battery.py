"""The battery: open-circuit voltage, internal resistance, and a charge that is slowly used up."""

import math

from truearc.sim.world.options import Options

CHARGE_C = 18.0 * 3600.0          # 18 Ah, lead acid
FALL_V = 1.2                      # open-circuit voltage lost from full to empty
STANDING_W = 20.0                 # computer, radio, ring light


class Battery:
    """A battery feeding every motor driver over the same wires."""

    def __init__(self, options: Options) -> None:
        self._start_v = options.battery_start_v
        self._resistance_ohm = options.battery_resistance_ohm
        self._drop_v_per_shot = options.battery_drop_v_per_shot
        self._used_c = 0.0
        self.shots = 0                # made with it
        self.bus_v = self._start_v

    @property
    def open_circuit_v(self) -> float:
        return self._start_v - FALL_V * self._used_c / CHARGE_C - self._drop_v_per_shot * self.shots

    def draw(self, power_w: float, dt_s: float) -> None:
        """Deliver power for dt_s: the bus sits where U (E - U) / R equals it, at worst at maximum power transfer."""
        emf_v = self.open_circuit_v
        root = emf_v * emf_v - 4.0 * self._resistance_ohm * (power_w + STANDING_W)
        self.bus_v = 0.5 * (emf_v + math.sqrt(max(root, 0.0)))
        self._used_c += (power_w + STANDING_W) / self.bus_v * dt_s
