"""Publishes the ticks of `truearc run` as topics of NetworkTables, as `truearc advise` does."""

import math
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from truearc.hw.protocols import Clock
from truearc.robot.advice.advice_io import NS_PER_S, advice_of
from truearc.robot.advice.nt_keys import NtKeys
from truearc.robot.config.schema import Config
from truearc.robot.gate import Gate, load_gate
from truearc.robot.types import Tick

LOOK_S = 0.02                         # between looks for a newer tick
PATIENCE_S = 3.0                      # with a server that does not answer, before that is said


class Topics(Protocol):
    """Where advice goes."""

    @property
    def connected(self) -> bool: ...

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None: ...

    def close(self) -> None: ...


class NtPublisher:
    """A screen (truearc.robot.runtime) whose thread alone has to do with the network.

    Of the ticks since it last published it takes the newest, but one with a FIRE before any other: that is one tick
    for each ball. clock: that of the ticks, by which `age_s` is brought up to date; None: time passes otherwise.
    gate_path: the model that is asked for the novelty; None: there is none.
    """

    def __init__(self, config: Config, topics: Topics, gate_path: Path | None, clock: Clock | None) -> None:
        self._config, self._topics, self._gate_path, self._clock = config, topics, gate_path, clock
        self._swap = threading.Lock()
        self._tick: Tick | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="nt4", daemon=True)
        self._thread.start()

    def show(self, tick: Tick) -> None:
        """Keep it for the thread."""
        with self._swap:
            if self._tick is None or tick.verdict.fire or not self._tick.verdict.fire:
                self._tick = tick

    def close(self) -> None:
        """End the thread, and the connection."""
        self._over.set()
        self._thread.join()
        self._topics.close()

    def _publish(self) -> None:
        gate = None if self._gate_path is None else load_gate(self._gate_path)
        looks, said = 0, False
        while not self._over.wait(LOOK_S):
            looks += 1
            if not said and (self._topics.connected or looks * LOOK_S >= PATIENCE_S):
                said = True
                self._say(self._topics.connected)
            with self._swap:
                tick, self._tick = self._tick, None
            if tick is not None:
                self._topics.publish(self._advice(tick, gate))

    def _advice(self, tick: Tick, gate: Gate | None) -> dict[str, float | str | tuple[str, ...]]:
        advice = advice_of(tick, self._config, gate)
        age_s = advice["age_s"]
        if self._clock is not None and isinstance(age_s, float) and not math.isnan(age_s):
            advice["age_s"] = age_s + (self._clock.now_ns() - tick.inputs.t_ns) / NS_PER_S
        return advice

    def _say(self, connected: bool) -> None:
        server = self._config.nt4.server if self._config.nt4 else ""
        print(f"truearc: NetworkTables server {server}: " + ("connected" if connected else
              "does not answer; nothing is published until it does"), file=sys.stderr)


def open_publisher(config: Config, gate_path: Path | None, own_time: bool, clock: Clock) -> NtPublisher | None:
    """As `[nt4]` says; None without it. own_time: the ticks' time is another than that of `clock`.

    Raises:
        InputError: WPILib's library is not installed.
    """
    if config.nt4 is None:
        return None
    return NtPublisher(config, NtKeys(config.nt4.server, ()), gate_path, None if own_time else clock)
