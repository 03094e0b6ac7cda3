"""The pieces that a gate's graph is put together from: some nodes, and the constants that they use."""

from typing import NamedTuple

import numpy as np
from onnx import NodeProto, helper

from truearc.robot.gate import INPUT, NOVELTY, OUTPUT
from truearc.sim.gate.likelihood import LAPSE_CELLS, GateShape
from truearc.sim.gate.model import Novelty
from truearc.sim.gate.surrogate import Surrogate, as_cosines
from truearc.sim.paper.network import Network

EDGES = 4                             # of the target: above and below, of two and of three


class Part(NamedTuple):
    """Nodes in order, and their constants by name; real numbers go out as float32, counts and positions as int64."""

    nodes: list[NodeProto]
    constants: dict[str, np.ndarray]


def network_part(network: Network) -> Part:
    """Return the nodes of the paper's network: standardise, Gemm and Sigmoid twice; `features` to `p`."""
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
    nodes = [helper.make_node("Gemm", [INPUT, "known_scale", "known_from"], ["known_z"]),
             helper.make_node("Gemm", ["known_z", "known_y", "known_y_squared"], ["known_apart"]),
             helper.make_node("TopK", ["known_apart", "known_k"], ["known_nearest", "known_which"], largest=0),
             helper.make_node("Gather", ["known_nearest", "known_last"], ["known_kth"], axis=1),
             helper.make_node("ReduceSumSquare", ["known_z"], ["known_own"], axes=[1], keepdims=1),
             helper.make_node("Add", ["known_kth", "known_own"], ["known_squared"]),
             helper.make_node("Relu", ["known_squared"], ["known_positive"]),
             helper.make_node("Sqrt", ["known_positive"], [NOVELTY])]
    landmarks, scale = novelty.landmarks / novelty.largest, novelty.scale / novelty.largest
    return Part(nodes, {
        "known_scale": np.diag(scale), "known_from": -novelty.mean * scale, "known_y": -2.0 * landmarks.T,
        "known_y_squared": (landmarks**2).sum(axis=1), "known_k": np.array([novelty.neighbour]),
        "known_last": np.array([novelty.neighbour - 1])})


def physics_part(surrogate: Surrogate, shape: GateShape, aside: float) -> Part:
    """The surrogate's mean and spread, and of them the probabilities of the ordinal model; `features` to `p`.

    Chebyshev polynomials as cos(k arccos u), their products as cosines of sums; no flight is integrated here. An
    outcome within a half-height has the probability (1 - lapse) (erf(above) - erf(below)) / 2 + its share of a lapse,
    and all that passes aside is a miss. Few nodes: at one row a decision each costs more than its arithmetic.
    """
    nodes = [helper.make_node("Gemm", [INPUT, "to_box", "from_middle"], ["box_free"]),
             helper.make_node("Clip", ["box_free", "minus_one", "one"], ["box_u"]),
             helper.make_node("Acos", ["box_u"], ["turn"]),
             helper.make_node("MatMul", ["turn", "frequencies"], ["turns"]),
             helper.make_node("Cos", ["turns"], ["cosines"]),
             helper.make_node("Gemm", ["cosines", "amplitudes", "edges_m"], ["apart_and_square"]),
             helper.make_node("Split", ["apart_and_square"], ["apart_m", "double_free_m2"], axis=1),
             helper.make_node("Max", ["double_free_m2", "double_least_m2"], ["double_m2"]),
             helper.make_node("Sqrt", ["double_m2"], ["spread_m"]),
             helper.make_node("Div", ["apart_m", "spread_m"], ["apart"]),
             helper.make_node("Erf", ["apart"], ["shares"]),
             helper.make_node("Gemm", ["shares", "within", "lapse_share"], ["free_p"]),
             helper.make_node("Clip", ["free_p", "zero", "one"], [OUTPUT])]
    return Part(nodes, {**_polynomial_constants(surrogate), **_outcome_constants(shape, aside)})


def _polynomial_constants(surrogate: Surrogate) -> dict[str, np.ndarray]:
    """`amplitudes` [F, 8]: four times minus the mean, to which the edges are added; four times twice the variance."""
    frequencies, (mean_m, square_m2) = as_cosines(surrogate)
    return {"to_box": np.diag(surrogate.per_half), "from_middle": -surrogate.middle * surrogate.per_half,
            "frequencies": frequencies.T.astype(float), "minus_one": np.array(-1.0), "one": np.array(1.0),
            "amplitudes": np.stack([-mean_m] * EDGES + [2.0 * square_m2] * EDGES, axis=1),
            "double_least_m2": np.array(2.0 * surrogate.least_m2)}


def _outcome_constants(shape: GateShape, aside: float) -> dict[str, np.ndarray]:
    """`within`: erf at (two, three, -two, -three) to the shares within two and within three."""
    half = 0.5 * (1.0 - aside) * (1.0 - shape.lapse) * np.eye(2)
    lapses = np.array([LAPSE_CELLS[1:4].sum(), LAPSE_CELLS[2]])
    edges_m = [shape.two_m, shape.three_m, -shape.two_m, -shape.three_m]
    return {"edges_m": np.array(edges_m + [0.0] * EDGES), "within": np.concatenate([half, -half]),
            "lapse_share": (1.0 - aside) * shape.lapse * lapses, "zero": np.array(0.0)}
