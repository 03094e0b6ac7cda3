"""What networks are trained on and judged by: rows, splits, loss, accuracy, domain."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.training_rows import REAL, sigmoid
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.network import (
    Layers,
    Network,
    Rows,
    accuracy,
    cross_entropy,
    domain_of,
    initial_layers,
    mean_loss,
    probabilities,
    split_heldout,
    training_rows,
)


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
        with pytest.raises(InputError, match="--holdout"):
            split_heldout(REAL, share, 0)
        with pytest.raises(InputError, match="--validation"):
            split_heldout(REAL, share, 0, "--validation")


def test_validation_is_drawn_apart_from_the_holdout() -> None:
    one, other = (split_heldout(REAL, 0.4, 0, option)[1] for option in ("--holdout", "--validation"))
    assert not np.array_equal(one.features, other.features)


def test_accuracy_counts_outcome_two_and_three() -> None:
    # p_two = sigmoid(distance - 5), p_three = sigmoid(distance - 7), before the hidden layer's squeeze
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
                        "DIR: 1 of 4 shots left out: no distance_m"]
