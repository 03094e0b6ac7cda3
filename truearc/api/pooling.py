"""Pool fits of several rigs or sessions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version

import numpy as np
from jaxtyping import Float

from truearc.api.fitting import Fit
from truearc.api.table import Table
from truearc.api.terms import check_kind
from truearc.errors import InputError
from truearc.sim.data.dataset import hash_dataset
from truearc.sim.infer.belief import Belief, launcher_of, point_belief, replace_values, scale_of
from truearc.sim.infer.fit_report import number_text
from truearc.sim.infer.intervals import Pooling, one_rig, pool_normal, said_by
from truearc.sim.intervals import Z90
from truearc.sim.physics.scales import LINEAR, from_scale
from truearc.sim.printed import Printed
from truearc.sim.tables import make_text

FEWEST = 2
COLUMNS = ("parameter", "value", "low90", "high90", "unit", "differs", "differs_low90", "differs_high90")


@dataclass(frozen=True, eq=False)
class Pooled(Printed):
    """Numbers that several rigs or sessions have in common, and by how much they differ.

    `fits`: of each, in the order given. `names`: of the pooled numbers. `solution`: the posterior, on their scales.
    """

    fits: tuple[Fit, ...]
    names: tuple[str, ...]
    solution: Pooling

    @cached_property
    def belief(self) -> Belief:
        """For a further session or rig of this kind: the common numbers, as uncertain as they are and members differ.
        """
        first = self.fits[0].belief
        solutions = [fit.solution.belief for fit in self.fits]
        coefficients = {term: dict(values) for one in solutions for term, values in one.coefficients.items()}
        scatter = {key: value for one in solutions for key, value in one.scatter.items()}
        start = Belief(coefficients, scatter, self.names, self.solution.next_one, catalogue=first.catalogue)
        moved = replace_values(start, self.solution.common[0])
        ranges = [fit.belief.provenance["range"] for fit in self.fits]
        said = {"method": "pooled", "truearc": version("truearc"), "terms": list(self.fits[0].solution.terms),
                "datasets": [fit.dataset.name for fit in self.fits],
                "datasets_sha256": [hash_dataset(fit.dataset) for fit in self.fits],
                "shots": sum(len(fit.solution.evidence.rows) for fit in self.fits),
                "range": {name: [min(one[name][0] for one in ranges), max(one[name][1] for one in ranges)]
                          for name in ranges[0] if all(name in one for one in ranges)},
                **({"rig": launcher_of(self.fits[0].dataset.rig)} if self._one_rig else {})}
        return replace(point_belief(moved.coefficients, moved.scatter, first.catalogue), names=self.names,
                       covariance=self.solution.next_one, provenance=said)

    @property
    def _one_rig(self) -> bool:
        return one_rig([fit.solution for fit in self.fits])

    def table(self) -> Table:
        """Return a row per number: what is common with its 90 % interval, in `unit`, and how much members differ: the
        standard deviation on the number's scale (of a logarithm: a share) with its 90 % interval."""
        common, covariance = self.solution.common
        error = Z90 * np.sqrt(np.diag(covariance))
        tau = np.quantile(self.solution.tau, [0.5, 0.05, 0.95], axis=0).T
        ends = np.stack([common, common - error, common + error], axis=1)
        return Table(COLUMNS, tuple((name, *self._values(name, numbers), self._unit(name), *map(float, differs))
                                    for name, numbers, differs in zip(self.names, ends, tau, strict=True)))

    def members(self) -> Table:
        """Return a row per dataset and number: by its own shots, and given all datasets, each with its 90 % interval.
        """
        rows = []
        for fit, own, sd in zip(self.fits, self.solution.own, self.solution.own_sd, strict=True):
            alone = {one.name: (one.value, one.low90, one.high90) for one in fit.intervals}
            for name, here, error in zip(self.names, own, Z90 * sd, strict=True):
                given = self._values(name, np.array([here, here - error, here + error]))
                rows.append((fit.dataset.name, name, *alone.get(name, (None, None, None)), *given))
        return Table(("dataset", "parameter", "own", "own_low90", "own_high90", "pooled", "low90", "high90"),
                     tuple(rows))

    def lines(self) -> list[str]:
        """Return the report: what is common, by how much members differ, and each member's numbers."""
        what = "sessions of one rig" if self._one_rig else "rigs"
        shots = [len(fit.solution.evidence.rows) for fit in self.fits]
        head = f"{len(self.fits)} fits pooled as {what}: {sum(shots)} shots ({', '.join(map(str, shots))})"
        common = [(name, number_text(value), f"{number_text(low)} to {number_text(high)}{_after(unit)}",
                   self._differs(name, unit, differs))
                  for name, value, low, high, unit, *differs in self.table().rows]
        each = [(dataset, name, _interval(*numbers[:3]), _interval(*numbers[3:]))
                for dataset, name, *numbers in self.members().rows]
        return [*(f"warning: {line}" for fit in self.fits for line in fit.dataset.accepted), head, "", *make_text(
            ("in common", "value", "90 % interval", "differ by (standard deviation)"), common, right=(1,)), "",
            *make_text(("dataset", "parameter", "by its own shots", "given all"), each)]

    def _differs(self, name: str, unit: str, numbers: Sequence[float]) -> str:
        """In the unit of a number on a linear scale, else in per cent: of the number, or of what a loss leaves."""
        straight = scale_of(name, self.fits[0].solution.catalogue) == LINEAR
        value, low, high = (number_text(one if straight else 100.0 * one) for one in numbers)
        return f"{value} ({low} to {high}){_after(unit if straight else '%')}"

    def _values(self, name: str, numbers: Float[np.ndarray, " n"]) -> list[float]:
        scale = scale_of(name, self.fits[0].solution.catalogue)
        return [float(value) for value in np.asarray(from_scale(scale, numbers))]

    def _unit(self, name: str) -> str:
        return {one.name: one.unit for fit in self.fits for one in fit.solution.sought}[name]


def _after(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _interval(value: float | None, low: float | None, high: float | None) -> str:
    if value is None or low is None or high is None:
        return "-"
    return f"{number_text(value)} ({number_text(low)} to {number_text(high)})"


def pool(fits: Sequence[Fit], *, seed: int = 0) -> Pooled:
    """Pool fits of several rigs, or of several sessions of one, whose numbers may differ.

    Each number of a member is normal about what members have in common, with a standard deviation that is fitted too:
    members that agree are averaged, members that differ keep what is theirs (partial pooling). Sessions of one rig are
    expected to differ by less than rigs. A tracker's errors are each member's own.

    Args:
        fits: Two or more, of the same terms.
        seed: Of the posterior's draws.

    Returns:
        Pooled: `.belief` is for a further session or rig, `.table()` what is common, `.members()` each one's numbers.

    Raises:
        InputError: fewer than two fits, fits of different terms or of the same data, no number to pool, or a fit that
            did not converge.
    """
    for fit in fits:
        check_kind("fits", fit, Fit, "fit(...)")
    if len(fits) < FEWEST:
        raise InputError(f"fits: {len(fits)} given; at least {FEWEST} can be pooled")
    if seed < 0:
        raise InputError(f"seed is {seed}; it cannot be negative")
    for fit in fits:
        _ = fit.belief                # refuses a fit that did not converge
    hashes = [hash_dataset(fit.dataset) for fit in fits]
    for number, one in enumerate(hashes):
        if one in hashes[:number]:
            raise InputError(f"{fits[number].dataset.name}: the same data twice; they would count twice")
    names, said = said_by([fit.solution for fit in fits])
    return Pooled(tuple(fits), names, pool_normal(said, seed))
