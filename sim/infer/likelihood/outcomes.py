"""The protocol for outcome observations: the likelihood of a shot's outcome, given one observable of its arrival.

Given the settings, the observable is normally distributed. Further numbers of the arrival shift the boundaries between
outcome classes. There are two implementations: the height at an upright opening (heights.py), and where a ball comes
down in the plane of an opening that faces up (ground.py). Code outside this package does not depend on which one is
used.
"""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

Array = np.ndarray
Numbers = Float[Array, " n"]
CLASSES = {"miss": 0.0, "two": 1.0, "three": 2.0}
# Chosen: most of them
SIDED_SHARE = 0.5                     # of misses (of twos) must have a side before that counts as noted of them


@runtime_checkable
class Outcomes(Protocol):
    """Observations of n arrivals.

    height_m [n]: the observable where it was measured itself (nan elsewhere), which beats the class. classes [n]: 0
    miss, 1 two, 2 three, nan not given. axes: how many coordinates of Prediction.plane scatter; the first is the
    observable, the second lies across. quantity: name of the observable in texts. moves: how many further numbers the
    boundaries depend on; the first is metres by which all boundaries lie farther out. slips: a measured height may be
    one.
    """

    @property
    def quantity(self) -> str: ...

    @property
    def moves(self) -> int: ...

    @property
    def axes(self) -> int: ...

    @property
    def height_m(self) -> Numbers: ...

    @property
    def classes(self) -> Numbers: ...

    @property
    def measured(self) -> Bool[Array, " n"]: ...

    def take(self, index: Int[Array, " k"] | Bool[Array, " n"]) -> "Outcomes":
        """Return those of these shots."""

    def without_slips(self) -> "Outcomes":
        """Return the same, where no measured height is a slip."""

    def at(self, plane: Float[Array, "n k"], across_m: Float[Array, "n 2"] | None = None,
           rise: Float[Array, "n 6"] | None = None) -> "Outcomes":
        """Return the observations at these arrivals (Prediction.plane): of the opening as it is there.

        across_m: mean and spread of the second axis. rise: of shots that hardly reach the rim (others nan), mean and
        spread of the height of the highest point above the rim, by how much the observable (besides falling longer)
        and the speed along go with that height, by how much that speed goes with the rest of the observable, and the
        time of the fall that the observable includes.
        """

    def moves_by(self, slope: Float[Array, "n k columns"]) -> Float[Array, "n moves columns"]:
        """Return slopes of the further numbers from those of the arrivals."""

    def moved(self, change: Float[Array, "n moves"]) -> "Outcomes":
        """Return the observations after the further numbers change."""

    def log_likelihood(self, mean_m: Numbers, spread_m: Numbers) -> Numbers:
        """Return the log-likelihood [n], for an observable normal(mean_m, spread_m)."""

    def slopes_and_information(self, mean_m: Numbers, spread_m: Numbers, asked: Bool[Array, " moves"] | None = None
                               ) -> tuple[tuple[Numbers, ...], Float[Array, "n J J"]]:
        """Return derivatives of the log-likelihood [n] by mean_m, by log spread_m, and by the further numbers; and the
        expected information on these, over all distinguishable outcomes. asked: of which further numbers they are
        needed, by default of all; the others may be zero."""

    def class_chances(self, mean_m: Numbers, spread_m: Numbers, lapses: bool = True) -> Float[Array, "n 3"]:
        """Return the probability [n, 3] of miss, two and three, including slips; of the ball itself without lapses."""

    def chance(self, shot: int, mean_m: Any, spread_m: Any, change: Sequence[Any]) -> Any:
        """Return the likelihood of one shot's observation by many means, spreads and changes of the further numbers;
        arrays that broadcast."""

    def share(self, mean_m: Numbers, spread_m: Numbers) -> Numbers:
        """Return the probability [n] of what was seen of a shot whose height was not measured, without lapses."""

    def hit_chance(self, mean_m: Numbers, spread_m: Numbers) -> Numbers:
        """Return the probability [n] of what the gate asks for: the inner opening, or the only one."""

    def centred(self, mean_m: Numbers) -> Numbers:
        """Return the means [n] of the same shots if they were aimed at the opening's middle."""

    def beside(self, spread_m: Numbers, aside: Numbers) -> Numbers:
        """Return the means [n] of shots aimed where outcomes tell most, low (aside < 0) or high: so many standard
        deviations off the middle of an upright opening, two less off the edge of one that faces up."""

    def points_if_aimed(self, mean_m: Numbers, both: Sequence[tuple[Numbers, Numbers]]) -> Numbers:
        """Return expected points [n] of each shot aimed at the middle by the forecast mean_m, given what was seen of
        it; both: (mean, spread) of all forecasts that are compared, alike likely."""

    def points(self) -> Numbers:
        """Return the points [n] that shots scored; of a measured height, those of its class."""


def best_class(seen: Outcomes, mean_m: Numbers, spread_m: Numbers) -> Int[Array, " n"]:
    """Return the index [n] of the likeliest of miss, two, three."""
    return np.asarray(np.argmax(seen.class_chances(mean_m, spread_m), axis=1))
