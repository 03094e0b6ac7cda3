"""An implausible thing in a dataset, and what several checks of it need."""

import math
from typing import NamedTuple

LENGTHS = {"millimetres": ("mm", 1e-3), "centimetres": ("cm", 0.01), "inches": ("in", 0.0254), "feet": ("ft", 0.3048)}
RPM = math.pi / 30.0
TRACKS = 3                            # fewest tracks, angles and heights that are judged


class Flaw(NamedTuple):
    """One implausible thing: which check, the file and key, and a sentence with what to do."""

    check: str
    place: str
    what: str
    warns: bool = False               # it may well be true

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"
