"""The pieces that a gate's graph is put together from: some nodes, and the constants that they use."""

from typing import NamedTuple

import numpy as np
from onnx import NodeProto, helper

from robot.gate.contract import INPUT, NOVELTY, OUTPUT
from sim.gate.novelty import Novelty
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
