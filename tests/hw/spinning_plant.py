"""A tiny world for the emulated devices: frictionless rotors, whose motion under constant torque is a closed form."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest

from truearc.hw.emulated.nodes import MotorTruth, View

TORQUE_NM_A = 0.02


class SpinningPlant:
    """Each motor is a rotor of 0.001 kg m2; the hood turns as it is told."""

    motors = ("flywheel_a", "flywheel_b", "hood", "feeder")
    inertia_kg_m2 = 0.001

    def __init__(self) -> None:
        self.t_ns = 0
        self.position_rad = dict.fromkeys(self.motors, 0.0)
        self.velocity_rad_s = dict.fromkeys(self.motors, 0.0)
        self.torque_nm = dict.fromkeys(self.motors, 0.0)
        self.hood_rad = 0.5
        self.limit = False
        self.volts = 12.25
        self.stops_ns: list[int] = []

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        assert t_ns > self.t_ns
        step_s = (t_ns - self.t_ns) * 1e-9
        for name in self.motors:
            self.torque_nm[name] = torque_nm.get(name, 0.0)
            acceleration = self.torque_nm[name] / self.inertia_kg_m2
            self.position_rad[name] += self.velocity_rad_s[name] * step_s + acceleration * step_s**2 / 2
            self.velocity_rad_s[name] += acceleration * step_s
        self.t_ns = t_ns
        self.stops_ns.append(t_ns)

    def motor(self, name: str) -> MotorTruth:
        torque = self.torque_nm[name]
        return MotorTruth(self.position_rad[name], self.velocity_rad_s[name], torque, torque / TORQUE_NM_A)

    def bus_v(self) -> float:
        return self.volts

    def hood_encoder_rad(self) -> float:
        return self.hood_rad

    def hood_at_limit(self) -> bool:
        return self.limit

    def view(self) -> View:
        return View(np.eye(4), 1.0, 1.0)


def closed_after(build: Callable[..., Any], *given: str) -> Any:
    """A fixture that is `build`, with these fixtures as its first arguments; what it has built is closed at the end."""
    @pytest.fixture
    def make(request: pytest.FixtureRequest) -> Iterator[Callable[..., Any]]:
        with ExitStack() as stack:
            def built(*args: Any, **how: Any) -> Any:
                one = build(*map(request.getfixturevalue, given), *args, **how)
                stack.callback(one.close)
                return one
            yield built
    return make
