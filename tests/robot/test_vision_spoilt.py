"""Pictures of a camera that turns, of tape of another width or partly hidden, and with a tone curve."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG
from truearc.hw.emulated.camera import Stage, project
from truearc.robot.vision import detect
from truearc.robot.vision.pose import make_optics
from truearc.sim.world.emulated_robot import make_lens, make_tape
from truearc_proof.world.camera_damage import USUAL, Look, Patch, StagedCamera, place

pytestmark = pytest.mark.usefixtures("noise_drawn_once")
LENS = make_lens(CONFIG.camera)
READOUT_S, EXPOSURE_S = 0.03, 0.003


def trial(rng: np.random.Generator, turn_deg_s: tuple[float, float], seed: int, exposure_s: float, **told: float):
    """Distance, and its estimate by a camera that turns so fast and is configured so."""
    distance_m = rng.uniform(2.4, 8.0)
    camera = replace(CONFIG.camera, pitch_deg=24.0 if distance_m < 6 else 14.0, **told)
    smear_px = CONFIG.camera.fx_px * exposure_s * np.radians(turn_deg_s)
    look = Look(turn_deg_s=turn_deg_s, readout_s=READOUT_S, smear_px=(-float(smear_px[0]), float(smear_px[1])))
    view = place(distance_m, CONFIG.tape.centre_height_m - CONFIG.camera.height_m, camera.pitch_deg,
                 facing_deg=rng.uniform(-30, 30), bearing_deg=rng.uniform(-7, 7))
    eye = StagedCamera(Stage(view), make_lens(camera), make_tape(CONFIG.tape), seed, look=look)
    return distance_m, detect(eye.expose(0), camera, CONFIG.tape, CONFIG.vision)


def spread(trials) -> float:
    return float(np.sqrt(np.mean([((seen.distance_m - true_m) / seen.sigma_m) ** 2 for true_m, seen in trials])))


def test_errors_are_as_large_as_sigma_says_when_it_is_told_of_turning():
    """Turns drawn as stated, a fifth of them up or down, exposed too shortly to be smeared: unit spread. Configured
    as a global shutter, sigma is far too small."""
    told, untold = [], []
    for seed in range(70):
        turn = 30.0 * np.random.default_rng([1, seed]).standard_normal(2) * (1.0, 0.2)
        for into, how in ((told, {"turn_sigma_deg_s": 30.0}), (untold, {"readout_s": 0.0})):
            into.append(trial(np.random.default_rng(seed), (turn[0], turn[1]), seed, 0.0, **how))
    assert sum(seen.found for _, seen in told) >= 68
    assert 0.7 < spread([one for one in told if one[1].found]) < 1.2
    assert spread([one for one in untold if one[1].found]) > 1.8


@pytest.mark.parametrize("turn_deg_s", [-90, -30, 30, 90])
def test_a_fast_turn_is_known_by_its_smear(turn_deg_s):
    """With default settings: nine times as fast as assumed, and still an honest sigma. Three times as fast smears
    too little to be seen: of 60 three err by more than three sigmas, by four at most."""
    trials = [trial(np.random.default_rng(seed), (turn_deg_s, 0.0), seed, EXPOSURE_S) for seed in range(30)]
    found = [one for one in trials if one[1].found]
    assert len(found) >= 25 and spread(found) < (1.3 if abs(turn_deg_s) == 90 else 1.7)
    assert max(abs(seen.distance_m - true_m) / seen.sigma_m for true_m, seen in found) < 4.5


def test_at_rest_nothing_is_lost():
    """Of a still camera: errors are within 3 mm of what they are where all rows are known to be read at once."""
    errors_m = {0.0: [], 0.03: []}
    for readout_s, into in errors_m.items():
        for seed in range(40):
            true_m, seen = trial(np.random.default_rng(seed), (0.0, 0.0), seed, 0.0, readout_s=readout_s)
            into.append(seen.distance_m - true_m)
    global_m, rolling_m = (float(np.sqrt(np.mean(np.square(into)))) for into in errors_m.values())
    assert rolling_m < global_m + 0.003


def test_a_global_shutter_does_not_shear():
    """Nothing is added where all rows are read at once, or where the camera stands."""
    marks = np.array([[300.0, 200.0], [250.0, 200.0], [220.0, 150.0], [330.0, 150.0]])
    for camera in (replace(CONFIG.camera, readout_s=0.0), replace(CONFIG.camera, turn_sigma_deg_s=0.0)):
        optics = make_optics(camera, 640, 480)
        assert optics.turns == (0.0, 0.0)
    optics = make_optics(CONFIG.camera, 1280, 960)
    shear = math.radians(CONFIG.camera.turn_sigma_deg_s) * CONFIG.camera.readout_s * CONFIG.camera.fx_px / 480
    added = optics.camera_spread(marks) - make_optics(replace(CONFIG.camera, readout_s=0.0), 1280, 960).camera_spread(
        marks)
    assert added[0, 0] == pytest.approx((25.0 * shear) ** 2) and added[0, 4] == pytest.approx(-added[0, 0])


CAMERA, TAPE, VISION = CONFIG.camera, CONFIG.tape, CONFIG.vision
RISE_M = TAPE.centre_height_m - CAMERA.height_m


def see(distance_m, seed=0, look=USUAL, tape=TAPE, hidden=(), **where):
    """The sighting of `tape` at that distance, with these patches of the target's plane hidden."""
    camera = replace(CAMERA, pitch_deg=24.0 if distance_m < 6 else 14.0)
    view = place(distance_m, RISE_M, camera.pitch_deg, **where)
    eye = StagedCamera(Stage(view), LENS, tape, seed, look=look)
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
