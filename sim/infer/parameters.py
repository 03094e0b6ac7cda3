"""Report of each fitted number: its name in a belief, unit, meaning, and the width of its prior."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.belief import SCATTER
from truearc.sim.infer.likelihood.belief_prior import believed_name
from truearc.sim.infer.likelihood.linearization import ParameterLayout
from truearc.sim.physics.catalogue import find_parameter

SCATTERED = {"scatter.speed": ("of the exit speed", "exit speed from shot to shot (sd)"),
             "scatter.elevation_deg": ("deg", "exit angle from shot to shot (sd)")}


@dataclass(frozen=True)
class Sought:
    """One fitted number.

    column: its place in the fit. Its prior has `centre` and `sd` in the parameter's own unit; of a scatter they are the
    logarithm's, in the column's unit. percent: shown in per cent.
    """

    name: str
    unit: str
    meaning: str
    percent: bool
    column: int
    centre: float
    sd: float

    @property
    def scatters(self) -> bool:
        return self.name.startswith(SCATTER + ".")

    def value(self, at: float) -> float:
        """The number itself where its column is `at`."""
        if not self.scatters:
            return at
        return float(np.degrees(np.exp(at)) if self.name.endswith("_deg") else np.exp(at))

    def at(self, value: float) -> float:
        """The inverse of `value`."""
        if not self.scatters:
            return value
        return float(np.log(np.radians(value) if self.name.endswith("_deg") else value))

    def slope(self, at: float) -> float:
        """d value / d column."""
        return self.value(at) if self.scatters else 1.0


def sought_of(layout: ParameterLayout) -> tuple[Sought, ...]:
    """The numbers of terms, a tracker's among them, and of the launch's scatter; not random effects, nor scatters that
    no belief keeps."""
    sd: Float[np.ndarray, " p"] = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    found = []
    for k, column in enumerate(layout.columns):
        name = believed_name(column.name)
        if name in SCATTERED:
            unit, meaning = SCATTERED[name]
            found.append(Sought(name, unit, meaning, name == "scatter.speed", k, float(layout.centre[k]), float(sd[k])))
        elif layout.in_slot[k]:
            one = find_parameter(name, layout.chain.catalogue)
            found.append(Sought(name, one.unit, one.meaning, one.percent, k, float(layout.centre[k]), float(sd[k])))
    return tuple(found)
