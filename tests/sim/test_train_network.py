"""Weights on disk: they come back exactly, and files that are not weights are refused with a message."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc.sim.paper import network
from truearc.sim.paper.network import (
    Network,
    initial_layers,
    load_weights,
    probabilities,
    save_weights,
    standardisation,
    weights_hash,
)

RECORD = {"seed": 7, "domain": {"distance_m": [1.0, 5.0], "motor_ratio": [0.2, 0.8], "hood_deg": [20.0, 60.0]}}


def make_network(seed: int = 0) -> Network:
    rng = np.random.default_rng(seed)
    return Network(rng.normal(size=3), rng.uniform(0.1, 9.0, 3), initial_layers(rng))


def test_round_trip_is_exact_and_the_bytes_repeat(tmp_path: Path) -> None:
    network = make_network()
    for name in ("a", "b"):
        save_weights(tmp_path / name, network, RECORD)
    back, record = load_weights(tmp_path / "a")
    for found, wanted in zip((back.mean, back.scale, *back.layers), (network.mean, network.scale, *network.layers),
                             strict=True):
        assert np.array_equal(found, wanted)
    assert record["seed"] == 7
    for file in ("weights.npz", "training.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert weights_hash(tmp_path / "a") == weights_hash(tmp_path / "b")
    save_weights(tmp_path / "b", make_network(1), RECORD)
    assert weights_hash(tmp_path / "a") != weights_hash(tmp_path / "b")


@given(st.integers(0, 100))
def test_standardised_features_have_mean_zero_and_deviation_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal([5.0, 0.5, 45.0], [2.0, 0.1, 10.0], (40, 3))
    mean, scale = standardisation(features)
    z = (features - mean) * scale
    assert np.abs(z.mean(axis=0)).max() < 1e-5
    assert np.abs(z.std(axis=0) - 1.0).max() < 1e-6
    assert np.array_equal(mean, mean.astype(np.float32)) and np.array_equal(scale, scale.astype(np.float32))


def test_a_feature_that_never_varies_is_left_alone() -> None:
    mean, scale = standardisation(np.array([[3.0, 0.5, 45.0], [4.0, 0.5, 50.0]]))
    assert mean[1] == 0.5 and scale[1] == 1.0


def test_initial_weights_have_glorot_spread() -> None:
    layers = [initial_layers(np.random.default_rng(seed)) for seed in range(400)]
    hidden, out = (np.array([getattr(one, name) for one in layers]) for name in ("hidden_w", "out_w"))
    assert hidden.std() == pytest.approx(np.sqrt(2.0 / (3 + 8)), rel=0.03)
    assert out.std() == pytest.approx(np.sqrt(2.0 / (8 + 2)), rel=0.03)
    assert not layers[0].hidden_b.any() and not layers[0].out_b.any()


def test_the_forward_pass_is_in_double_precision() -> None:
    network = make_network()
    features = np.random.default_rng(2).normal(size=(50, 3))
    hidden = 1 / (1 + np.exp(-((features - network.mean) * network.scale @ network.layers.hidden_w)))
    wanted = 1 / (1 + np.exp(-(hidden @ network.layers.out_w)))
    np.testing.assert_allclose(probabilities(network, features), wanted, rtol=1e-13)


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights")
    save_weights(path, make_network(), RECORD)
    return path


@given(st.data())
def test_a_cut_archive_is_refused(archive: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    whole = (archive / "weights.npz").read_bytes()
    other = tmp_path_factory.getbasetemp() / "cut"
    other.mkdir(exist_ok=True)
    (other / "weights.npz").write_bytes(whole[:data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(InputError, match=r"weights\.npz"):
        load_weights(other)


@pytest.mark.parametrize(("change", "words"), [
    ({"hidden_w": None}, "'hidden_w' is missing"),
    ({"hidden_w": np.zeros((3, 9))}, "not (3, 8)"),
    ({"out_b": np.array([0.0, np.nan])}, "'out_b' holds a number that is not finite"),
    ({"mean": np.array(["a", "b", "c"])}, "not a weights file"),
    ({"mean": np.array([{}, 1, 2], object)}, "not a weights file"),
])
def test_wrong_arrays_are_named(archive: Path, tmp_path: Path, change: dict[str, np.ndarray], words: str) -> None:
    with np.load(archive / "weights.npz") as file:
        arrays = {**file, **change}
    np.savez(tmp_path / "weights.npz", **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(InputError) as caught:
        load_weights(tmp_path)
    assert words in str(caught.value) and "weights.npz" in str(caught.value)


def test_weights_that_unpack_to_more_than_a_limit_are_refused(archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "MAX_BYTES", 100)
    with pytest.raises(InputError, match=r"weights\.npz: not a weights file \(unpacks to \d+ bytes"):
        load_weights(archive)


@pytest.mark.parametrize(("text", "words"), [
    ("{", "not JSON"), ("[]", "not a JSON object"), ('{"schema": "other/1"}', "'schema'"),
    (json.dumps({"schema": "truearc.training/1"}), "'domain'"),
    (json.dumps({"schema": "truearc.training/1", "domain": {"hood_deg": [1, 2]}}), "'domain'"),
    (None, "No such file"),
])
def test_a_wrong_record_is_named(tmp_path: Path, text: str | None, words: str) -> None:
    save_weights(tmp_path, make_network(), RECORD)
    record = tmp_path / "training.json"
    record.unlink() if text is None else record.write_text(text)
    with pytest.raises(InputError) as caught:
        load_weights(tmp_path)
    assert words in str(caught.value) and "training.json" in str(caught.value)


def test_weights_cannot_be_written_into_a_file(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="taken"):
        save_weights(tmp_path / "taken", make_network(), RECORD)
