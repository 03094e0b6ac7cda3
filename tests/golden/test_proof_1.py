"""Files of tag proof-1 whose golden references were written again since: they load, with unchanged results."""

import csv
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from tests.golden.artefacts import unpack
from truearc.robot.gate import FEATURES, load_gate
from truearc.sim.discover.finding import load_record, make_json

OLD = Path(__file__).with_name("proof_1")


@pytest.mark.parametrize("path", sorted(OLD.glob("*.json")), ids=lambda path: path.stem)
def test_findings_are_written_again_to_the_byte_but_for_the_formula(path: Path) -> None:
    """proof-1 looked for a formula of an unexplained effect, and found none in these."""
    assert make_json(load_record(path)) == re.sub(rb',\n\s*"formula": null', b"", path.read_bytes())


@pytest.mark.parametrize("path", sorted(OLD.glob("*.toml")), ids=lambda path: path.stem)
def test_beliefs_hold_the_numbers_of_their_files(path: Path) -> None:
    with path.open("rb") as file:
        table = tomllib.load(file)
    belief = ta.load_belief(path)
    assert {name: dict(values) for name, values in belief.coefficients.items()} == {
        name: values for name, values in table.items() if name not in ("schema", "scatter", "covariance", "provenance")}
    assert belief.scatter == table.get("scatter", {})
    if "covariance" in table:
        assert list(belief.names) == table["covariance"]["names"]
        np.testing.assert_array_equal(belief.covariance, table["covariance"]["matrix"])


def test_the_gate_rates_as_it_did(tmp_path: Path) -> None:
    unpack(tmp_path)
    shots = ta.load_dataset(next(tmp_path.rglob("l0-null"))).shots
    rated = load_gate(str(OLD / "gate.onnx")).rate_many(np.stack([shots.number(one.name) for one in FEATURES], axis=1))
    with (OLD / "rows.csv").open(encoding="utf-8") as file:
        rows = {row["shot_id"]: row for row in csv.DictReader(file)}
    wanted = np.array([[float(rows[name]["p_two"]), float(rows[name]["p_three"])] for name in shots.shot_id])
    np.testing.assert_allclose(rated.p, wanted, atol=2e-6)
