"""Comparison of two gradings of one world.

Claims, truth and correctness must be equal to the letter, and numbers that were worked out from the data as nearly as
another machine can. The grader's own numbers come from the solver's fits (the ceiling that the data allow, the gain of
the true term): with another state of the solver they may be any, and are reported but not counted as differences.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from truearc_proof.rounds.grader import Graded
from truearc_proof.scoring.score_world import Mark

ROUNDING = 1e-6                       # of sums in another order; forty worlds marked again were off by 2e-12 at most
# Of a chance drawn 2000 times, threshold and all, twice: drawn by six seeds in sixteen worlds it had a standard
# deviation of .023 at most, and two were .06 apart at most; of 24 published ones the worst was off by .04.
DRAWN = 0.08
TOLERANCE: Mapping[str, float] = {"strength": ROUNDING, "error": ROUNDING, "oracle_gain": ROUNDING, "off_m": ROUNDING,
                                  "allowed": DRAWN, "random": 1e-3}     # shots, by steps of one
FITTED = ("alias", "rivals")          # hang on which terms the fits cannot tell apart


class Compared(NamedTuple):
    """other: a sentence for each difference; off: {number: how far it is off at most}, of TOLERANCE; a number
    larger than 1 in parts of itself."""

    other: tuple[str, ...]
    off: Mapping[str, float]


def compare(was: Graded, now: Graded, fits_alike: bool = True) -> Compared:
    """Compare two gradings of one world, field by field.

    For marks, whose fields are fixed: each of TOLERANCE has a tolerance of its own, and its largest difference is
    reported even within it; all others must be equal. Claims have neither fixed fields nor such tolerances;
    truearc_proof.rounds.reproduce_claims compares them.

    Args:
        was: As published.
        now: As marked again.
        fits_alike: Both by one state of the solver, so that its fits are the same.
    """
    other, off = [], dict.fromkeys(TOLERANCE, 0.0)
    for when, before, after in (("", was.first, now.first), ("with further shots: ", was.again, now.again)):
        if before is None or after is None:
            other += [f"{when}was marked only once"] if before is not after else []
            continue
        for name in Mark.__struct_fields__:
            old, new = getattr(before, name), getattr(after, name)
            far = _far(old, new) if name in TOLERANCE else None
            if far is not None:
                off[name] = max(off[name], far)
            if not fits_alike and (name in TOLERANCE or name in FITTED):
                continue
            if (far is None and old != new) or (far is not None and not far <= TOLERANCE[name]):
                other.append(f"{when}{name} is {new!r}, was {old!r}")
    return Compared(tuple(other), off)


def _far(old: Any, new: Any) -> float | None:
    """None where they are not as many numbers."""
    before, after = (one if isinstance(one, tuple) else (one,) for one in (old, new))
    if len(before) != len(after) or None in (*before, *after):
        return None
    farthest: float | None = max(abs(one - two) / max(1.0, abs(one)) for one, two in zip(before, after, strict=True))
    return farthest
