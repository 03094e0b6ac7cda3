"""Effects that may change the emulated robot's world between practice and the event, and the sealed draw of one.

An effect exists as options of the MuJoCo world only (truearc.sim.world.options), which neither the robot nor the fitted
simulator reads.
"""

import hashlib
import secrets
from typing import NamedTuple

from truearc.sim.world.options import Options


class WorldChange(NamedTuple):
    """A change of the world: its name with its size, and the terms of the catalogue that are right; () where none is.
    """

    name: str
    options: Options
    terms: tuple[str, ...]


NOTHING = WorldChange("nothing changed", Options(), ())
EFFECTS = (
    WorldChange("head wind of 1.5 m/s", Options(wind_x_m_s=-1.5), ("wind_x",)),
    WorldChange("hood reads 1.5 deg too much", Options(hood_offset_deg=1.5), ("hood_offset",)),
    WorldChange("worn balls: radius -2 %, friction -15 %", Options(ball_radius_scale=0.98, ball_friction_scale=0.85),
                ()),
    WorldChange("cold: 2 C, air of 1.28 kg/m3", Options(temperature_c=2.0, air_density_kg_m3=1.28),
                ("air_change", "air_density")),
    WorldChange("wheel encoders read 3 % too much", Options(encoder_scale=1.03), ("encoder_scale",)),
    WorldChange("camera sees everything 4 % nearer", Options(camera_focal_scale=1.04), ("distance_scale",)),
    WorldChange("rising air of 1 m/s", Options(wind_z_m_s=1.0), ("wind_z",)),
    WorldChange("wet balls: mass +8 %", Options(ball_mass_scale=1.08), ()),
    WorldChange("balls leave 8 cm lower", Options(release_height_error_m=-0.08), ("release_height",)),
)


class Envelope(NamedTuple):
    """A drawn effect, and the text whose SHA-256 is shown before it is opened."""

    number: int                       # in EFFECTS
    effect: WorldChange
    text: str

    @property
    def sha256(self) -> str:
        """The seal: of the text in UTF-8."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def draw_effect(seed: int | None) -> Envelope:
    """Draw an effect and a nonce, from the system's entropy or from a seed."""
    if seed is None:
        number, nonce = secrets.randbelow(len(EFFECTS)), secrets.token_hex(16)
    else:
        import numpy as np  # which --help does without
        rng = np.random.default_rng([seed, 99])
        number, nonce = int(rng.integers(len(EFFECTS))), rng.bytes(16).hex()
    return Envelope(number, EFFECTS[number], f"{EFFECTS[number].name} | {nonce}")
