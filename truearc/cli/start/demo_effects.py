"""Effects that may change the emulated robot's world between practice and the event, and the sealed draw of one.

An effect exists as options of the MuJoCo world only (truearc.sim.world.options), which neither the robot nor the fitted
simulator reads.
"""

import hashlib
import tomllib
from pathlib import Path
from typing import NamedTuple

from truearc.sim.world.options import Options


class WorldChange(NamedTuple):
    """A change of the world: its name with its size, and the terms of the catalogue that are right; () where none is.
    """

    name: str
    options: Options
    terms: tuple[str, ...]


NOTHING = WorldChange("nothing changed", Options(), ())
_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
EFFECTS = tuple(WorldChange(row["name"], Options(**row["options"]), tuple(row["terms"])) for row in _TABLE["effect"])


class Envelope(NamedTuple):
    """A drawn effect, and the text whose SHA-256 is shown before it is opened."""

    number: int                       # in EFFECTS
    effect: WorldChange
    text: str

    @property
    def sha256(self) -> str:
        """The seal: of the text in UTF-8."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def draw_effect(seed: int) -> Envelope:
    """Draw an effect and a nonce."""
    import numpy as np  # which --help does without
    rng = np.random.default_rng([seed, 99])
    number, nonce = int(rng.integers(len(EFFECTS))), rng.bytes(16).hex()
    return Envelope(number, EFFECTS[number], f"{EFFECTS[number].name} | {nonce}")
