"""What may be measured of a concealed robot instead of more shots, and what its keeper then reads.

By the ids of the terms' instruments (truearc.sim.physics.term.Instrument). One of these is one measurement of
all its terms. Each: {term: standard deviation of one reading, in the unit of the catalogue's parameter}. Their order
seeds the readings. The solver's hash covers this file, and none that makes data.
"""

from collections.abc import Mapping

import numpy as np

from truearc_proof.scoring.score_finding import PARAMETER

TOOLS: Mapping[str, Mapping[str, float]] = {
    "target_height_tape": {"target_height": 0.01},
    "exit_height_tape": {"release_height": 0.01},
    "distance_tape": {"distance_scale": 0.005, "distance_bias": 0.02},
    "inclinometer": {"hood_offset": 0.2},
    "inclinometer_both_ways": {"hood_backlash": 0.2},
    "calipers_tachometer": {"encoder_scale": 0.003},
    "anemometer": {"wind_x": 0.2, "wind_y": 0.2, "wind_z": 0.2},
    "delay_lamp": {"vision_latency": 0.005},
    "ruler": {"track_scale": 0.003},
    "plumb_line": {"track_tilt": 0.2, "track_roll": 0.2},
    "stopwatch": {"track_clock": 0.003},
}


def read_off(tool: str, effects: Mapping[str, float], seed: int) -> dict[str, dict[str, float]]:
    """{term: {"value", "sd"}} by that tool, of a robot with these effects; the same seed reads the same."""
    rng = np.random.default_rng([seed, list(TOOLS).index(tool), 23])
    found = {}
    for term, sd in TOOLS[tool].items():
        truth = PARAMETER[term][1](effects[term]) if term in effects else 0.0
        found[term] = {"value": truth + sd * float(rng.normal()), "sd": sd}
    return found
