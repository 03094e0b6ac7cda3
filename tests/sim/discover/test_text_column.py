"""Balls of two suppliers, one of which leaves the wheels faster: known from the column of whose each ball was."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

import truearc as ta
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots, join_datasets
from truearc.sim.data.files import save_dataset
from truearc.sim.infer.belief import load_belief
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
SHOTS, FASTER = 120, 1.06
SUPPLIER = ("north", "south")         # shot by shot in turn, so that no time goes with them


@pytest.fixture(scope="module")
def two_suppliers() -> Dataset:
    world = make_world(level="L2", shots=SHOTS, seed=5)
    north, south = (shoot(replace(world, efficiency=world.efficiency * times)) for times in (1.0, FASTER))
    both = join_datasets(north.take(range(0, SHOTS, 2)), south.take(range(1, SHOTS, 2)))
    whole = both.take(np.arange(SHOTS).reshape(2, -1).T.ravel().tolist())
    return replace(whole, shots=Shots(whole.shots.shot_id, whole.shots.numbers,
                                      {**whole.shots.texts, "ball_supplier": SUPPLIER * (SHOTS // 2)}))


def test_a_supplier_is_found_said_and_believed(two_suppliers: Dataset, tmp_path: Path) -> None:
    """From files to files."""
    save_dataset(tmp_path / "shots", two_suppliers)
    finding = ta.discover(ta.load_dataset(tmp_path / "shots"), seed=1,
                          terms=few_terms("wheel_slip", "hood_offset", "ball_wear", "wind_x"))
    found = msgspec.json.decode(finding.to_json())
    finding.adopt().save(tmp_path / "adopted.toml")
    assert found["verdict"] == "unknown" and found["unknown"]["covariate"] == "ball_supplier"
    assert found["where"]["stage"] == "launch" and "depending on ball_supplier" in found["sentence"]
    assert found["adoption"]["aimed_after"] > found["adoption"]["aimed_before"] + 0.1     # the supplier is in the aim
    curve = load_belief(tmp_path / "adopted.toml").curves["free_speed"]
    assert curve.covariate == "ball_supplier"
    size = dict(zip(curve.levels, curve.value, strict=True))
    assert size["south"] - size["north"] == pytest.approx(np.log(FASTER), rel=0.15)
