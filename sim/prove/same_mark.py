"""Whether a world that is marked again is marked the same: what was claimed, what is true and what was right to the
letter, what was worked out from the data as nearly as another machine can."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from sim.prove.marking import Mark
from sim.prove.opener import Graded

ROUNDING = 1e-6                       # of sums in another order; forty worlds marked again were off by 2e-12 at most
# Of a chance drawn 2000 times, threshold and all, twice: drawn by six seeds in sixteen worlds it had a standard
# deviation of .023 at most, and two were .06 apart at most; of 24 published ones the worst was off by .04.
DRAWN = 0.08
TOLERANCE: Mapping[str, float] = {"strength": ROUNDING, "error": ROUNDING, "oracle_gain": ROUNDING, "off_m": ROUNDING,
                                  "allowed": DRAWN}


class Compared(NamedTuple):
    """other: what is marked otherwise, in words; off: {number: how far it is off at most}, of TOLERANCE; a number
    larger than 1 in parts of itself."""

    other: tuple[str, ...]
    off: Mapping[str, float]


def compare(was: Graded, now: Graded) -> Compared:
    """Two gradings of one world."""
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
            if (far is None and old != new) or (far is not None and not far <= TOLERANCE[name]):
                other.append(f"{when}{name} is {new!r}, was {old!r}")
    return Compared(tuple(other), off)


def _far(old: Any, new: Any) -> float | None:
    """None where they are not as many numbers."""
    before, after = (one if isinstance(one, tuple) else (one,) for one in (old, new))
    if len(before) != len(after) or None in (*before, *after):
        return None
    return max(abs(one - two) / max(1.0, abs(one)) for one, two in zip(before, after, strict=True))
