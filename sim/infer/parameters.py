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

IMPROBABLE = 2.58                     # prior standard deviations that a hundredth of the prior lies beyond


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

    def improbable(self, value: float) -> bool:
        """Whether it was believed all but impossible."""
        return abs(self.at(value) - self.centre) > IMPROBABLE * self.sd

    def slope(self, at: float) -> float:
        """d value / d column."""
        return self.value(at) if self.scatters else 1.0


def improbable(layout: ParameterLayout, point: Float[np.ndarray, " p"]) -> dict[str, float]:
    """Return the fitted numbers of terms that were believed all but impossible: {name: value at `point`}."""
    found = {one.name: (one, one.value(float(point[one.column]))) for one in sought_of(layout) if not one.scatters}
    return {name: value for name, (one, value) in found.items() if one.improbable(value)}


def sought_of(layout: ParameterLayout) -> tuple[Sought, ...]:
    """The numbers of terms, a tracker's among them, and of the launch's scatter; not random effects, nor scatters that
    no belief keeps."""
    sd: Float[np.ndarray, " p"] = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    found = []
    first = layout.first_shared
    for k, column in enumerate(layout.columns[first:], first):
        name, centre, wide = believed_name(column.name), float(layout.centre[k - first]), float(sd[k - first])
        if name in SCATTERED:
            unit, meaning = SCATTERED[name]
            found.append(Sought(name, unit, meaning, name == "scatter.speed", k, centre, wide))
        elif layout.in_slot[k]:
            one = find_parameter(name, layout.chain.catalogue)
            found.append(Sought(name, one.unit, one.meaning, one.percent, k, centre, wide))
    return tuple(found)
