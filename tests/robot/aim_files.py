"""Sealed aim files for tests, made without the simulator."""

from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG
from truearc.robot.aim_file import SCHEMA, AimContent, Curve, Segment, contract_hash, rig_of
from truearc.robot.config.schema import AimConfig
from truearc.robot.gate import UNSEALED, seal

BY_BELIEF = replace(CONFIG, aim=AimConfig("belief", 0.01))
X = (2.0, 3.0, 4.5, 6.0)
HOOD = Curve((60.0, 54.0, 46.0, 44.0), (-8.0, -5.0, -3.0, 0.5))
RATIO = Curve((0.40, 0.45, 0.52, 0.60), (0.02, 0.06, 0.05, 0.07))
LEAD = Curve((0.0, 0.5, 1.0, 1.5), (0.5, 0.5, 0.33, 0.3))
SEGMENT = Segment(X, HOOD, RATIO, LEAD)
CONTENT = AimContent(SCHEMA, UNSEALED, contract_hash(), "wind", rig_of(CONFIG.rig), (SEGMENT,), {"version": "test"})


def sealed(content: AimContent = CONTENT) -> bytes:
    return seal(msgspec.json.encode(content))


def write(path: Path, content: AimContent = CONTENT) -> Path:
    path.write_bytes(sealed(content))
    return path


def shifted(curve: Curve, by: float) -> Curve:
    return Curve(tuple(np.add(curve.value, by).tolist()), curve.slope)
