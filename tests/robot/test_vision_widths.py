"""Tape that is not as wide as it is said to be, tape that is partly hidden, and pictures written with a tone curve."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from truearc import robot
from truearc.hw.emulated.camera import Lens, Stage, project
from truearc.robot.config.schema import load_config
from truearc.robot.vision import detect
from truearc_proof.world.camera_damage import USUAL, Look, Patch, StagedCamera, place

pytestmark = pytest.mark.usefixtures("noise_drawn_once")
CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")
CAMERA, TAPE, VISION = CONFIG.camera, CONFIG.tape, CONFIG.vision
RISE_M = TAPE.centre_height_m - CAMERA.height_m
LENS = Lens(CAMERA.width_px, CAMERA.height_px, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)


def see(distance_m, seed=0, look=USUAL, tape=TAPE, hidden=(), **where):
    """The sighting of `tape` at that distance, with these patches of the target's plane hidden."""
    camera = replace(CAMERA, pitch_deg=24.0 if distance_m < 6 else 14.0)
    view = place(distance_m, RISE_M, camera.pitch_deg, **where)
    eye = StagedCamera(Stage(view), LENS, tape, 20.0, 0.0, seed, look=look)
    patches = [np.column_stack([points_m, np.zeros(len(points_m))]) for points_m in hidden]
    eye.clutter(tuple(Patch(project(points_m, view.camera_from_target, LENS)[0], (0, 0, 0)) for points_m in patches))
    return detect(eye.expose(0), camera, TAPE, VISION)


@pytest.mark.parametrize(("distance_m", "blur_px"),
                         [(2.5, 0.6), (4.0, 0.6), (6.0, 0.6), (9.0, 0.6), (2.5, 1.5), (5.0, 1.5)])
@pytest.mark.parametrize("times", [0.5, 2.0])
def test_tape_of_another_width_is_not_the_target(times, distance_m, blur_px):
    """As far as its edges are sharp enough to tell; docs/how-to/vision.md says how far that is."""
    other = replace(TAPE, tape_width_m=times * TAPE.tape_width_m)
    for seed in range(4):
        sighting = see(distance_m, seed, Look(blur_px=blur_px), other, facing_deg=10.0 * seed - 15.0)
        assert not sighting.found and sighting.reason


def test_tape_a_little_wider_or_narrower_is_the_target():
    for times in (0.96, 1.04):
        sighting = see(5.0, tape=replace(TAPE, tape_width_m=times * TAPE.tape_width_m))
        assert sighting.found and sighting.distance_m == pytest.approx(5.0, abs=3 * sighting.sigma_m)


@pytest.mark.parametrize(("look", "bias_m"), [(Look(gamma=2.2), 0.045), (Look(gamma=2.2, halo_share=0.0), 0.015),
                                              (Look(gain=2.5), 0.015)], ids=["gamma", "gamma, no halo", "clipped"])
def test_a_tone_curve_hardly_moves_a_cut_end(look, bias_m):
    """A halo that a tone curve lifts is the part that is not seen in the tape's width."""
    rng, errors, ratios = np.random.default_rng(3), [], []
    for seed in range(60):
        distance_m = rng.uniform(5.0, 9.0)
        sighting = see(distance_m, seed, look, facing_deg=rng.uniform(-30, 30), brightness=rng.uniform(0.8, 1.2))
        if sighting.found:
            errors.append(sighting.distance_m - distance_m)
            ratios.append(errors[-1] / sighting.sigma_m)
    assert len(errors) >= 20 and abs(np.mean(errors)) < bias_m
    assert np.sqrt(np.mean(np.square(ratios))) < 1.5


def hidden_parts():
    """Patches of the target's plane before a level cut at the top, the end of one arm, half an arm, half the bottom."""
    high, flare = TAPE.height_m / 2, (TAPE.top_width_m - TAPE.bottom_width_m) / 2 / TAPE.height_m
    half = 0.5 * TAPE.tape_width_m * np.hypot(1.0, flare)
    outer = [TAPE.bottom_width_m / 2 - 0.1 * flare - half, TAPE.top_width_m / 2 + 0.1 * flare - half]
    end, low, top = 0.45 * TAPE.height_m, 0.5 * TAPE.tape_width_m - high, high + 0.1
    return {"level": [(-1, end), (1, end), (1, 1), (-1, 1)], "one arm": [(0, end), (1, end), (1, 1), (0, 1)],
            "half an arm": [(outer[0], -top), (outer[1], top), (1, top), (1, -top)],
            "half the bottom": [(-1, low), (1, low), (1, -top), (-1, -top)]}


@pytest.mark.parametrize("distance_m", [2.5, 5.0, 8.0])
@pytest.mark.parametrize("part", hidden_parts())
def test_tape_hidden_along_its_own_edges_is_not_the_target(part, distance_m):
    """A twentieth of the height, or half of a straight's width; less than that is in docs/how-to/vision.md."""
    for seed in range(6):
        sighting = see(distance_m, seed, hidden=[np.array(hidden_parts()[part])], facing_deg=10.0 * seed - 25.0)
        assert not sighting.found and sighting.reason
