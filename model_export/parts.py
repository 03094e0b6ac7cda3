"""The pieces that a gate's graph is put together from: some nodes, and the constants that they use."""

from typing import NamedTuple

import numpy as np
from onnx import NodeProto, helper

from robot.gate.contract import FEATURES, INPUT, NOVELTY, OUTPUT
from sim.gate.likelihood import LAPSE_CELLS, Shape
from sim.gate.novelty import Novelty
from sim.gate.surrogate import Surrogate
from sim.network import Network


class Part(NamedTuple):
    """Nodes in order, and their constants by name; real numbers go out as float32, counts and positions as int64."""

    nodes: list[NodeProto]
    constants: dict[str, np.ndarray]


def network_part(network: Network) -> Part:
    """The seed's network: standardise, Gemm and Sigmoid twice; `features` to `p`."""
    nodes = [helper.make_node("Sub", [INPUT, "mean"], ["centred"]),
             helper.make_node("Mul", ["centred", "scale"], ["standardised"]),
             helper.make_node("Gemm", ["standardised", "hidden_w", "hidden_b"], ["hidden_z"]),
             helper.make_node("Sigmoid", ["hidden_z"], ["hidden"]),
             helper.make_node("Gemm", ["hidden", "out_w", "out_b"], ["out_z"]),
             helper.make_node("Sigmoid", ["out_z"], [OUTPUT])]
    return Part(nodes, {"mean": network.mean, "scale": network.scale, **network.layers._asdict()})


def novelty_part(novelty: Novelty) -> Part:
    """Distance to the k-th nearest landmark over the largest known one; `features` to `novelty` [n, 1].

    |z - y|^2 is taken as |y|^2 - 2 z.y, of which the smallest are found, plus |z|^2: one matrix product a decision.
    """
    nodes = [helper.make_node("Sub", [INPUT, "known_mean"], ["known_centred"]),
             helper.make_node("Mul", ["known_centred", "known_scale"], ["known_z"]),
             helper.make_node("Gemm", ["known_z", "known_y", "known_y_squared"], ["known_apart"]),
             helper.make_node("TopK", ["known_apart", "known_k"], ["known_nearest", "known_which"], largest=0),
             helper.make_node("Gather", ["known_nearest", "known_last"], ["known_kth"], axis=1),
             helper.make_node("ReduceSumSquare", ["known_z"], ["known_own"], axes=[1], keepdims=1),
             helper.make_node("Add", ["known_kth", "known_own"], ["known_squared"]),
             helper.make_node("Relu", ["known_squared"], ["known_positive"]),
             helper.make_node("Sqrt", ["known_positive"], [NOVELTY])]
    landmarks = novelty.landmarks / novelty.largest
    return Part(nodes, {
        "known_mean": novelty.mean, "known_scale": novelty.scale / novelty.largest, "known_y": -2.0 * landmarks.T,
        "known_y_squared": (landmarks**2).sum(axis=1), "known_k": np.array([novelty.neighbour]),
        "known_last": np.array([novelty.neighbour - 1])})


def physics_part(surrogate: Surrogate, shape: Shape, aside: float) -> Part:
    """The surrogate's mean and variance, and of them the probabilities of the ordinal model; `features` to `p`.

    Chebyshev polynomials as cos(k arccos u); no flight is integrated here. An outcome within a half-height has the
    probability (1 - lapse) (erf(above) - erf(below)) / 2 + its share of a lapse, and all that passes aside is a miss.
    Few nodes: at one row a decision each costs more than its arithmetic.
    """
    nodes = [helper.make_node("Gemm", [INPUT, "to_box", "from_middle"], ["box_free"]),          # each u, degree times
             helper.make_node("Clip", ["box_free", "minus_one", "one"], ["box_u"]),
             helper.make_node("Acos", ["box_u"], ["turn"]),
             helper.make_node("Mul", ["turn", "orders"], ["turns"]),
             helper.make_node("Cos", ["turns"], ["polynomials"]),
             helper.make_node("Split", ["polynomials"], ["first", "second", "third"], axis=1),
             helper.make_node("MatMul", ["first", "coefficients"], ["flat"]),
             helper.make_node("Reshape", ["flat", "left_two_shape"], ["left_two"]),
             helper.make_node("Unsqueeze", ["third", "axis_two"], ["third_column"]),
             helper.make_node("MatMul", ["left_two", "third_column"], ["left_one_flat"]),
             helper.make_node("Reshape", ["left_one_flat", "left_one_shape"], ["left_one"]),
             helper.make_node("Unsqueeze", ["second", "axis_two"], ["second_column"]),
             helper.make_node("MatMul", ["left_one", "second_column"], ["latent"]),
             helper.make_node("Split", ["latent"], ["mean_m", "double_free_m2"], axis=1),
             helper.make_node("Max", ["double_free_m2", "double_least_m2"], ["double_m2"]),
             helper.make_node("Sqrt", ["double_m2"], ["spread_m"]),
             helper.make_node("Sub", ["edges_m", "mean_m"], ["apart_m"]),
             helper.make_node("Div", ["apart_m", "spread_m"], ["apart"]),
             helper.make_node("Erf", ["apart"], ["shares_flat"]),
             helper.make_node("Reshape", ["shares_flat", "shares_shape"], ["shares"]),
             helper.make_node("Gemm", ["shares", "within", "lapse_share"], ["free_p"]),
             helper.make_node("Clip", ["free_p", "zero", "one"], [OUTPUT])]
    return Part(nodes, {**_polynomial_constants(surrogate), **_outcome_constants(shape, aside)})


def _polynomial_constants(surrogate: Surrogate) -> dict[str, np.ndarray]:
    degree = surrogate.coefficients.shape[1]
    scaled = surrogate.coefficients * np.array([1.0, 2.0])[:, None, None, None]       # erf wants twice the variance
    return {"to_box": np.repeat(np.diag(surrogate.per_half), degree, axis=1),
            "from_middle": np.repeat(-surrogate.middle * surrogate.per_half, degree),
            "orders": np.tile(np.arange(degree, dtype=float), len(FEATURES)),
            "coefficients": scaled.transpose(1, 0, 2, 3).reshape(degree, -1),
            "left_two_shape": np.array([0, 2 * degree, degree]), "left_one_shape": np.array([0, 2, degree]),
            "axis_two": np.array([2]), "minus_one": np.array(-1.0), "one": np.array(1.0),
            "double_least_m2": np.array(2.0 * surrogate.least_m2)}


def _outcome_constants(shape: Shape, aside: float) -> dict[str, np.ndarray]:
    """`within`: erf at (two, three, -two, -three) to the shares within two and within three."""
    half = 0.5 * (1.0 - aside) * (1.0 - shape.lapse) * np.eye(2)
    lapses = np.array([LAPSE_CELLS[1:4].sum(), LAPSE_CELLS[2]])
    return {"edges_m": np.array([shape.two_m, shape.three_m, -shape.two_m, -shape.three_m]),
            "shares_shape": np.array([0, 4]), "within": np.concatenate([half, -half]),
            "lapse_share": (1.0 - aside) * shape.lapse * lapses, "zero": np.array(0.0)}
