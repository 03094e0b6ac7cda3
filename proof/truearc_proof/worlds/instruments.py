"""What may be measured of a concealed robot instead of more shots, and what its keeper then reads.

By the words in which discovery proposes it (truearc.sim.discover.plan.recommendations). One of these is one
measurement; it tells of all its terms. Each: {term: standard deviation of one reading, in the unit of the catalogue's
parameter}.
"""

from collections.abc import Mapping

import numpy as np

from truearc_proof.scoring.score_finding import PARAMETER

TOOLS: Mapping[str, Mapping[str, float]] = {
    "target height with a tape": {"target_height": 0.01},
    "exit height with a tape": {"release_height": 0.01},
    "distance with a tape at 3 stations": {"distance_scale": 0.005, "distance_bias": 0.02},
    "hood angle with an inclinometer": {"hood_offset": 0.2},
    "hood angle with an inclinometer, from both sides": {"hood_backlash": 0.2},
    "wheel diameter with calipers, wheel speed with an optical tachometer": {"encoder_scale": 0.003},
    "the wind with an anemometer": {"wind_x": 0.2, "wind_y": 0.2, "wind_z": 0.2},
    "the camera's delay, by a lamp in its view that the robot switches": {"vision_latency": 0.005},
    "a ruler in the tracker's view": {"track_scale": 0.003},
    "a plumb line in the tracker's view": {"track_tilt": 0.2},
    "a stopwatch in the tracker's view": {"track_clock": 0.003},
}


def read_off(tool: str, effects: Mapping[str, float], seed: int) -> dict[str, dict[str, float]]:
    """{term: {"value", "sd"}} by that tool, of a robot with these effects; the same seed reads the same."""
    rng = np.random.default_rng([seed, list(TOOLS).index(tool), 23])
    found = {}
    for term, sd in TOOLS[tool].items():
        truth = PARAMETER[term][1](effects[term]) if term in effects else 0.0
        found[term] = {"value": truth + sd * float(rng.normal()), "sd": sd}
    return found
