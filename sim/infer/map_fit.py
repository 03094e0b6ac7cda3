"""Maximum a posteriori fit of terms and scatter to everything that a dataset has: what discovery starts from."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.baseline_fit import BaselineFit, fit_believed, objective, only_shared, stopped
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.fitted_belief import coefficients_of, covariance_of, scatter_of
from truearc.sim.infer.likelihood.design_columns import groups_of, lay_out
from truearc.sim.infer.likelihood.prepared_data import take_in
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.infer.parameters import Sought, sought_of
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.printed import Progress


@dataclass(frozen=True, eq=False)
class MapFit:
    """The fit of `terms` (gravity always among them) to a dataset, whose shots are in order."""

    dataset: Dataset
    terms: tuple[str, ...]
    fitted: BaselineFit

    @property
    def evidence(self) -> ScoreTable:
        return self.fitted.evidence

    @property
    def catalogue(self) -> Catalogue:
        return self.fitted.layout.chain.catalogue

    @property
    def converged(self) -> bool:
        return self.fitted.settled

    @property
    def log_posterior(self) -> float:
        """At the fit, up to a constant."""
        return objective(self.evidence, self.fitted.layout)

    @property
    def at_limit(self) -> dict[str, float]:
        """Fitted numbers that stopped at the end of their range, by name."""
        return stopped(self.evidence, self.catalogue)

    @cached_property
    def sought(self) -> tuple[Sought, ...]:
        """The fitted numbers that are reported, a tracker's errors among them."""
        return sought_of(self.fitted.layout)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these."""
        return tuple(one.name for one in self.sought)

    @property
    def values(self) -> dict[str, float]:
        """{name: most probable value} of these."""
        return {one.name: one.value(float(self.evidence.point[one.column])) for one in self.sought}

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Of these, in units of their priors' standard deviations: the inverse of prior and expected information."""
        whole = self.evidence.covariance
        columns = [one.column for one in self.sought]
        sd = np.array([one.sd for one in self.sought])
        return np.asarray(whole[np.ix_(columns, columns)] / np.outer(sd, sd))

    @cached_property
    def belief(self) -> Belief:
        """For whoever forecasts or simulates: without the tracker's errors and random effects."""
        coefficients = coefficients_of(self.evidence, self.terms, self.catalogue)
        names, covariance = covariance_of(self.evidence, self.catalogue)
        return Belief(coefficients, scatter_of(self.evidence), names, covariance, catalogue=self.catalogue)


def fit_map(dataset: Dataset, terms: tuple[str, ...], progress: Progress = lambda done, note: None,
            among: Catalogue | None = None) -> MapFit:
    """Fit the named terms (gravity always among them) and the scatter of the launch to a dataset.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given.

    Deterministic. A fit that did not settle says so in `converged`. InputError: unknown terms, or nothing to fit to.
    """
    catalogue = as_catalogue(among)
    catalogue.find(terms)
    names = (*catalogue.always, *(name for name in terms if name not in catalogue.always))
    dataset = dataset.in_order()
    intake = take_in(dataset, fewest=1)
    if not len(intake.rows):
        why = "; ".join(intake.left_out) or "there are no shots"
        raise InputError(f"{dataset.shots.source}: there is nothing to fit to, neither a track nor a shot with both a "
                         f"launch and something seen of its flight: {why}")
    layout = only_shared(lay_out(intake, names, groups_of(dataset.shots, intake.rows), catalogue))
    return MapFit(dataset, names, fit_believed(intake, layout, progress))
