"""Many networks at once against plain NumPy and JAX: the gradient by hand, Adam by hand, each network alone."""

import math
from itertools import pairwise

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.training_rows import REAL, SIMULATED, sigmoid, some_rows
from truearc.errors import InputError
from truearc.sim.paper import Recipe
from truearc.sim.paper import train_many as many
from truearc.sim.paper.network import Layers, Rows, accuracy, cross_entropy, initial_layers, logits, mean_loss

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


def gradient(layers: Layers, z: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> Layers:
    """Back-propagation written out: sum over rows of weight x summed binary cross-entropy."""
    hidden = sigmoid(z @ layers.hidden_w + layers.hidden_b)
    out = (sigmoid(hidden @ layers.out_w + layers.out_b) - labels) * weights[:, None]
    back = out @ layers.out_w.T * hidden * (1.0 - hidden)
    return Layers(z.T @ back, back.sum(axis=0), hidden.T @ out, out.sum(axis=0))


def train_plainly(job: many.Job, learning_rate: float, steps: int) -> Layers:
    """The same updates in a plain loop in float64, Adam as Kingma and Ba's algorithm 1 has it."""
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
        slopes = gradient(layers, z[batch], labels[batch], weights)
        first = Layers(*(0.9 * m + 0.1 * g for m, g in zip(first, slopes, strict=True)))
        second = Layers(*(0.999 * v + 0.001 * g * g for v, g in zip(second, slopes, strict=True)))
        layers = Layers(*(part - learning_rate * (m / (1 - 0.9**time)) / (np.sqrt(v / (1 - 0.999**time)) + 1e-8)
                          for part, m, v in zip(layers, first, second, strict=True)))
    return layers


def same(one: many.Trained, other: many.Trained) -> bool:
    return one.step == other.step and all(
        np.array_equal(a, b) for a, b in zip(one.network.layers, other.network.layers, strict=True))


def test_the_gradient_of_the_reference_is_that_of_jax() -> None:
    layers = initial_layers(np.random.default_rng(0))
    z, weights = REAL.features / 10.0, np.linspace(0.1, 1.0, 23)
    wanted = jax.grad(lambda of: weights @ cross_entropy(logits(of, z), REAL.labels))(Layers(*map(np.asarray, layers)))
    for found, slope in zip(gradient(layers, z, REAL.labels, weights), wanted, strict=True):
        np.testing.assert_allclose(found, slope, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("job", [many.Job(REAL, SIMULATED, None, 0.3, 4), many.Job(REAL, None, None, 0.3, 5)])
def test_the_kernel_makes_the_updates_of_a_plain_loop(job: many.Job) -> None:
    found = many.train_many([job], Recipe(learning_rate=0.02, steps=60))[0]
    for name, layer, wanted in zip(Layers._fields, found.network.layers, train_plainly(job, 0.02, 60), strict=True):
        np.testing.assert_allclose(layer, wanted, rtol=1e-4, atol=2e-5, err_msg=name)
    # the comparison would see one step more or less
    assert np.abs(many.pack(train_plainly(job, 0.02, 61)) - many.pack(found.network.layers)).max() > 1e-3


def test_the_series_is_the_sigmoid() -> None:
    x = np.concatenate([np.linspace(-90.0, 90.0, 20001), [-3e38, -1e4, 1e4, 3e38]]).astype(np.float32)
    found = np.array([many.sigmoid(value) for value in x])
    with np.errstate(over="ignore"):
        wanted = sigmoid(x.astype(float))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6)
    assert math.isnan(many.sigmoid(np.float32(np.nan)))


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


def test_learns_what_can_be_learnt() -> None:
    real, fresh = some_rows(200, 5), some_rows(1000, 6)
    jobs = [many.Job(real, SIMULATED, None, 0.01, 1), many.Job(real, None, None, 0.01, 1),
            many.Job(real, SIMULATED, None, 0.01, 2)]
    both, alone, other = many.train_many(jobs, Recipe(BRISK, steps=3000))
    assert accuracy(both.network, fresh)["outcome"] > 0.92
    assert accuracy(alone.network, fresh)["outcome"] > 0.9
    assert not np.array_equal(both.network.layers.hidden_w, other.network.layers.hidden_w)


def test_lambda_zero_makes_simulated_labels_irrelevant_and_more_does_not() -> None:
    upside_down = Rows(SIMULATED.features, 1.0 - SIMULATED.labels)
    for weight, equal in ((0.0, True), (0.5, False)):
        jobs = [many.Job(REAL, rows, None, weight) for rows in (SIMULATED, upside_down)]
        one, two = many.train_many(jobs, Recipe(steps=20))
        assert same(one, two) == equal


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


@given(st.integers(1, 60))
def test_an_epoch_without_simulation_uses_every_recorded_row(real: int) -> None:
    batches = Order(np.random.default_rng(0), real, 0).take(math.ceil(real / 10))
    assert set(batches[:, :10].ravel()) == set(range(real)) and not batches[:, 10:].any()


def test_rows_meet_each_other_in_every_order() -> None:
    """The shuffle is even: over many epochs each row stands in each minibatch about equally often."""
    orders = Order(np.random.default_rng(0), 30, 0).take(3 * 3000)[:, :10].reshape(3000, 3, 10)
    share = np.array([[(orders[:, place] == row).any(axis=1).mean() for place in range(3)] for row in range(30)])
    assert np.abs(share - 1.0 / 3.0).max() < 5.0 * math.sqrt(2.0 / 9.0 / 3000)
    assert all(not np.array_equal(one, other) for one, other in pairwise(orders[:50]))
