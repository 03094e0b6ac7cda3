"""Filmed flights on the camera's picture: where they were, by outcome, beside those of each belief."""

from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

import truearc as ta
from truearc.errors import InputError
from truearc.sim.data.dataset import Film
from truearc.sim.discover.report.flights import ON_DARK, draw_film
from truearc.sim.infer.belief import Belief
from truearc.sim.physics.catalogue import BUILT_IN

TO_PIXEL = ((50.0, 0.0), (0.0, -40.0), (10.0, 190.0))
TIMES_S = np.arange(0.0, 0.8, 0.02)
# without air, from the exit at 0.75 m, at 6 m/s and 45 degrees
X_M, Z_M = 4.243 * TIMES_S, 0.75 + 4.243 * TIMES_S - 4.905 * TIMES_S ** 2


def filmed() -> ta.Dataset:
    shots = {"shot_id": ["a", "b"], "distance_m": [3.0, 3.0], "exit_speed_m_s": [6.0, 6.0], "exit_deg": [45.0, 45.0],
             "outcome": ["three", "miss"]}
    tracks = {"shot_id": ["a"] * len(TIMES_S) + ["b"] * len(TIMES_S), "t_s": [*TIMES_S, *TIMES_S], "x_m": [*X_M, *X_M],
              "y_m": [0.0] * (2 * len(TIMES_S)), "z_m": [*Z_M, *(Z_M + 0.1)]}
    return ta.dataset(shots, tracks=tracks, rig={
        "ball": {"mass_kg": 0.14, "radius_m": 0.089}, "launcher": {"release_height_m": 0.75},
        "target": {"centre_height_m": 2.0, "three_half_height_m": 0.1, "two_half_height_m": 0.4}})


def falling(**coefficients: dict[str, float]) -> Belief:
    return Belief({"gravity": {}, **coefficients}, {}, (), np.zeros((0, 0)), catalogue=BUILT_IN)


def test_flights_are_drawn_where_they_were_filmed(tmp_path):
    done, data = cv2.imencode(".jpg", np.full((200, 240), 90, np.uint8))
    assert done and draw_film(filmed(), [falling()]) is None
    ta.save_dataset(tmp_path / "d", filmed())
    (tmp_path / "d" / "film.json").write_bytes(msgspec.json.encode(Film(data.tobytes(), dict.fromkeys("ab", TO_PIXEL))))
    of_no_shot = replace(filmed(), film=Film(data.tobytes(), {}))
    assert draw_film(of_no_shot, [falling()]) is None
    figure = draw_film(ta.load_dataset(tmp_path / "d"), [falling(), falling(drag={"cd": 0.5})])
    before, after = figure.axes
    real, missed, one, _ = before.lines
    assert (real.get_color(), missed.get_color()) == (ON_DARK["three"], ON_DARK["miss"])
    assert np.allclose(real.get_xydata(), np.column_stack([10.0 + 50.0 * X_M, 190.0 - 40.0 * Z_M]))
    # the simulation without air is the filmed flight; drag makes it shorter
    height_px = np.interp(110.0, *one.get_xydata().T)
    assert height_px == pytest.approx(np.interp(110.0, *real.get_xydata().T), abs=0.3)
    assert np.interp(110.0, *after.lines[2].get_xydata().T) > height_px + 1.0
    (tmp_path / "d" / "film.json").write_text('{"picture": 3}')
    with pytest.raises(InputError, match=r"film\.json"):
        ta.load_dataset(tmp_path / "d")
