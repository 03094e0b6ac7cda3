"""Networks: rows, splits, loss, accuracy, domain; weights on disk come back exactly, damaged ones are refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.training_rows import REAL, sigmoid
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.paper import network as net


def test_cross_entropy_is_minus_log_likelihood_of_both_outputs() -> None:
    found = np.asarray(net.cross_entropy(np.array([[0.0, 2.0], [-1.0, 3.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])))
    wanted = [-math.log(0.5) - math.log(1 - 1 / (1 + math.exp(-2.0))),
              -math.log(1 / (1 + math.exp(1.0))) - math.log(1 / (1 + math.exp(-3.0)))]
    assert found == pytest.approx(wanted, rel=1e-12)
    # a network that is sure and wrong costs much, not infinity
    sure = float(net.cross_entropy(np.array([800.0, 0.0]), np.array([0.0, 0.0])))
    assert sure == pytest.approx(800.0 + math.log(2.0))


def test_mean_loss_by_hand() -> None:
    layers = net.initial_layers(np.random.default_rng(3))
    network = net.Network(np.array([5.0, 0.5, 45.0]), np.array([0.5, 4.0, 0.1]), layers)
    p = sigmoid(sigmoid((REAL.features - network.mean) * network.scale @ layers.hidden_w) @ layers.out_w)
    wanted = -(REAL.labels * np.log(p) + (1 - REAL.labels) * np.log(1 - p)).sum(axis=1).mean()
    assert net.mean_loss(network, REAL) == pytest.approx(wanted, rel=1e-12)
    np.testing.assert_allclose(net.probabilities(network, REAL.features), p, rtol=1e-12)


@given(st.integers(0, 40), st.integers(0, 40), st.floats(0.0, 0.99), st.integers(0, 2**32))
def test_the_split_takes_its_share_of_each_class_and_loses_nothing(ones: int, twos: int, share: float,
                                                                   seed: int) -> None:
    labels = np.array([[1.0, 0.0]] * ones + [[1.0, 1.0]] * twos).reshape(-1, 2)
    features = np.arange(3.0 * len(labels)).reshape(-1, 3)
    kept, out = net.split_heldout(net.Rows(features, labels), share, seed)
    assert sorted([*kept.features[:, 0], *out.features[:, 0]]) == features[:, 0].tolist()
    assert out.labels[:, 1].sum() == round(share * twos)
    assert (out.labels[:, 1] == 0).sum() == round(share * ones)
    again, _ = net.split_heldout(net.Rows(features, labels), share, seed)
    assert np.array_equal(kept.features, again.features)


def test_holdout_must_be_a_share() -> None:
    for share in (-0.1, 1.0, float("nan")):
        with pytest.raises(InputError, match="--holdout"):
            net.split_heldout(REAL, share, 0)
        with pytest.raises(InputError, match="--validation"):
            net.split_heldout(REAL, share, 0, "--validation")


def test_accuracy_counts_outcome_two_and_three() -> None:
    # p_two = sigmoid(distance - 5), p_three = sigmoid(distance - 7), before the hidden layer's squeeze
    flat = net.Layers(np.zeros((3, 8)), np.zeros(8), np.zeros((8, 2)), np.array([0.0, -1.0]))
    flat.hidden_w[0, 0] = 1.0
    flat.out_w[0] = 4.0, 0.0
    flat.out_b[0] = -2.0
    network = net.Network(np.zeros(3), np.ones(3), flat)                    # p_two >= 0.5 exactly where distance >= 0
    rows = net.Rows(np.array([[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]]),
                np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]))
    assert net.accuracy(network, rows) == {"shots": 4, "outcome": 0.5, "two": 0.75, "three": 0.75}
    assert net.accuracy(network, net.Rows(rows.features[:0], rows.labels[:0]))["outcome"] is None


def test_the_domain_is_the_recorded_box_a_tenth_wider_within_the_contract() -> None:
    features = np.array([[2.0, 0.5, 30.0], [12.0, 1.0, 80.0], [5.0, 0.7, 40.0]])
    domain = net.domain_of(features)
    assert domain["distance_m"] == pytest.approx([1.5, 12.5])
    assert domain["motor_ratio"] == pytest.approx([0.475, 1.0])         # no motor is faster than its free speed
    assert domain["hood_deg"] == pytest.approx([27.5, 82.5])


def test_rows_leave_out_what_they_cannot_use_and_say_so() -> None:
    shots = Shots(("a", "b", "c", "d"),
                  {"distance_m": np.array([1.0, 2.0, np.nan, 4.0]), "hood_deg": np.array([10.0, 20.0, 30.0, 40.0]),
                   "motor_ratio": np.array([0.1, 0.2, 0.3, 0.4])}, {"outcome": ("three", "", "two", "two")})
    rows, left_out = net.training_rows(shots, "DIR")
    assert rows.features.tolist() == [[1.0, 0.1, 10.0], [4.0, 0.4, 40.0]]
    assert rows.labels.tolist() == [[1.0, 1.0], [1.0, 0.0]]
    assert left_out == ["DIR: 1 of 4 shots left out: no outcome",
                        "DIR: 1 of 4 shots left out: no distance_m"]


RECORD = {"seed": 7, "domain": {"distance_m": [1.0, 5.0], "motor_ratio": [0.2, 0.8], "hood_deg": [20.0, 60.0]}}


def make_network(seed: int = 0) -> net.Network:
    rng = np.random.default_rng(seed)
    return net.Network(rng.normal(size=3), rng.uniform(0.1, 9.0, 3), net.initial_layers(rng))


def test_round_trip_is_exact_and_the_bytes_repeat(tmp_path: Path) -> None:
    network = make_network()
    for name in ("a", "b"):
        net.save_weights(tmp_path / name, network, RECORD)
    back, record = net.load_weights(tmp_path / "a")
    for found, wanted in zip((back.mean, back.scale, *back.layers), (network.mean, network.scale, *network.layers),
                             strict=True):
        assert np.array_equal(found, wanted)
    assert record["seed"] == 7
    for file in ("weights.npz", "training.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert net.weights_hash(tmp_path / "a") == net.weights_hash(tmp_path / "b")
    net.save_weights(tmp_path / "b", make_network(1), RECORD)
    assert net.weights_hash(tmp_path / "a") != net.weights_hash(tmp_path / "b")


@given(st.integers(0, 100))
def test_standardised_features_have_mean_zero_and_deviation_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal([5.0, 0.5, 45.0], [2.0, 0.1, 10.0], (40, 3))
    mean, scale = net.standardisation(features)
    z = (features - mean) * scale
    assert np.abs(z.mean(axis=0)).max() < 1e-5
    assert np.abs(z.std(axis=0) - 1.0).max() < 1e-6
    assert np.array_equal(mean, mean.astype(np.float32)) and np.array_equal(scale, scale.astype(np.float32))


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights")
    net.save_weights(path, make_network(), RECORD)
    return path


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
        net.load_weights(tmp_path)
    assert words in str(caught.value) and "weights.npz" in str(caught.value)


def test_weights_that_unpack_to_more_than_a_limit_are_refused(archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(net, "MAX_BYTES", 100)
    with pytest.raises(InputError, match=r"weights\.npz: not a weights file \(unpacks to \d+ bytes"):
        net.load_weights(archive)


@pytest.mark.parametrize(("text", "words"), [
    ("{", "not JSON"), ("[]", "not a JSON object"), ('{"schema": "other/1"}', "'schema'"),
    (json.dumps({"schema": "truearc.training/1"}), "'domain'"),
    (json.dumps({"schema": "truearc.training/1", "domain": {"hood_deg": [1, 2]}}), "'domain'"),
    (None, "No such file"),
])
def test_a_wrong_record_is_named(tmp_path: Path, text: str | None, words: str) -> None:
    net.save_weights(tmp_path, make_network(), RECORD)
    record = tmp_path / "training.json"
    record.unlink() if text is None else record.write_text(text)
    with pytest.raises(InputError) as caught:
        net.load_weights(tmp_path)
    assert words in str(caught.value) and "training.json" in str(caught.value)
