"""Parameters of a likelihood fit, with their priors: those of terms, scatter of the launch, noise of the tracker.

Everything numerical happens in units of the prior: u = (number on the parameter's scale - prior's centre) / prior's sd.
The log prior is then -|u|^2 / 2.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.infer.likelihood.heights import Number
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, find_terms
from truearc.sim.physics.scales import LOG, from_scale, to_scale
from truearc.sim.physics.term import Prior

TRACK_NOISE = "tracks.noise_m"
TRACK_FACTOR_SD = 0.7                 # about rig.toml's own figure: a factor of two either way


@dataclass(frozen=True)
class Sought:
    """One fitted parameter: its "term.parameter" (or "scatter.x", "tracks.noise_m"), unit, prior and meaning.

    percent: shown in per cent.
    """

    name: str
    unit: str
    prior: Prior
    meaning: str
    percent: bool = False

    @property
    def centre(self) -> float:
        """The prior's centre on the parameter's scale."""
        return float(to_scale(self.prior.scale, self.prior.centre))

    def value(self, u: Any) -> Any:
        """The parameter itself at u."""
        return from_scale(self.prior.scale, self.centre + self.prior.sd * u)

    def u(self, value: float) -> float:
        return (float(to_scale(self.prior.scale, value)) - self.centre) / self.prior.sd


# Scatter from shot to shot, whose log is taken to be normal.
SCATTERS = (
    Sought("scatter.speed", "of the exit speed",
           Prior(LOG, 0.015, 0.7, "teams quote one to three per cent of exit speed between like shots; a factor of two "
                                  "either way"), "exit speed from shot to shot (sd)", percent=True),
    Sought("scatter.elevation_deg", "deg",
           Prior(LOG, 0.4, 0.7, "a few tenths of a degree come from how the ball meets the wheels; a factor of two "
                                "either way"), "exit angle from shot to shot (sd)"),
)


@dataclass(frozen=True)
class Model:
    """Terms believed in, and what of them is fitted, in the catalogue's order, then scatters, then tracker noise."""

    facts: Rig
    terms: tuple[str, ...]
    sought: tuple[Sought, ...]
    catalogue: Catalogue

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.sought)

    @property
    def numbers(self) -> tuple[Number, ...]:
        """The terms' parameters as truearc.sim.infer.likelihood.heights wants them; they come first."""
        inner = [one for one in self.sought if one.name.partition(".")[0] in self.terms]
        split = [(*one.name.partition("."), one.prior.scale) for one in inner]
        return tuple((term, key, scale) for term, _, key, scale in split)

    def scales(self) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Centre and standard deviation [p] of the priors on the parameters' scales."""
        return np.array([one.centre for one in self.sought]), np.array([one.prior.sd for one in self.sought])

    def fixed(self) -> dict[str, dict[str, float]]:
        """Return the parameters that are known, and so not fitted."""
        return {term.name: {p.name: p.default for p in term.parameters if p.prior is None}
                for term in find_terms(self.terms, self.catalogue)}

    def values(self, u: Float[np.ndarray, " p"]) -> dict[str, float]:
        """{name: value} at u [p]."""
        return {one.name: float(one.value(number)) for one, number in zip(self.sought, u, strict=True)}


def make_model(rig: Rig, terms: tuple[str, ...], scatters: tuple[Sought, ...] = SCATTERS, tracks: bool = False,
               among: Catalogue | None = None) -> Model:
    """All parameters of the terms that have a prior, the scatters, the tracker's noise where there are tracks.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given. InputError: a term
    that it has not.
    """
    used = find_terms({"gravity", *terms}, among)
    sought = [Sought(f"{term.name}.{p.name}", p.unit, p.prior, p.meaning, p.percent)
              for term in used for p in term.parameters if p.prior is not None]
    sought += scatters
    if tracks:
        if rig.noise.track_m <= 0.0:
            raise InputError("rig.toml: noise.track_m must be above 0 to fit tracks")
        prior = Prior(LOG, rig.noise.track_m, TRACK_FACTOR_SD, "rig.toml's figure")
        sought.append(Sought(TRACK_NOISE, "m", prior, "noise of the tracked positions (sd)"))
    return Model(rig, tuple(term.name for term in used), tuple(sought), as_catalogue(among))
