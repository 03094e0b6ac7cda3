"""Networks: rows, splits, loss, weights on disk; many trained at once against plain NumPy and JAX."""

import json
import math
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.training_rows import REAL, SIMULATED, sigmoid, some_rows
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.paper import Recipe
from truearc.sim.paper import network as net
from truearc.sim.paper import train_many as many
from truearc.sim.paper.network import Layers, Rows, cross_entropy, initial_layers, logits, mean_loss


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
def test_the_split_takes_its_share_of_each_class_and_loses_nothing(ones, twos, share, seed):
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
    assert left_out == ["DIR: 1 of 4 shots left out: no outcome", "DIR: 1 of 4 shots left out: no distance_m"]


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
    ({"mean": np.array([{}, 1, 2], object)}, "not a weights file")])
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
    (None, "No such file")])
def test_a_wrong_record_is_named(tmp_path: Path, text: str | None, words: str) -> None:
    net.save_weights(tmp_path, make_network(), RECORD)
    record = tmp_path / "training.json"
    record.unlink() if text is None else record.write_text(text)
    with pytest.raises(InputError) as caught:
        net.load_weights(tmp_path)
    assert words in str(caught.value) and "training.json" in str(caught.value)


BRISK = 0.01                          # a learning rate that gets somewhere within a test


class Order:
    """The minibatches of one network, taken any number at a time."""

    def __init__(self, rng: np.random.Generator, real: int, simulated: int) -> None:
        self.deck = many.make_deck(rng, real, simulated)

    def take(self, steps: int) -> np.ndarray:
        batches = np.full((steps, 20), -1, np.int32)
        for picked in batches:
            many.deal(self.deck, picked)
        return batches


def train_plainly(job: many.Job, learning_rate: float, steps: int) -> Layers:
    """The same updates in a plain loop in float64 by JAX's slopes, Adam as Kingma and Ba's algorithm 1 has it."""
    slope = jax.jit(jax.grad(lambda of, z, labels: weights @ cross_entropy(logits(of, z), labels)))
    mean = job.real.features.mean(axis=0).astype(np.float32).astype(float)
    scale = (1.0 / job.real.features.std(axis=0)).astype(np.float32).astype(float)
    parts = [job.real, *([job.simulated] if job.simulated else [])]
    z = (np.vstack([rows.features for rows in parts]) - mean) * scale
    labels = np.vstack([rows.labels for rows in parts])
    weights = np.repeat([0.1, 0.1 * job.simulated_weight if job.simulated else 0.0], 10)
    rng = np.random.default_rng(job.seed)
    layers = initial_layers(rng)
    first = second = Layers(*(np.zeros_like(part) for part in layers))
    orders = Order(rng, len(job.real.features), len(job.simulated.features) if job.simulated else 0)
    for time, batch in enumerate(orders.take(steps), 1):
        slopes = slope(layers, z[batch], labels[batch])
        first = Layers(*(0.9 * m + 0.1 * g for m, g in zip(first, slopes, strict=True)))
        second = Layers(*(0.999 * v + 0.001 * g * g for v, g in zip(second, slopes, strict=True)))
        layers = Layers(*(part - learning_rate * (m / (1 - 0.9**time)) / (np.sqrt(v / (1 - 0.999**time)) + 1e-8)
                          for part, m, v in zip(layers, first, second, strict=True)))
    return layers


def same(one: many.Trained, other: many.Trained) -> bool:
    return one.step == other.step and all(
        np.array_equal(a, b) for a, b in zip(one.network.layers, other.network.layers, strict=True))


@pytest.mark.parametrize("job", [many.Job(REAL, SIMULATED, None, 0.3, 4), many.Job(REAL, None, None, 0.3, 5)])
def test_the_kernel_makes_the_updates_of_a_plain_loop(job: many.Job) -> None:
    found = many.train_many([job], Recipe(learning_rate=0.02, steps=60))[0]
    for name, layer, wanted in zip(Layers._fields, found.network.layers, train_plainly(job, 0.02, 60), strict=True):
        np.testing.assert_allclose(layer, wanted, rtol=1e-4, atol=2e-5, err_msg=name)
    # the comparison would see one step more or less
    assert np.abs(many.pack(train_plainly(job, 0.02, 61)) - many.pack(found.network.layers)).max() > 1e-3


def test_networks_beside_it_change_no_bit() -> None:
    jobs = [many.Job(some_rows(20 + seed % 7, seed), some_rows(11 * (seed % 5), 50 + seed) if seed % 5 else None,
                some_rows(9, 90 + seed), 0.1 * (seed % 3), seed) for seed in range(12)]
    recipe = Recipe(BRISK, steps=900, patience=200, check=50)
    together = many.train_many(jobs, recipe)
    for number in (0, 3, 10):
        assert same(many.train_many([jobs[number]], recipe)[0], together[number])
    backwards = many.train_many(jobs[::-1], recipe, threads=1)[::-1]
    assert all(map(same, backwards, together))
    assert len({one.curve[-1].step for one in together}) > 3        # they did not all stop together
    assert not same(together[1], together[2])


def test_the_losses_are_those_of_the_network() -> None:
    fresh = some_rows(40, 3)
    one = many.train_many([many.Job(REAL, SIMULATED, fresh)], Recipe(BRISK, steps=300, patience=300, check=100))[0]
    kept = next(point for point in one.curve if point.step == one.step)
    for found, rows in zip(kept[1:], (REAL, SIMULATED, fresh), strict=True):
        assert found == pytest.approx(mean_loss(one.network, rows), rel=1e-5)


def test_the_weights_kept_are_the_best_on_the_validation_rows_and_patience_ends_it() -> None:
    noise = Rows(some_rows(30, 5).features, np.random.default_rng(0).choice([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 30))
    fresh = Rows(some_rows(200, 6).features, np.random.default_rng(1).choice([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 200))
    one = many.train_many([many.Job(noise, None, fresh)], Recipe(BRISK, steps=20000, patience=1500, check=100))[0]
    watched = {point.step: point.validation for point in one.curve}
    assert one.step == min(watched, key=watched.get)
    assert one.curve[-1].step == one.step + 1500 < 20000
    assert one.curve[-1].validation > watched[one.step]              # chance labels: learning them by heart does harm
    assert one.curve[-1].real < one.curve[0].real
    assert one.epoch == round(one.step / 3)


def test_without_validation_it_goes_to_the_end_and_the_last_weights_are_kept() -> None:
    one = many.train_many([many.Job(REAL, SIMULATED)], Recipe(BRISK, steps=730, patience=1, check=100))[0]
    assert one.step == one.curve[-1].step == 730 and math.isnan(one.curve[-1].validation)
    assert [point.step for point in one.curve] == [100, 200, 300, 400, 500, 600, 700, 730]
    long = many.train_many([many.Job(REAL, SIMULATED)], Recipe(BRISK, steps=730))[0]
    assert same(one, long)                                           # looking changes nothing


def test_refuses_to_train_on_nothing_for_no_time_or_into_nonsense() -> None:
    with pytest.raises(InputError, match="no recorded shots"):
        many.train_many([many.Job(some_rows(0, 0), SIMULATED)])
    for job, option in ((many.Job(REAL, seed=-1), "--seed is -1"),
                        (many.Job(REAL, simulated_weight=-0.1), "--lambda is -0.1"),
                        (many.Job(REAL, simulated_weight=math.nan), "--lambda is nan")):
        with pytest.raises(InputError, match=option):
            many.train_many([job])
    for settings, option in (({"steps": 0}, "--steps is 0"), ({"patience": 0}, "--patience is 0"),
                             ({"learning_rate": 0.0}, "--learning-rate is 0.0")):
        with pytest.raises(InputError, match=option):
            Recipe(**settings)
    with pytest.raises(InputError, match=r"diverged within .* \(seed 3\)"):
        many.train_many([many.Job(REAL, SIMULATED, seed=3)], Recipe(learning_rate=1e38, steps=50))


@given(st.integers(1, 60), st.integers(1, 200), st.integers(0, 2**32))
def test_an_epoch_uses_every_simulated_row_and_recorded_rows_evenly(real: int, simulated: int, seed: int) -> None:
    batches = Order(np.random.default_rng(seed), real, simulated).take(many.batches_per_epoch(real, simulated))
    assert batches.shape == (math.ceil(simulated / 10), 20)
    recorded = np.bincount(batches[:, :10].ravel(), minlength=real)
    imagined = np.bincount(batches[:, 10:].ravel() - real, minlength=simulated)
    assert len(recorded) == real and len(imagined) == simulated
    assert recorded.max() - recorded.min() <= 1
    assert imagined.min() >= 1 and imagined.sum() - simulated < 10
