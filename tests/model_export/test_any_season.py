"""Whatever a team has recorded, its gate can be exported: random plausible launchers, and beliefs as fits give them."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from tests.sim.gate.plausible import make_season
from truearc.model_export.graph import export_weights
from truearc.robot.gate import FEATURES, Ratings, load_gate
from truearc.sim.gate import train
from truearc.sim.gate.model import save_physics_gate
from truearc.sim.gate.train import train_physics_gate
from truearc.sim.infer.belief import Belief
from truearc.sim.paper.network import domain_of

SEASONS, ALWAYS = 50, 1
more = pytest.mark.skipif("TRUEARC_SEASONS" not in os.environ, reason="minutes; TRUEARC_SEASONS=1 runs all 50 seasons")


def make_belief(seed: int) -> Belief:
    """Drag that stands for slip as well, as fits to outcomes alone give it: half to eight times a ball's."""
    rng = np.random.default_rng([seed, 17])
    return Belief({"gravity": {"g_m_s2": 9.81}, "drag": {"cd": float(np.exp(rng.uniform(np.log(0.25), np.log(4.0))))},
                   "magnus": {"cl": float(rng.uniform(0.0, 0.2))}},
                  {"speed": float(rng.uniform(0.01, 0.05)), "elevation_deg": float(rng.uniform(0.2, 0.6))}, (),
                  np.zeros((0, 0)))


def export(seed: int, belief: Belief, folder: Path) -> tuple[Ratings, int]:
    """Ratings of a season's shots by their gate, made as the commands do, and how many lie outside its box."""
    season = make_season(seed)
    gate, _ = train_physics_gate(season.rig, belief, season.shots)
    features = np.stack([season.shots.number(one.name) for one in FEATURES], axis=1)
    save_physics_gate(folder / "weights", gate, {"domain": domain_of(features), "version": "0", "seed": 0,
                                                 "recorded": {f"s{k}": row for k, row in enumerate(features.tolist())}})
    export_weights(folder / "weights", folder / "gate.onnx")
    exported = load_gate(folder / "gate.onnx")
    box = np.array(exported.domain)
    return exported.rate_many(features), int(((features < box[:, 0]) | (features > box[:, 1])).any(axis=1).sum())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[] if seed < ALWAYS else more) for seed in range(SEASONS)])
def test_any_season_can_be_exported(seed: int, tmp_path: Path) -> None:
    rated, _ = export(seed, make_belief(seed), tmp_path)
    assert np.isfinite(rated.p).all() and rated.in_domain.mean() > 0.3


@pytest.mark.slow
def test_a_domain_that_is_narrowed_is_said_with_the_settings_outside(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Season 2 fitted by drag alone: 3, six times a ball's, for which some of its shots stall. Higher degrees, which
    cost ten times as much, might follow even that."""
    monkeypatch.setattr(train, "DEGREES", train.DEGREES[:1])
    crooked = Belief({"gravity": {"g_m_s2": 9.81}, "drag": {"cd": 3.0}, "magnus": {"cl": 0.1}},
                     {"speed": 0.095, "elevation_deg": 0.41}, (), np.zeros((0, 0)))
    rated, outside = export(2, crooked, tmp_path)
    said = capsys.readouterr().err
    assert "the domain is narrowed to distance_m" in said and "the robot holds there" in said
    counted = re.search(r"(\d+) of \d+ recorded shots lie outside: s\d+ \(.* m, motor ratio .*; s\d+ \(", said)
    assert counted and 0 < outside < 30 and int(counted[1]) == outside
    assert np.isfinite(rated.p).all() and not rated.in_domain.all()
