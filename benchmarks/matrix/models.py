"""Models that break: one that is asked by the running robot, and files that it is to refuse at its start."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from onnx import helper

from truearc.hw.protocols import Clock
from truearc.model_export.graph import make_model
from truearc.model_export.parts import Part
from truearc.robot.gate.contract import INPUT, NOVELTY, OUTPUT
from truearc.robot.gate.model import Gate, Rating

BOX = {"distance_m": [2.0, 8.0], "motor_ratio": [0.1, 0.9], "hood_deg": [15.0, 60.0]}
SLOW_NS = 300_000_000
GOOD = Rating(0.9, 0.8, True, 0.2)
RATINGS = {"no number": Rating(None, None, False), "not a number": Rating(0.9, float("nan"), True, 0.2),
           "outside": Rating(0.9, 0.8, False, 0.2), "novel": Rating(0.9, 0.8, False, 3.0),
           "doubts": Rating(0.9, 0.1, True, 0.2)}


class BrokenGate(Gate):
    """A gate that agrees until the fault begins. `answers` keeps what it said: None where it raised."""

    def __init__(self, what: str, stands: Callable[[], bool], clock: Clock) -> None:
        self.answers: list[Rating | None] = []
        self.sha256 = "0" * 64
        self._what, self._stands, self._clock = what, stands, clock

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        if not self._stands():
            self.answers.append(GOOD)
        elif self._what == "raises":
            self.answers.append(None)
            raise RuntimeError("the model has broken")
        else:
            if self._what == "slow":
                self._clock.sleep_until_ns(self._clock.now_ns() + SLOW_NS)
            self.answers.append(RATINGS.get(self._what, GOOD))
        return self.answers[-1] or GOOD


class AnswersAgain(Gate):
    """For replay: what the gate of a run had said, in order."""

    def __init__(self, answers: list[Rating | None]) -> None:
        self._answers = iter(answers)

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        answer = next(self._answers)
        if answer is None:
            raise RuntimeError("the model had broken")
        return answer


def write_model(path: Path, what: str) -> None:
    """A model file with this wrong with it: "corrupted", "truncated", "foreign", "no number" (in its domain)."""
    data = _make("Log" if what == "no number" else "Sigmoid")
    if what == "corrupted":
        middle = len(data) // 2
        data = data[:middle] + bytes([data[middle] ^ 0xFF]) + data[middle + 1:]
    elif what == "truncated":
        data = data[:len(data) // 2]
    elif what == "foreign":
        data = data.replace(b'"hood_deg"', b'"hood_rad"')
    path.write_bytes(data)


def _make(last: str) -> bytes:
    nodes = [helper.make_node("Gemm", [INPUT, "w", "b"], ["z"]), helper.make_node(last, ["z"], [OUTPUT]),
             helper.make_node("Gemm", [INPUT, "n", "m"], ["far"]), helper.make_node("Abs", ["far"], [NOVELTY])]
    weights = {"w": np.array([[0.1, 0.1], [-9.0, -9.0], [0.0, 0.0]]), "b": np.zeros(2), "n": np.zeros((3, 1)),
               "m": np.array([0.2])}
    return make_model([Part(nodes, weights)], BOX, {"k": 3}, {"seed": 3})
