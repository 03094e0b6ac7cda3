"""Forecasts of tracks against closed forms, and against ends of flights that another program made."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.cli.main import main
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Noise, Rig
from truearc.sim.infer.belief import Belief, point_belief

TRACKS = Path(__file__).parents[3] / "examples" / "tracks"
G, MASS_KG, RADIUS_M, HEIGHT_M = 9.81, 0.14, 0.09, 5.0
RIG = Rig(Ball(MASS_KG, RADIUS_M), LauncherFacts(HEIGHT_M), air=Air(1.2), noise=Noise(track_m=0.002))
Z90 = 1.645


def fallen(t_s: np.ndarray, cd: float) -> np.ndarray:
    """Height of a ball that was let go at rest: the falling body's closed form with drag by v^2."""
    last = np.sqrt(2.0 * MASS_KG * G / (1.2 * cd * np.pi * RADIUS_M**2))
    return np.asarray(HEIGHT_M - last**2 / G * np.log(np.cosh(G * t_s / last)))


def test_the_rest_of_a_fall_with_drag_is_forecast_by_its_closed_form() -> None:
    t_s, rng = np.arange(0.0, 0.99, 0.02), np.random.default_rng(3)
    x_m, y_m, z_m = rng.normal(0.0, 0.002, (3, 3, 50))
    seen = {"shot_id": np.repeat(["a", "b", "c"], 50), "t_s": np.tile(t_s, 3), "x_m": x_m.ravel(), "y_m": y_m.ravel(),
            "z_m": (fallen(t_s, 0.5) + z_m).ravel()}
    drops = ta.dataset({"shot_id": ["a", "b", "c"]}, rig=RIG, tracks=seen)

    def rest(cd: float) -> np.ndarray:
        table = ta.predict(drops, point_belief({"drag": {"cd": cd}}), tracks=0.4, accept=["gravity"])
        return np.array([table.column(one) for one in ("t_s", "z_m", "z_band_m")], float).reshape(3, 3, -1)
    times, height_m, band_m = rest(0.5)
    np.testing.assert_allclose(times, np.broadcast_to(t_s[20:], (3, 30)))
    off = height_m - fallen(times, 0.5)
    assert (np.abs(off) < 2.0 * band_m).all() and (np.abs(off[:, :5]) < 0.01).all()
    assert (np.diff(band_m, axis=1) > 0.0).all()                # the farther ahead, the less is known
    assert (rest(1.5)[1][:, -1] - height_m[:, -1] > 0.2).all()  # more drag: it is still higher then


def test_a_flight_without_air_is_forecast_from_its_settings_with_what_the_instruments_leave_open() -> None:
    speed, up = 8.0, np.radians(50.0)
    shots = {"shot_id": ["a"], "distance_m": [4.0], "exit_speed_m_s": [speed], "exit_deg": [50.0]}
    table = ta.predict(ta.dataset(shots, rig=Rig(RIG.ball, LauncherFacts(0.75), air=RIG.air)),
                       point_belief({}), tracks=0)
    t_s, x_m, y_m, z_m, *band_m = (np.array(table.column(name), float) for name in table.columns[1:])
    np.testing.assert_allclose(x_m, speed * np.cos(up) * t_s, atol=1e-4)
    np.testing.assert_allclose(z_m, 0.75 + speed * np.sin(up) * t_s - 0.5 * G * t_s**2, atol=1e-4)
    assert t_s[0] == 0.0 and np.abs(y_m).max() < 1e-6 and 3.85 < x_m[-1] < 4.0
    by_speed, by_angle, place_m = 0.05, speed * np.radians(0.3), 0.01          # a good camera's, and the wheels' hold
    for found, along, across in ((band_m[0], np.cos(up), np.sin(up)), (band_m[2], np.sin(up), np.cos(up))):
        expected = np.sqrt((along * by_speed * t_s)**2 + (across * by_angle * t_s)**2 + place_m**2)
        np.testing.assert_allclose(found, Z90 * expected, rtol=0.02)


def test_ends_of_flights_that_another_program_made_lie_in_their_bands(tmp_path: Path) -> None:
    belief, out, flights = tmp_path / "belief.toml", tmp_path / "ahead.csv", ta.load_dataset(TRACKS)
    point_belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.1}}).save(belief)
    assert main(["predict", str(TRACKS), "--coefficients", str(belief), "--tracks", "0.4", "-o", str(out)]) == 0
    ends = {row["shot_id"]: row for row in csv.DictReader(out.open())}       # the last row of each
    assert flights.tracks is not None and set(ends) == set(flights.shots.shot_id)
    last = {flights.shots.shot_id[row]: where[-1] for row, where in flights.tracks.by_shot()}
    off, band = (np.array([[read(name, one) for one in "xyz"] for name in ends]) for read in (
        lambda name, one: float(ends[name][f"{one}_m"]) - getattr(flights.tracks, f"{one}_m")[last[name]],
        lambda name, one: float(ends[name][f"{one}_band_m"])))
    assert np.sqrt(np.mean(off[:, 2]**2)) < 0.05
    assert 0.8 <= (np.abs(off) < np.hypot(band, Z90 * 0.005)).mean() <= 1.0  # 5 mm of camera noise


def drops(seed: int, law: Callable[[np.ndarray], np.ndarray]) -> ta.Dataset:
    """Twelve balls that were let go and fell by this law, seen by a camera of 2 mm."""
    names, t_s = [f"{seed}-{k}" for k in range(12)], np.arange(0.0, 0.9, 0.02)
    x_m, y_m, z_m = np.random.default_rng(seed).normal(0.0, 0.002, (3, len(names), len(t_s)))
    return ta.dataset({"shot_id": names}, rig=RIG, tracks={
        "shot_id": np.repeat(names, len(t_s)), "t_s": np.tile(t_s, len(names)), "x_m": x_m.ravel(), "y_m": y_m.ravel(),
        "z_m": (law(t_s) + z_m).ravel()})


def test_bands_include_what_the_model_got_wrong_in_the_flights_it_was_fitted_to() -> None:
    def slowed_by_v(t_s: np.ndarray, rest_s: float = 0.6) -> np.ndarray:       # Stokes: the closed form
        return np.asarray(HEIGHT_M - G * rest_s * (t_s - rest_s * (1.0 - np.exp(-t_s / rest_s))))

    for law, wrong in ((lambda t_s: fallen(t_s, 0.5), False), (slowed_by_v, True)):
        belief = ta.fit(drops(4, law), ["gravity", "drag"], accept=["gravity"]).belief
        later = drops(5, law)
        assert (belief.provenance["forecast_error"] > 1.7) == wrong

        def held(known: Belief, later: ta.Dataset = later, law: Callable[[np.ndarray], np.ndarray] = law) -> float:
            """Of the last places, the share in the band."""
            table = ta.predict(later, known, tracks=0.4, accept=["gravity"])
            t_s, z_m, band_m = (np.array(table.column(one), float).reshape(12, -1)[:, -1]
                                for one in ("t_s", "z_m", "z_band_m"))
            return float((np.abs(z_m - law(t_s)) < band_m).mean())
        assert held(belief) >= 0.75
        assert (held(replace(belief, provenance={})) < 0.5) == wrong


def test_what_cannot_be_forecast_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    where = [str(TRACKS), "--cd", "0.5", "--cl", "0.1"]
    assert main(["predict", *where, "--tracks", "1.5"]) == 2
    assert main(["predict", *where, "--tracks", "0.4", "--gate", "gate.onnx"]) == 2
    assert "--gate: does not apply with --tracks" in capsys.readouterr().err
    with pytest.raises(ta.InputError, match=r"no tracks\.csv"):
        ta.predict(ta.dataset({"shot_id": ["a"]}, rig=RIG), point_belief({}), tracks=0.4)
