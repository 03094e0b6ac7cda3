"""The pieces that a gate's graph is put together from: some nodes, and the constants that they use."""

from typing import NamedTuple

import numpy as np
from onnx import NodeProto, helper

from robot.gate.contract import INPUT, NOVELTY, OUTPUT
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
             helper.make_node("Sqrt", ["known_positive"], ["known_distance"]),
             helper.make_node("Mul", ["known_distance", "known_per_distance"], [NOVELTY])]
    return Part(nodes, {
        "known_mean": novelty.mean, "known_scale": novelty.scale, "known_y": -2.0 * novelty.landmarks.T,
        "known_y_squared": (novelty.landmarks**2).sum(axis=1), "known_k": np.array([novelty.neighbour]),
        "known_last": np.array([novelty.neighbour - 1]), "known_per_distance": np.array(1.0 / novelty.largest)})


def physics_part(surrogate: Surrogate, shape: Shape, aside: float) -> Part:
    """The surrogate's mean and variance, and of them the probabilities of the ordinal model; `features` to `p`.

    Chebyshev polynomials as cos(k arccos u); no flight is integrated here. An outcome within a half-height has the
    probability (1 - lapse) (erf(above) - erf(below)) / 2 + its share of a lapse, and all that passes aside is a miss.
    """
    degree = surrogate.coefficients.shape[1]
    nodes = [helper.make_node("Sub", [INPUT, "box_middle"], ["box_centred"]),
             helper.make_node("Mul", ["box_centred", "box_per_half"], ["box_free"]),
             helper.make_node("Clip", ["box_free", "minus_one", "one"], ["box_u"]),
             helper.make_node("Acos", ["box_u"], ["turn"]),
             helper.make_node("Unsqueeze", ["turn", "axis_two"], ["turn_column"]),
             helper.make_node("Mul", ["turn_column", "orders"], ["turns"]),
             helper.make_node("Cos", ["turns"], ["polynomials"]),
             *(helper.make_node("Gather", ["polynomials", f"place_{k}"], [f"polynomial_{k}"], axis=1)
               for k in range(3)),
             helper.make_node("MatMul", ["polynomial_0", "coefficients"], ["flat"]),
             helper.make_node("Reshape", ["flat", "cube"], ["left_two"]),
             helper.make_node("Unsqueeze", ["polynomial_1", "axes_one_two"], ["row_1"]),
             helper.make_node("Unsqueeze", ["polynomial_2", "axes_one_three"], ["column_2"]),
             helper.make_node("MatMul", ["left_two", "column_2"], ["left_one"]),
             helper.make_node("MatMul", ["row_1", "left_one"], ["left_none"]),
             helper.make_node("Reshape", ["left_none", "pair"], ["latent"]),
             helper.make_node("Gather", ["latent", "first"], ["mean_m"], axis=1),
             helper.make_node("Gather", ["latent", "second"], ["free_m2"], axis=1),
             helper.make_node("Max", ["free_m2", "least_m2"], ["square_m2"]),
             helper.make_node("Mul", ["square_m2", "two"], ["double_m2"]),
             helper.make_node("Sqrt", ["double_m2"], ["spread_m"]),
             helper.make_node("Sub", ["edges_m", "mean_m"], ["above_m"]),
             helper.make_node("Add", ["edges_m", "mean_m"], ["below_m"]),
             *(node for side in ("above", "below") for node in (
                 helper.make_node("Div", [f"{side}_m", "spread_m"], [f"{side}_z"]),
                 helper.make_node("Erf", [f"{side}_z"], [f"{side}_share"]))),
             helper.make_node("Add", ["above_share", "below_share"], ["within"]),
             helper.make_node("Mul", ["within", "gain"], ["within_share"]),
             helper.make_node("Add", ["within_share", "lapse_share"], ["free_p"]),
             helper.make_node("Clip", ["free_p", "zero", "one"], [OUTPUT])]
    seen = 1.0 - aside
    return Part(nodes, {
        "box_middle": surrogate.middle, "box_per_half": surrogate.per_half, "orders": np.arange(degree, dtype=float),
        "minus_one": np.array(-1.0), "zero": np.array(0.0), "one": np.array(1.0), "two": np.array(2.0),
        "axis_two": np.array([2]), "axes_one_two": np.array([1, 2]), "axes_one_three": np.array([1, 3]),
        **{f"place_{k}": np.array(k) for k in range(3)}, "first": np.array([0]), "second": np.array([1]),
        "coefficients": surrogate.coefficients.transpose(1, 0, 2, 3).reshape(degree, -1),
        "cube": np.array([0, 2, degree, degree]), "pair": np.array([0, 2]), "least_m2": np.array(surrogate.least_m2),
        "edges_m": np.array([shape.two_m, shape.three_m]), "gain": np.array(0.5 * seen * (1.0 - shape.lapse)),
        "lapse_share": seen * shape.lapse * np.array([LAPSE_CELLS[1:4].sum(), LAPSE_CELLS[2]])})
