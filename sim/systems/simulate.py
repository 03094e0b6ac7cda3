"""The simulator as users make it: with its simulation of runs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.systems.score_table import SystemModel
from truearc.sim.systems.system import Runs, SystemSpec


@dataclass(frozen=True, eq=False, init=False)
class System(SystemSpec):
    __doc__ = SystemSpec.__doc__

    def simulate(self, runs: Runs) -> dict[str, Float[Array, " rows"]]:
        """Simulate each run with the parameters as believed, from its first sample.

        Returns:
            {output: values}, in the order of the rows of `runs`.
        """
        model = SystemModel.of(self, runs, rows=1, testing=False)
        seen, recording = model.flights(model.starts()[0]), model.recording
        found = {name: np.full(runs.rows, np.nan) for name in self.outputs}
        for row in range(len(recording.run)):
            there = recording.real[row]
            for k, name in enumerate(self.outputs):
                found[name][recording.place[row][there]] = seen[row, there, k]
        return found
