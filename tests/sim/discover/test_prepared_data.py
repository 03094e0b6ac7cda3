"""The data prepared from a dataset: which shots, what of each, how sure; what is left out is said."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.mixed import FLOWN, LANDED, MEASURED, SHOTS, THROWN, make_mixed
from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, Traces, Tracks
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, Intake, take_in
from truearc.sim.infer.likelihood.forward_model import DEVIATES
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world


@pytest.fixture(scope="module")
def mixed() -> Dataset:
    return make_mixed()


@pytest.fixture(scope="module")
def intake(mixed: Dataset) -> Intake:
    return take_in(mixed)


def changed(dataset: Dataset, name: str, rows: np.ndarray, value: float) -> Dataset:
    column = dataset.shots.number(name).copy()
    column[rows] = value
    return replace(dataset, shots=replace(dataset.shots, numbers={**dataset.shots.numbers, name: column}))


def test_every_shot_brings_what_was_seen_of_it(intake: Intake) -> None:
    assert intake.rows.tolist() == list(range(SHOTS))
    assert intake.tracked.tolist() == np.setdiff1d(np.arange(SHOTS), LANDED).tolist()
    assert intake.marked.tolist() == np.setdiff1d(np.arange(SHOTS), [*FLOWN, *THROWN]).tolist()
    assert np.isfinite(intake.exits).all(1).nonzero()[0].tolist() == MEASURED.tolist()
    assert np.asarray(intake.lanes.free).nonzero()[0].tolist() == THROWN.tolist()
    assert intake.left_out == ()


def test_measured_exits_are_evidence_and_do_not_replace_wheels_and_hood(mixed: Dataset, intake: Intake) -> None:
    shots = mixed.shots
    rolled = (shots.number("wheel_lower_rad_s") * 0.0508 + shots.number("wheel_upper_rad_s") * 0.0349) / 2.0
    launched = np.setdiff1d(np.arange(SHOTS), THROWN)
    assert np.asarray(intake.lanes.rolling.speed_m_s)[launched] == pytest.approx(rolled[launched])
    assert intake.exits[MEASURED, 0] == pytest.approx(np.log(shots.number("exit_speed_m_s")[MEASURED]))
    assert intake.exits[MEASURED, 1] == pytest.approx(np.radians(shots.number("exit_deg")[MEASURED]))
    assert intake.exit_sd[MEASURED, 0] == pytest.approx(0.05 / shots.number("exit_speed_m_s")[MEASURED])


def test_doubt_is_the_sensors_own(intake: Intake) -> None:
    """By hand from rig.toml's noise: an encoder each, the hood, the distance; spin scatter and release by the house."""
    variance = dict(zip(DEVIATES, intake.noise_var.T, strict=True))
    row = int(LANDED[0])
    speed = float(np.asarray(intake.lanes.rolling.speed_m_s)[row])
    wheel = 0.5 * np.hypot(0.0508, 0.0349) / 2.0
    assert variance["log_speed"][row] == pytest.approx((wheel / speed)**2, rel=1e-6)
    assert variance["elevation_rad"][row] == pytest.approx(np.radians(0.2)**2)
    assert variance["distance_m"][row] == 0.0              # it is one of what scatters, by a multiple that is fitted
    assert variance["spin_share"][row] > 0.05**2
    assert (variance["vx_m_s"][THROWN] > 1.0).all() and variance["vx_m_s"][row] == 0.0
    assert (variance["log_speed"][THROWN] == 0.0).all() and (variance["elevation_rad"][THROWN] == 0.0).all()
    assert intake.scattered[row] == pytest.approx([1.0, 1.0, 1.0, 0.03**2, 1.0, 1.0])
    assert not intake.scattered[THROWN, :3].any()


def test_a_thrown_ball_starts_where_its_track_does(mixed: Dataset, intake: Intake) -> None:
    assert mixed.tracks is not None
    for row in THROWN:
        here = mixed.tracks.shot == row
        first = [float(column[here][0]) for column in (mixed.tracks.x_m, mixed.tracks.y_m, mixed.tracks.z_m)]
        assert np.asarray(intake.lanes.start_m)[row] == pytest.approx(first, abs=0.06)
        ahead = np.polyfit(mixed.tracks.t_s[here], mixed.tracks.x_m[here], 2)[1]
        assert np.asarray(intake.lanes.start_m_s)[row, 0] == pytest.approx(ahead, abs=1e-6)


def test_levels() -> None:
    plain, telemetry, tracked = (shoot(make_world({}, level, 12, 1)) for level in ("L0", "L1", "L2"))
    assert [take_in(one).level for one in (plain, telemetry, tracked)] == ["L0", "L1", "L2"]
    traces = Traces(np.arange(12), np.zeros(12), ("battery_v",) * 12, np.full(12, 12.0))
    assert take_in(replace(plain, traces=traces)).level == "L1"
    battery = {**plain.shots.numbers, "battery_v": np.linspace(12.0, 11.0, 12)}
    assert take_in(replace(plain, shots=replace(plain.shots, numbers=battery))).level == "L1"
    timed = {**plain.shots.numbers, "t_s": np.arange(12.0), "miss_height_m": np.full(12, 0.1)}
    assert take_in(replace(plain, shots=replace(plain.shots, numbers=timed))).level == "L0"


def test_what_is_left_out_is_said_and_counted(mixed: Dataset) -> None:
    blind = changed(mixed, "distance_m", LANDED[:3], np.nan)
    intake = take_in(blind)
    assert any(note.startswith(f"3 of {SHOTS} shots: no distance_m") for note in intake.left_out)
    assert set(range(SHOTS)) - set(intake.rows.tolist()) == set(LANDED[:3].tolist())
    assert mixed.tracks is not None
    short = ~((mixed.tracks.shot == FLOWN[0]) & (mixed.tracks.t_s > 0.05))
    cut = replace(mixed, tracks=Tracks(*(column[short] for column in vars(mixed.tracks).values())),
                  left_out=("row 3: no such ball",))
    said = take_in(cut)
    assert said.left_out[0] == "row 3: no such ball"
    assert any(note.startswith("1 tracks with fewer than") for note in said.left_out)
    assert FLOWN[0] not in said.rows


def test_bad_input_is_named(mixed: Dataset) -> None:
    few = replace(mixed, shots=mixed.shots.take(np.arange(FEWEST_SHOTS - 1)), tracks=None)
    with pytest.raises(InputError, match=f"{FEWEST_SHOTS - 1} shots are too few.*{FEWEST_SHOTS} at least"):
        take_in(few)
    facts = type(mixed.facts)(ball=mixed.facts.ball, launcher=mixed.facts.launcher, noise=mixed.facts.noise)
    with pytest.raises(InputError, match=r"centre_height_m: missing key"):
        take_in(replace(mixed, facts=facts))
