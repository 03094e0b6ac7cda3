"""A camera that turns while its rows are read: the picture is sheared, and sigma says so, as stated and as smeared."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from truearc import robot
from truearc.hw.emulated.camera import Stage, project
from truearc.robot.config.schema import load_config
from truearc.robot.vision import detect
from truearc.robot.vision.pose import make_optics
from truearc.sim.world.emulated_robot import make_lens, make_tape
from truearc_proof.world.camera_damage import Look, StagedCamera, place, project_turning

pytestmark = pytest.mark.usefixtures("noise_drawn_once")
CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")
LENS = make_lens(CONFIG.camera)
READOUT_S, EXPOSURE_S = 0.03, 0.003


def view_at(distance_m: float, pitch_deg: float, **how: float):
    return place(distance_m, CONFIG.tape.centre_height_m - CONFIG.camera.height_m, pitch_deg, **how)


def trial(rng: np.random.Generator, turn_deg_s: tuple[float, float], seed: int, exposure_s: float, **told: float):
    """Distance, and its estimate by a camera that turns so fast and is configured so."""
    distance_m = rng.uniform(2.4, 8.0)
    camera = replace(CONFIG.camera, pitch_deg=24.0 if distance_m < 6 else 14.0, **told)
    smear_px = CONFIG.camera.fx_px * exposure_s * np.radians(turn_deg_s)
    look = Look(turn_deg_s=turn_deg_s, readout_s=READOUT_S, smear_px=(-float(smear_px[0]), float(smear_px[1])))
    view = view_at(distance_m, camera.pitch_deg, facing_deg=rng.uniform(-30, 30), bearing_deg=rng.uniform(-7, 7))
    eye = StagedCamera(Stage(view), make_lens(camera), make_tape(CONFIG.tape), 20.0, 0.0, seed, look=look)
    return distance_m, detect(eye.expose(0), camera, CONFIG.tape, CONFIG.vision)


def spread(trials) -> float:
    return float(np.sqrt(np.mean([((seen.distance_m - true_m) / seen.sigma_m) ** 2 for true_m, seen in trials])))


def test_rows_are_seen_from_where_the_camera_then_points():
    """A point a hundred rows below another lies beside it by what the camera turned in between; nodding stretches."""
    straight_on = place(6.0, 0.0, 0.0).camera_from_target
    tall = np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]])
    still, _ = project(tall, straight_on, LENS)
    turned, _ = project_turning(tall, straight_on, LENS, 1.0, (30.0, 0.0), READOUT_S)
    nodded, _ = project_turning(tall, straight_on, LENS, 1.0, (0.0, 30.0), READOUT_S)
    late_s = READOUT_S * (still[1, 1] - still[0, 1]) / LENS.height_px
    moved_px = LENS.fx_px * math.radians(30.0) * late_s
    assert turned[1, 0] - turned[0, 0] == pytest.approx(-moved_px, rel=0.02)    # it turned right: things move left
    assert np.ptp(nodded[:, 1]) - np.ptp(still[:, 1]) == pytest.approx(moved_px, rel=0.05)      # and up: they move down
    assert project_turning(tall, straight_on, LENS, 1.0, (30.0, 9.0), 0.0)[0] == pytest.approx(still)


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
