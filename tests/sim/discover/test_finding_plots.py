"""Residuals and pictures: closed forms, what is chosen to be shown, and that something is drawn."""

import io

import matplotlib.image
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import norm

from tests.sim.discover.made import make_linear, term
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.report import pictures as pic
from truearc.sim.infer.likelihood.noise import LAPSE
from truearc.sim.infer.likelihood.observations import see_outcomes
from truearc.sim.infer.likelihood.score_table import Column, PlaneScores

ROWS = np.arange(80)
ORDER = Covariate((("t_s", np.linspace(0.0, 100.0, 80)), ("order_in_session", ROWS.astype(float))))
OTHER = Covariate((("battery_v", np.random.default_rng(9).normal(12.0, 0.3, 80)),))
SIDE = Factor("supplier", ("north", "south"), ROWS % 2)
BLUE, ORANGE = np.array([[0x1f, 0x5f, 0xa8], [0xc2, 0x57, 0x1a]]) / 255.0


def drifting() -> pic.Residual:
    """Two per cent up and down over t_s before, nothing after; every shot's own error is one per cent."""
    truth = np.linspace(-0.02, 0.02, 80)
    noise = 0.01 * np.random.default_rng(1).normal(size=80)
    information = np.full(80, 1e4)
    return pic.Residual("launch speed", 0, "launch", 100.0, "%",
                        pic.LinearResiduals((truth + noise) * information, information),
                        pic.LinearResiduals(noise * information, information))


def drawn(png: bytes | None) -> np.ndarray:
    assert png is not None
    return matplotlib.image.imread(io.BytesIO(png))[..., :3]


def share_like(image: np.ndarray, colour: np.ndarray) -> float:
    return float((np.abs(image - colour).max(axis=2) < 0.12).mean())


def test_a_bin_holds_the_weighted_mean_with_its_error() -> None:
    score, information = np.array([2.0, 4.0, 9.0, 8.0]), np.array([1.0, 2.0, 3.0, 4.0])
    value, error = pic.LinearResiduals(score, information).estimate(np.ones(4, dtype=bool))
    assert value == pytest.approx(np.average(score / information, weights=information))
    assert error >= 1.0 / np.sqrt(10.0)
    assert np.isnan(pic.LinearResiduals(score, information).estimate(np.arange(4) < 2)[0])


def test_heights_shift_to_where_the_outcomes_are_likeliest() -> None:
    rng = np.random.default_rng(2)
    mean_m, spread_m = rng.normal(0.0, 0.2, 200), np.full(200, 0.1)
    height = mean_m + 0.06 + spread_m * rng.normal(size=200)
    outcome = np.where(np.abs(height) <= 0.07, "three", np.where(np.abs(height) <= 0.35, "two", "miss"))
    side = np.where(outcome == "three", "", np.where(height < 0.0, "low", "high"))
    shots = Shots(tuple(map(str, range(200))), {}, {"outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())})
    rows, seen = see_outcomes(shots, Target(2.44))
    none = np.zeros((200, 0))
    value, error = pic.Heights(PlaneScores(rows, seen, mean_m, spread_m, none, none, none), 200).estimate(
        np.ones(200, bool)
    )
    borders = {"three": (-0.07, 0.07), "low two": (-0.35, -0.07), "high two": (0.07, 0.35), "low miss": (-9.0, -0.35),
               "high miss": (0.35, 9.0)}
    low, high = np.array([borders[f"{s} {o}".strip()] for s, o in zip(side, outcome, strict=True)]).T

    def unlikely(shift: float) -> float:
        chance = norm.cdf(high, mean_m + shift, spread_m) - norm.cdf(low, mean_m + shift, spread_m)
        return float(-np.log((1.0 - LAPSE) * chance + LAPSE / 3.0).sum())

    best = minimize_scalar(unlikely, bounds=(-0.2, 0.3), method="bounded").x
    assert value == pytest.approx(best, abs=0.004)
    assert unlikely(best + error) - unlikely(best) == pytest.approx(0.5, abs=0.2)
    assert value == pytest.approx(0.06, abs=3.0 * error)


def test_bins_are_even_or_the_values_there_are() -> None:
    even = pic.bins_of(ORDER, ROWS)
    assert np.bincount(even.index).tolist() == [10] * 8
    assert (np.diff(even.middle) > 0.0).all()
    assert pic.bins_of(SIDE, ROWS).labels == ("north", "south")
    few = pic.bins_of(Covariate((("hood_change", np.where(ROWS % 3, 1.0, -1.0)),)), ROWS)
    assert few.middle.tolist() == [-1.0, 1.0] and (few.middle[few.index] == np.where(ROWS % 3, 1.0, -1.0)).all()
    gaps = Covariate((("x", np.where(ROWS < 10, np.nan, ROWS.astype(float))),))
    assert (pic.bins_of(gaps, ROWS).index[:10] == -1).all()


def test_what_carries_the_effect_is_what_is_shown() -> None:
    flat = pic.Residual("push", 1, "flight", 1.0, "m/s²", pic.LinearResiduals(np.zeros(80), np.ones(80)),
                        pic.LinearResiduals(np.zeros(80), np.ones(80)))
    chosen = pic.choose((flat, drifting()), (OTHER, SIDE, ORDER), ROWS)
    assert chosen is not None
    assert (chosen[0].name, chosen[1].name) == ("launch speed", "t_s")
    assert pic.choose((drifting(),), (), ROWS) is None
    assert pic.find_along("order_in_session", (OTHER, ORDER)) is ORDER
    assert pic.find_along("nothing", (OTHER, ORDER)) is None


def test_the_field_is_coloured_where_shots_are_off() -> None:
    across, up = np.tile(np.arange(10.0), 8), np.repeat(np.arange(8.0), 10)
    off = np.where(across > 5.0, 0.1, 0.0)
    information = np.full(80, 1e4)
    seen = pic.LinearResiduals(off * information, information)
    residual = pic.Residual("height", None, "arrival", 100.0, "cm", seen, None)
    image = drawn(pic.field_png(residual, ("distance [m]", across), ("elevation", up), ""))
    red = (image[..., 0] > 0.3) & (image[..., 2] < 0.2)
    assert red.mean() > 0.1
    width = image.shape[1]
    assert red[:, :width // 3].sum() < 0.05 * red[:, width // 3:].sum()
    assert pic.field_png(residual, ("distance [m]", np.full(80, 3.0)), ("elevation", up), "") is None


def test_bands_along_the_flight_show_what_was_pushed() -> None:
    spans = [(0.0, 0.2), (0.2, 0.4), (0.4, float("inf"))]
    bands = tuple(Column(f"push vertical from {a}", "free", "flight", "vertical", "m/s2", 1.5, times_s=(a, b))
                  for a, b in spans)
    observed = np.tile([0.0, 0.0, 5.0], (40, 1)) + np.random.default_rng(3).normal(size=(40, 3))
    evidence = make_linear(np.tile(np.eye(3), (40, 1, 1)), bands, np.zeros(0), observed)
    image = drawn(pic.flight_png(evidence, None, "", [("", np.ones(40, dtype=bool))]))
    rows = np.flatnonzero((np.abs(image - BLUE).max(axis=2) < 0.12).any(axis=1))
    assert rows[-1] - rows[0] > 0.4 * image.shape[0]
    two = drawn(pic.flight_png(evidence, evidence, "wind", pic.halves(ORDER, ROWS[:40])))
    panels = two[:, :two.shape[1] // 2], two[:, two.shape[1] // 2:]
    assert all(share_like(panel, colour) > 1e-4 for panel in panels for colour in (BLUE, ORANGE))
    assert share_like(image, ORANGE) == 0.0
    assert pic.flight_png(make_linear(np.ones((4, 1, 1)), (term("a"),), np.zeros(0)), None, "", []) is None
