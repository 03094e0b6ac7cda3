"""Training against plain NumPy: the loss by hand, the gradient by hand, Adam by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.config import BadInput
from sim.network import Layers, Network, initial_layers, probabilities
from sim.shots import Shots
from sim.train import (
    Recipe,
    Rows,
    accuracy,
    cross_entropy,
    domain_of,
    epoch_batches,
    mean_loss,
    split_heldout,
    train,
    training_rows,
)


def some_rows(count: int, seed: int) -> Rows:
    """Shots whose outcome depends on distance and speed alone."""
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.uniform(2, 9, count), rng.uniform(0.3, 0.9, count), rng.uniform(20, 70, count)])
    reach = 12.0 * features[:, 1] - features[:, 0]
    return Rows(features, np.column_stack([reach > 1.0, reach > 3.0]).astype(float))


REAL, SIMULATED = some_rows(23, 1), some_rows(47, 2)


def sigmoid(z: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-z))


def gradient(layers: Layers, z: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> Layers:
    """Back-propagation written out: sum over rows of weight x summed binary cross-entropy."""
    hidden = sigmoid(z @ layers.hidden_w + layers.hidden_b)
    out = (sigmoid(hidden @ layers.out_w + layers.out_b) - labels) * weights[:, None]
    back = out @ layers.out_w.T * hidden * (1.0 - hidden)
    return Layers(z.T @ back, back.sum(axis=0), hidden.T @ out, out.sum(axis=0))


def train_plainly(real: Rows, simulated: Rows, recipe: Recipe) -> Layers:
    """The same updates in a plain loop, Adam as Kingma and Ba's algorithm 1 has it."""
    mean = real.features.mean(axis=0).astype(np.float32).astype(float)
    scale = (1.0 / real.features.std(axis=0)).astype(np.float32).astype(float)
    z = (np.vstack([real.features, simulated.features]) - mean) * scale
    labels = np.vstack([real.labels, simulated.labels])
    weights = np.repeat([0.1, 0.1 * recipe.simulated_weight], 10)
    rng = np.random.default_rng(recipe.seed)
    layers = initial_layers(rng)
    first = second = Layers(*(np.zeros_like(part) for part in layers))
    time = 0
    for _ in range(recipe.epochs):
        for batch in epoch_batches(rng, len(real.features), len(simulated.features)):
            time += 1
            slopes = gradient(layers, z[batch], labels[batch], weights)
            first = Layers(*(0.9 * m + 0.1 * g for m, g in zip(first, slopes, strict=True)))
            second = Layers(*(0.999 * v + 0.001 * g * g for v, g in zip(second, slopes, strict=True)))
            layers = Layers(*(
                part - recipe.learning_rate * (m / (1 - 0.9**time)) / (np.sqrt(v / (1 - 0.999**time)) + 1e-8)
                for part, m, v in zip(layers, first, second, strict=True)))
    return layers


def test_scan_makes_the_updates_of_a_plain_loop() -> None:
    recipe = Recipe(simulated_weight=0.3, learning_rate=0.02, epochs=7, seed=4)
    network, curve = train(REAL, SIMULATED, recipe)
    for name, found, wanted in zip(Layers._fields, network.layers, train_plainly(REAL, SIMULATED, recipe), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12, err_msg=name)
    assert [point.epoch for point in curve] == [1, 2, 3, 4, 5, 6, 7]


def test_gradient_of_the_reference_is_that_of_finite_differences() -> None:
    layers = initial_layers(np.random.default_rng(0))
    z, labels, weights = REAL.features / 10.0, REAL.labels, np.linspace(0.1, 1.0, 23)

    def loss(hidden_w: np.ndarray) -> float:
        p = sigmoid(sigmoid(z @ hidden_w + layers.hidden_b) @ layers.out_w + layers.out_b)
        return float(weights @ -(labels * np.log(p) + (1 - labels) * np.log(1 - p)).sum(axis=1))

    found = gradient(layers, z, labels, weights).hidden_w
    for place in np.ndindex(3, 8):
        nudge = np.zeros((3, 8))
        nudge[place] = 1e-6
        assert found[place] == pytest.approx((loss(layers.hidden_w + nudge) - loss(layers.hidden_w - nudge)) / 2e-6,
                                             abs=1e-7)


def test_cross_entropy_is_minus_log_likelihood_of_both_outputs() -> None:
    found = np.asarray(cross_entropy(np.array([[0.0, 2.0], [-1.0, 3.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])))
    wanted = [-math.log(0.5) - math.log(1 - 1 / (1 + math.exp(-2.0))),
              -math.log(1 / (1 + math.exp(1.0))) - math.log(1 / (1 + math.exp(-3.0)))]
    assert found == pytest.approx(wanted, rel=1e-12)
    # a network that is sure and wrong costs much, not infinity
    assert float(cross_entropy(np.array([800.0, 0.0]), np.array([0.0, 0.0]))) == pytest.approx(800.0 + math.log(2.0))


def test_mean_loss_by_hand() -> None:
    layers = initial_layers(np.random.default_rng(3))
    network = Network(np.array([5.0, 0.5, 45.0]), np.array([0.5, 4.0, 0.1]), layers)
    p = sigmoid(sigmoid((REAL.features - network.mean) * network.scale @ layers.hidden_w) @ layers.out_w)
    wanted = -(REAL.labels * np.log(p) + (1 - REAL.labels) * np.log(1 - p)).sum(axis=1).mean()
    assert mean_loss(network, REAL) == pytest.approx(wanted, rel=1e-12)
    np.testing.assert_allclose(probabilities(network, REAL.features), p, rtol=1e-12)


def test_learns_what_can_be_learnt_and_the_same_twice() -> None:
    recipe = Recipe(learning_rate=0.01, epochs=400, seed=1)
    real, fresh = some_rows(200, 5), some_rows(1000, 6)
    network, curve = train(real, SIMULATED, recipe, fresh)
    assert accuracy(network, fresh)["outcome"] > 0.93
    assert curve[-1].real < 0.25 * curve[0].real
    assert curve[-1].heldout < 0.35 * curve[0].heldout
    again, _ = train(real, SIMULATED, recipe, fresh)
    assert all(np.array_equal(a, b) for a, b in zip(network.layers, again.layers, strict=True))
    other, _ = train(real, SIMULATED, Recipe(learning_rate=0.01, epochs=400, seed=2), fresh)
    assert not np.array_equal(network.layers.hidden_w, other.layers.hidden_w)


def test_held_out_shots_do_not_change_what_is_learnt() -> None:
    recipe = Recipe(epochs=5)
    with_, _ = train(REAL, SIMULATED, recipe, some_rows(50, 9))
    without, _ = train(REAL, SIMULATED, recipe)
    assert np.array_equal(with_.layers.hidden_w, without.layers.hidden_w)


def test_lambda_zero_makes_simulated_labels_irrelevant_and_more_does_not() -> None:
    upside_down = Rows(SIMULATED.features, 1.0 - SIMULATED.labels)
    for weight, same in ((0.0, True), (0.5, False)):
        one, _ = train(REAL, SIMULATED, Recipe(simulated_weight=weight, epochs=3))
        two, _ = train(REAL, upside_down, Recipe(simulated_weight=weight, epochs=3))
        assert np.array_equal(one.layers.out_w, two.layers.out_w) == same


def test_trains_on_recorded_shots_alone() -> None:
    network, curve = train(some_rows(200, 5), None, Recipe(learning_rate=0.01, epochs=400))
    assert accuracy(network, some_rows(500, 6))["outcome"] > 0.9
    assert math.isnan(curve[-1].simulated)


def test_refuses_to_train_on_nothing_for_no_time_or_into_nonsense() -> None:
    with pytest.raises(BadInput, match="no recorded shots"):
        train(some_rows(0, 0), SIMULATED, Recipe())
    for recipe, option in ((Recipe(epochs=0), "--epochs is 0"), (Recipe(seed=-1), "--seed is -1"),
                           (Recipe(simulated_weight=-0.1), "--lambda is -0.1"),
                           (Recipe(simulated_weight=math.nan), "--lambda is nan"),
                           (Recipe(learning_rate=0.0), "--learning-rate is 0.0")):
        with pytest.raises(BadInput, match=option):
            train(REAL, SIMULATED, recipe)
    with pytest.raises(BadInput, match="diverged"):
        train(REAL, SIMULATED, Recipe(learning_rate=1e308, epochs=5))


@given(st.integers(1, 60), st.integers(1, 200), st.integers(0, 2**32))
def test_an_epoch_uses_every_simulated_row_and_recorded_rows_evenly(real: int, simulated: int, seed: int) -> None:
    batches = epoch_batches(np.random.default_rng(seed), real, simulated)
    assert batches.shape == (math.ceil(simulated / 10), 20)
    recorded = np.bincount(batches[:, :10].ravel(), minlength=real)
    imagined = np.bincount(batches[:, 10:].ravel() - real, minlength=simulated)
    assert len(recorded) == real and len(imagined) == simulated
    assert recorded.max() - recorded.min() <= 1
    assert imagined.min() >= 1 and imagined.sum() - simulated < 10


@given(st.integers(1, 60))
def test_an_epoch_without_simulation_uses_every_recorded_row(real: int) -> None:
    batches = epoch_batches(np.random.default_rng(0), real, 0)
    assert batches.shape == (math.ceil(real / 10), 10)
    assert set(batches.ravel()) == set(range(real))


@given(st.integers(0, 40), st.integers(0, 40), st.floats(0.0, 0.99), st.integers(0, 2**32))
def test_the_split_takes_its_share_of_each_class_and_loses_nothing(ones: int, twos: int, share: float,
                                                                   seed: int) -> None:
    labels = np.array([[1.0, 0.0]] * ones + [[1.0, 1.0]] * twos).reshape(-1, 2)
    features = np.arange(3.0 * len(labels)).reshape(-1, 3)
    kept, out = split_heldout(Rows(features, labels), share, seed)
    assert sorted([*kept.features[:, 0], *out.features[:, 0]]) == features[:, 0].tolist()
    assert out.labels[:, 1].sum() == round(share * twos)
    assert (out.labels[:, 1] == 0).sum() == round(share * ones)
    again, _ = split_heldout(Rows(features, labels), share, seed)
    assert np.array_equal(kept.features, again.features)


def test_holdout_must_be_a_share() -> None:
    for share in (-0.1, 1.0, float("nan")):
        with pytest.raises(BadInput, match="--holdout"):
            split_heldout(REAL, share, 0)


def test_accuracy_counts_outcome_two_and_three() -> None:
    # p_two = sigmoid(distance - 5), p_three = sigmoid(distance - 7) but for the hidden layer's squeeze
    flat = Layers(np.zeros((3, 8)), np.zeros(8), np.zeros((8, 2)), np.array([0.0, -1.0]))
    flat.hidden_w[0, 0] = 1.0
    flat.out_w[0] = 4.0, 0.0
    flat.out_b[0] = -2.0
    network = Network(np.zeros(3), np.ones(3), flat)                    # p_two >= 0.5 exactly where distance >= 0
    rows = Rows(np.array([[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]]),
                np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]))
    assert accuracy(network, rows) == {"shots": 4, "outcome": 0.5, "two": 0.75, "three": 0.75}
    assert accuracy(network, Rows(rows.features[:0], rows.labels[:0]))["outcome"] is None


def test_the_domain_is_the_recorded_box_a_tenth_wider_within_the_contract() -> None:
    features = np.array([[2.0, 0.5, 30.0], [12.0, 1.0, 80.0], [5.0, 0.7, 40.0]])
    domain = domain_of(features)
    assert domain["distance_m"] == pytest.approx([1.5, 12.5])
    assert domain["motor_ratio"] == pytest.approx([0.475, 1.0])         # no motor is faster than its free speed
    assert domain["hood_deg"] == pytest.approx([27.5, 82.5])


def test_rows_leave_out_what_they_cannot_use_and_say_so() -> None:
    shots = Shots(("a", "b", "c", "d"),
                  {"distance_m": np.array([1.0, 2.0, np.nan, 4.0]), "hood_deg": np.array([10.0, 20.0, 30.0, 40.0]),
                   "motor_ratio": np.array([0.1, 0.2, 0.3, 0.4])}, {"outcome": ("three", "", "two", "two")})
    rows, left_out = training_rows(shots, "DIR")
    assert rows.features.tolist() == [[1.0, 0.1, 10.0], [4.0, 0.4, 40.0]]
    assert rows.labels.tolist() == [[1.0, 1.0], [1.0, 0.0]]
    assert left_out == ["DIR: 1 of 4 shots left out: no outcome",
                        "DIR: 1 of 4 shots left out: no distance_m or no motor_ratio or no hood_deg"]
