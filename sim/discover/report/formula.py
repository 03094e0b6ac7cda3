"""The curve of an unexplained effect as a short formula, where one does as well: a constant and one power of the
covariate.

Powers are of dimensionless numbers only: the covariate in units of its median; for a push also the spin parameter
S = r w / v at the exit, the push then being in units of rho A v^2 / 2 m there, as forces of the air are. The fit is to
amplitudes of launches and flights through their sensitivities, never to derivatives of tracks. A formula is empirical:
it says how the effect varies over the recorded shots, not why.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.discover.detect.covariates import Covariate
from truearc.sim.discover.detect.free_curve import Correction, unseen
from truearc.sim.infer.baseline_fit import BaselineFit
from truearc.sim.infer.held_out import clustered_error
from truearc.sim.infer.likelihood.prepared_data import Intake
from truearc.sim.infer.likelihood.score_table import Array

POWERS = (1.0, 2.0, 3.0, -1.0, -2.0, 0.5)
WHOLE = (1.0, 2.0, 3.0)               # powers of what may be zero or negative
LEAST_RATIO = 0.05                    # smallest to largest from which a number may have a negative power
RESAMPLES = 400
STABLE = 0.95                         # share of resamples in which the same form must be the best
SAME = 1.0 - 1e-9                     # correlation of forms that are one
KELVIN = 273.15
UNITS = {"_rad_s": "rad/s", "_rev_s": "rev/s", "_m_s": "m/s", "_deg": "deg", "_pa": "Pa", "_kg": "kg", "_m": "m",
         "_s": "s", "_v": "V", "_c": "degC"}      # by the ends of columns' names


@dataclass(frozen=True)
class Form:
    """One way an amplitude may go: `values` [n], dimensionless or in the push's unit, and how it is written."""

    values: Float[Array, " n"]
    written: str


def find_formula(correction: Correction, fitted: BaselineFit, seed: int) -> str | None:
    """The best form as text with its fitted numbers; None where none is as good on unseen shots as the free curve
    (within one clustered standard error), or which is best changes with the shots.

    correction: of one covariate; of others there is no formula.
    """
    evidence, what = correction.evidence, correction.test.what
    if not isinstance(what, Covariate):
        return None
    rows = evidence.rows
    forms = _different(_forms(what, rows, correction, fitted.intake))
    if not forms:
        return None
    ones = np.ones(len(rows))
    scores, found = zip(*(unseen(evidence, np.stack([ones, form.values], axis=1)) for form in forms), strict=True)
    best = int(np.argmax([score.mean() for score in scores]))
    short = correction.log_after - scores[best]
    if short.mean() > clustered_error(short, fitted.together) or not _stable(scores, fitted.together, best, seed):
        return None
    return _write(correction, forms[best], found[best])


def _forms(what: Covariate, rows: Int[Array, " n"], correction: Correction, intake: Intake) -> Iterator[Form]:
    """Powers of the covariate; of a push also in units of the air's pressure, and powers of the spin parameter."""
    ratio, unit = _ratio(what, rows)
    if not np.isfinite(ratio).all():
        return
    pressed = _pressure(intake) if correction.evidence.columns[0].unit == "m/s2" else None
    for power in _powers(ratio):
        yield Form(ratio**power, f"({what.name} / {unit}){_raised(power)}")
        if pressed is not None:
            yield Form(pressed * ratio**power, f"({what.name} / {unit}){_raised(power)} rho A v^2 / 2 m")
    spin = _spin_parameter(intake)
    if pressed is not None and spin is not None and {"exit_spin_rev_s", "exit_speed_m_s"} & set(what.names):
        for power in _powers(spin):
            yield Form(pressed * spin**power, f"S{_raised(power)} rho A v^2 / 2 m")


def _different(forms: Iterator[Form]) -> list[Form]:
    """Those that are not one of the former in other words: S^2 v^2 is a matter of spin alone."""
    kept: list[Form] = []
    for form in forms:
        if np.ptp(form.values) > 0.0 and all(abs(np.corrcoef(form.values, one.values)[0, 1]) < SAME for one in kept):
            kept.append(form)
    return kept


def _ratio(what: Covariate, rows: Int[Array, " n"]) -> tuple[Float[Array, " n"], str]:
    """(the covariate in units of about its median, that unit); temperatures from absolute zero."""
    values, unit = what.values[rows], next((unit for end, unit in UNITS.items() if what.name.endswith(end)), "")
    if unit == "degC":
        values, unit = values + KELVIN, "K"
    typical = float(np.median(np.abs(values)))
    scale = float(f"{typical if typical > 0.0 else np.abs(values).max():.2g}")
    return values / (scale or 1.0), f"{scale:g} {unit}".strip()


def _powers(ratio: Float[Array, " n"]) -> Sequence[float]:
    return POWERS if ratio.min() > LEAST_RATIO * ratio.max() else WHOLE


def _raised(power: float) -> str:
    return "" if power == 1.0 else f"^{power:g}"


def _pressure(intake: Intake) -> Float[Array, " n"]:
    """rho A v^2 / 2 m at the exit [n], m/s2."""
    lanes = intake.lanes
    area_m2 = np.pi * np.asarray(lanes.ball_m)**2
    speed_m_s = np.asarray(lanes.rolling.speed_m_s)
    return np.asarray(0.5 * intake.rig.air.density_kg_m3 * area_m2 * speed_m_s**2 / lanes.ball_kg)


def _spin_parameter(intake: Intake) -> Float[Array, " n"] | None:
    """r w / v at the exit [n]; None where some ball has no spin."""
    lanes = intake.lanes
    spin = np.abs(2.0 * math.pi * np.asarray(lanes.rolling.spin_rev_s) * lanes.ball_m / lanes.rolling.speed_m_s)
    return spin if np.isfinite(spin).all() and spin.min() > 0.0 else None


def _stable(scores: Sequence[Float[Array, " n"]], label: Int[Array, " n"], best: int, seed: int) -> bool:
    """Whether the same form is the best in most resamples of the clusters."""
    totals = np.stack([np.bincount(label, score) for score in scores])
    totals = totals[:, np.unique(label)]
    rng, count = np.random.default_rng(seed), totals.shape[1]
    weights = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    return bool(np.mean((weights @ totals.T).argmax(1) == best) >= STABLE)


def _write(correction: Correction, form: Form, found: Float[Array, "2"]) -> str:
    """found [2]: the constant and the form's factor."""
    column = correction.evidence.columns[0]
    constant = f"{found[0]:.2g} {'-' if found[1] < 0.0 else '+'} {abs(found[1]):.2g}"
    unit = "" if column.unit == "1" else f" [{column.unit}]"
    return f"{column.name}{unit} = {constant} {form.written}"
