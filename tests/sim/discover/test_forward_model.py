"""Predictions of a shot: against SciPy's DOP853 and the catalogue's own forecast; slopes against differences."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.sim.discover.mixed import BELIEVED, FLOWN, LANDED, SHOTS, THROWN, make_mixed
from truearc.sim.data.dataset import Dataset, circumstances_of
from truearc.sim.infer.likelihood.data import Intake, take_in
from truearc.sim.infer.likelihood.forward_model import DEVIATES, DIRECTIONS, Chain, Prediction, pad_lanes, see_slopes
from truearc.sim.infer.likelihood.layout import lay_out
from truearc.sim.physics.catalogue import effective, find_parameter
from truearc.sim.physics.simulate import opening_of, predict

pytestmark = pytest.mark.slow
RADIUS, MASS, RHO, G = 0.0889, 0.14, 1.2, 9.81
HEIGHTS = 0.75, 2.44                  # release, target
AIR = {"drag.cd": 0.5, "magnus.cl": 0.12, "spin_decay.rate_per_s": 0.8, "wind_x.speed_m_s": -1.5,
       "wind_y.speed_m_s": 0.7, "wind_z.speed_m_s": 0.4, "exit_efficiency.loss": 0.2}
# a bit of every term; by how much a ball departs from the others is unknown, so ball_spread does nothing
ALL = AIR | {
    "hood_offset.angle_deg": 0.7, "hood_backlash.angle_deg": 0.4, "encoder_scale.share": 0.01,
    "distance_scale.share": 0.02, "distance_bias.bias_m": -0.05, "vision_latency.delay_s": 0.05,
    "track_scale.share": 0.02, "track_tilt.angle_deg": 0.5, "track_clock.share": -0.01,
    "wheel_slip.loss_per_m_s": 0.005, "wheel_droop.loss": 0.03, "ball_compression.share": 0.1, "ball_wear.loss": 0.03,
    "battery_sag.sensitivity": 0.4, "rapid_fire.loss": 0.05, "release_height.above_m": 0.03, "spin_drag.share": 0.1,
    "drag_reynolds.slope": -0.2, "lift_saturation.rate": 0.6, "drag_wear.share": 0.1, "air_density.share": 1.0,
    "buoyancy.share": 1.0, "added_mass.share": 0.8, "target_height.rise_m": 0.04, "rim_catch.reach_m": 0.02}
SILENT = {"ball_spread.spread"}


@dataclass(frozen=True)
class Stage:
    """Shots ready to fly."""

    dataset: Dataset
    intake: Intake
    chain: Chain
    edges_s: np.ndarray

    def point(self, values: dict[str, float]) -> np.ndarray:
        wanted = {".".join(slot): number for number, slot in enumerate(self.chain.slots)}
        point = np.array([float(find_parameter(name).default) for name in wanted])
        for name, value in values.items():
            point[wanted[name]] = value
        return point

    def see(self, values: dict[str, float], deviates: np.ndarray) -> Prediction:
        lanes, n = pad_lanes(self.intake.lanes)
        padded = np.resize(deviates, (len(lanes.distance_m), self.chain.deviates))
        seen, _ = see_slopes(self.chain, lanes, jnp.asarray(self.point(values)), jnp.asarray(padded),
                             jnp.asarray(self.edges_s), jnp.zeros((self.chain.size, 1)))
        return Prediction(*(np.asarray(part)[:n] for part in seen))

    def none(self) -> np.ndarray:
        return np.zeros((SHOTS, self.chain.deviates))


@pytest.fixture(scope="module")
def stage() -> Stage:
    dataset = make_mixed()
    intake = take_in(dataset)
    layout = lay_out(intake, BELIEVED)
    return Stage(dataset, intake, layout.chain, layout.edges_s)


def odd_deviates(stage: Stage) -> np.ndarray:
    """Each about one of its own standard deviations."""
    scale = dict(zip(DEVIATES, (
        0.02, 0.01, 0.02, 0.1, 0.05, 0.01, 0.05, 0.05, 0.02, 0.02, 0.02, 0.3, 0.3, 0.3), strict=True))
    rng = np.random.default_rng(3)
    return rng.normal(size=(SHOTS, stage.chain.deviates)) * [scale[name] for name in DEVIATES[:stage.chain.deviates]]


def start_of(stage: Stage, row: int, deviate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(state [6], spin [3] in rad/s) at the launch, or where the track of a thrown ball begins, by plain geometry."""
    shots, lanes = stage.dataset.shots, stage.intake.lanes
    if row in THROWN:
        place, velocity = lanes.start_m[row] + deviate[8:11], lanes.start_m_s[row] + deviate[11:14]
        right = np.cross(velocity, [0.0, 0.0, 1.0])
        rim_m_s = deviate[7] * np.linalg.norm(velocity)
        return np.concatenate([place, velocity]), right / np.linalg.norm(right) * rim_m_s / RADIUS
    lower, upper = shots.number("wheel_lower_rad_s")[row] * 0.0508, shots.number("wheel_upper_rad_s")[row] * 0.0349
    speed, spin = (lower + upper) / 2.0 * 0.8, (lower - upper) / (2.0 * math.pi * RADIUS)
    speed, aside = speed * math.exp(deviate[0]), deviate[2]
    up = math.radians(shots.number("hood_deg")[row]) + deviate[1]
    ahead = np.array([math.cos(up) * math.cos(aside), math.cos(up) * math.sin(aside), math.sin(up)])
    right = np.array([math.sin(aside), -math.cos(aside), 0.0])
    velocity = speed * ahead + deviate[11:14]
    return (np.concatenate([deviate[8:11] + np.array([0.0, 0.0, HEIGHTS[0]]), velocity]),
            right * (spin * (1.0 + deviate[3]) * 2.0 * math.pi + deviate[7] * speed / RADIUS))


def rate(t: float, state: np.ndarray, spin_rad_s: np.ndarray, own: float) -> np.ndarray:
    """Weight, quadratic drag and lift in proportion to spin and speed, both by the wind, the spin dying away."""
    through = state[3:] - [AIR["wind_x.speed_m_s"], AIR["wind_y.speed_m_s"], AIR["wind_z.speed_m_s"]]
    drag = -0.5 * RHO * AIR["drag.cd"] * (1.0 + own) * math.pi * RADIUS**2 * np.linalg.norm(through) * through
    turns = spin_rad_s / (2.0 * math.pi) * math.exp(-AIR["spin_decay.rate_per_s"] * t)
    lift = AIR["magnus.cl"] * 4.0 / 3.0 * 4.0 * math.pi**2 * RADIUS**3 * RHO * np.cross(turns, through)
    return np.concatenate([state[3:], (drag + lift) / MASS - [0.0, 0.0, G]])


def reference(stage: Stage, row: int, deviate: np.ndarray) -> tuple[float, float, np.ndarray]:
    """(height over the target's centre, sideways, track [L, 3]) by DOP853; nan where it never gets to the plane."""
    state, spin = start_of(stage, row, deviate)
    plane_m = stage.intake.lanes.distance_m[row] + deviate[4]
    flown = solve_ivp(rate, (0.0, 3.0), state, "DOP853", args=(spin, deviate[6]), rtol=1e-10, atol=1e-11,
                      dense_output=True, events=lambda t, y, *_: y[0] - plane_m)
    at = flown.y_events[0][0] if len(flown.y_events[0]) else np.full(6, np.nan)
    times = stage.intake.lanes.lead_s[row] + deviate[5] + stage.intake.lanes.time_s[row]
    return at[2] - HEIGHTS[1], at[1], flown.sol(times)[:3].T


def test_heights_and_tracks_are_those_of_dop853(stage: Stage) -> None:
    deviates = odd_deviates(stage)
    seen = stage.see(AIR, deviates)
    tracked = set(stage.intake.tracked.tolist())
    near = 0
    for row in range(0, SHOTS, 3):
        if 16 <= row < 24:
            continue                  # their speed and spin are not the wheels'
        height, aside, track = reference(stage, row, deviates[row])
        if seen.near[row] and row not in THROWN:
            near += 1
            assert seen.plane[row, :2] == pytest.approx([height, aside], abs=1e-4)
        if row in tracked:
            assert seen.track_m[row] == pytest.approx(track, abs=1e-6)
    assert near >= 6


def test_heights_are_those_of_the_forecast_with_terms_of_every_stage(stage: Stage) -> None:
    """Another integrator, terms put in by other code. Its flights end at the floor and where they turn back."""
    seen = stage.see(ALL, stage.none())
    launched = np.setdiff1d(np.arange(SHOTS), THROWN)
    values: dict[str, dict[str, float]] = {}
    for name, value in ALL.items():
        term, _, parameter = name.partition(".")
        values.setdefault(term, {})[parameter] = value
    circumstances = circumstances_of(stage.dataset)
    shots = stage.dataset.shots.take(launched)
    # what was measured on the ball is evidence here, there it is the launch
    shots = type(shots)(shots.shot_id, {k: v for k, v in shots.numbers.items() if not k.startswith("exit_")},
                        shots.texts)
    theirs = type(circumstances)(*(part if np.ndim(part) == 0 else part[launched] for part in circumstances))
    crossing = predict(stage.dataset.facts, values, shots, circumstances=theirs)
    opening = opening_of(stage.dataset.facts, effective(values, circumstances))
    both = crossing.reached & seen.near[launched]
    assert both.sum() >= 20
    off = crossing.height_m[both] - opening.centre_m
    assert seen.plane[launched[both], 0] == pytest.approx(off, abs=1e-4)


def slopes_along(stage: Stage, values: dict[str, float], deviates: np.ndarray) -> list[Prediction]:
    """One Seen of slopes an input, in chunks of one size so that one program does them all."""
    lanes, n = pad_lanes(stage.intake.lanes)
    padded = jnp.asarray(np.resize(deviates, (len(lanes.distance_m), stage.chain.deviates)))
    width, size, found = stage.chain.deviates, stage.chain.size, []
    for first in range(0, size, width):
        basis = np.zeros((size, width))
        chunk = range(first, min(first + width, size))
        basis[list(chunk), range(len(chunk))] = 1.0
        _, slopes = see_slopes(stage.chain, lanes, jnp.asarray(stage.point(values)), padded,
                               jnp.asarray(stage.edges_s), jnp.asarray(basis))
        for k in range(len(chunk)):
            found.append(Prediction(*(np.asarray(part)[:n, ..., k] if np.ndim(part) > 1 else part for part in slopes)))
    return found


@pytest.fixture(scope="module")
def slopes(stage: Stage) -> list[Prediction]:
    return slopes_along(stage, ALL, odd_deviates(stage))


def test_every_parameter_of_the_catalogue_is_felt_somewhere(stage: Stage, slopes: list[Prediction]) -> None:
    """A slot wired to nothing would pass every comparison with differences."""
    rows, near = stage.intake.tracked, stage.see(ALL, odd_deviates(stage)).near
    felt = {".".join(slot) for number, slot in enumerate(stage.chain.slots)
            if np.abs(slopes[number].track_m[rows]).max() > 1e-6 or np.abs(slopes[number].plane[near]).max() > 1e-6}
    assert {".".join(slot) for slot in stage.chain.slots} - felt == SILENT


def test_free_pushes_are_accelerations_in_the_balls_own_directions(stage: Stage, slopes: list[Prediction]) -> None:
    """Against DOP853 with the push written out: throughout, in one band of time, in proportion to the speed."""
    first = len(stage.chain.slots) + stage.chain.deviates
    width = stage.chain.pushes // len(DIRECTIONS)
    still = slopes_along(stage, AIR, stage.none())
    row, size = int(FLOWN[1]), 1e-3
    state, spin = start_of(stage, row, stage.none()[row])
    padded = stage.intake.lanes.lead_s[row] + stage.intake.lanes.time_s[row]
    times = np.unique(padded)
    low_s, high_s = stage.edges_s[0], stage.edges_s[1]
    shapes = {0: lambda t, speed: 1.0, 2: lambda t, speed: float(low_s <= t < high_s),
              width - 1: lambda t, speed: speed / 10.0}
    for direction in range(3):
        for place, shape in shapes.items():
            tracks = []
            for sign in (1.0, -1.0):
                def pushed(t: float, y: np.ndarray, sign: float = sign, direction: int = direction,
                           shape=shape) -> np.ndarray:  # type: ignore[no-untyped-def]
                    speed = np.linalg.norm(y[3:])
                    along = y[3:] / speed
                    left = np.array([-along[1], along[0], 0.0]) / math.hypot(along[0], along[1])
                    axis = (along, np.cross(along, left), left)[direction]
                    whole = rate(t, y, spin, 0.0)
                    whole[3:] += sign * size * shape(t, speed) * axis
                    return whole
                tracks.append(solve_ivp(pushed, (0.0, times[-1] + 1e-9), state, "DOP853", rtol=1e-10, atol=1e-12,
                                        t_eval=times, max_step=0.005).y[:3].T)
            exact = (tracks[0] - tracks[1]) / (2.0 * size)
            found = still[first + direction * width + place].track_m[row][:len(times)]
            # a band begins and ends inside a step: a tenth of a frame's worth
            assert found == pytest.approx(exact, abs=2e-3 if place == 2 else 1e-4), (direction, place)


def test_a_ball_that_never_comes_near_says_nothing(stage: Stage) -> None:
    seen = stage.see({**AIR, "exit_efficiency.loss": 0.9}, stage.none())
    assert not seen.near[LANDED].any()
    assert np.isfinite(seen.plane).all() and np.isfinite(seen.track_m).all()
