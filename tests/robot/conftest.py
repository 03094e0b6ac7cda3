"""A picture of the target, and noise that emulated cameras share."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """The target 4 m from the lens."""
    from tests.robot.good_tick import CONFIG
    from truearc.hw.emulated.camera import Stage
    from truearc.sim.world.emulated_robot import make_lens, make_tape
    from truearc_proof.world.camera_damage import StagedCamera, place

    camera, tape = CONFIG.camera, CONFIG.tape
    view = place(4.0, tape.centre_height_m - camera.height_m, camera.pitch_deg)
    return StagedCamera(Stage(view), make_lens(camera), make_tape(tape), 1).expose(0).image


@pytest.fixture(scope="module")
def noise_drawn_once() -> Iterator[None]:
    """Emulated cameras of the same seed and lens share the picture of their noise, to the last bit what each would draw
    for itself, and their generators go on as if they had drawn it: it takes twenty times as long as all the rest."""
    from truearc.hw.emulated import camera

    draw, drawn = camera._make_noise, {}

    def once(lens: Any, level: float, random: np.random.Generator) -> np.ndarray:
        key = (lens.height_px, lens.width_px, level, random.bit_generator.state["state"]["state"])
        if key not in drawn:
            noise = draw(lens, level, random)
            noise.setflags(write=False)
            drawn[key] = noise, random.bit_generator.state
        noise, random.bit_generator.state = drawn[key]
        return noise

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(camera, "_make_noise", once)
        yield
