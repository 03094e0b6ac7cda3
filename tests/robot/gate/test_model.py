"""The gate's model against NumPy, and against files that must not be believed. Builds its own ONNX files."""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from onnx import TensorProto, helper, numpy_helper

from tests.robot.good_tick import CONFIG
from truearc.errors import InputError
from truearc.robot import gate as gate_model
from truearc.robot.config.rig_spec import Target
from truearc.robot.gate import KEY_SEAL, NO_RATING, UNSEALED, Gate, facing_up_of, load_gate, load_gate_for, seal

BOX = {"distance_m": [2.0, 8.0], "motor_ratio": [0.3, 0.9], "hood_deg": [20.0, 60.0]}
RNG = np.random.default_rng(5)
WEIGHTS = {"w1": RNG.normal(size=(3, 8)) * [[1.0], [9.0], [0.1]], "b1": RNG.normal(size=8),
           "w2": RNG.normal(size=(8, 2)), "b2": RNG.normal(size=2),
           "wn": np.array([[0.0], [0.0], [0.02]]), "bn": np.zeros(1)}
METADATA = {gate_model.KEY_CONTRACT: gate_model.contract_json().decode(),
            gate_model.KEY_CONTRACT_HASH: gate_model.contract_hash(),
            gate_model.KEY_DOMAIN: json.dumps(BOX), gate_model.KEY_NOVELTY: '{"k": 3}',
            gate_model.KEY_PROVENANCE: '{"seed": 3}', KEY_SEAL: UNSEALED}


# novelty is |hood| / 50: over 1 from 50 degrees on
def build(weights: dict[str, Any] = WEIGHTS, metadata: dict[str, str] = METADATA, name: str = "features",
          shape: tuple[Any, ...] = ("n", 3), out: str = "p", out_shape: tuple[Any, ...] = ("n", 2),
          kind: int = TensorProto.FLOAT, last: str = "Sigmoid", far: str = "Abs", two_outputs: bool = True) -> bytes:
    dtype = helper.tensor_dtype_to_np_dtype(kind)
    graph = helper.make_graph(
        [helper.make_node("Gemm", [name, "w1", "b1"], ["z1"]), helper.make_node("Sigmoid", ["z1"], ["h"]),
         helper.make_node("Gemm", ["h", "w2", "b2"], ["z2"]), helper.make_node(last, ["z2"], [out]),
         helper.make_node("Gemm", [name, "wn", "bn"], ["far"]), helper.make_node(far, ["far"], ["novelty"])],
        "g", [helper.make_tensor_value_info(name, kind, shape)], [helper.make_tensor_value_info(out, kind, out_shape),
         helper.make_tensor_value_info("novelty", kind, (out_shape[0], 1))][:1 + two_outputs],
        [numpy_helper.from_array(np.asarray(array, dtype), key) for key, array in weights.items()])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    data = model.SerializeToString()
    return seal(data) if UNSEALED.encode() in data else data


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gate") / "gate.onnx"
    path.write_bytes(build())
    return path


@pytest.fixture(scope="module")
def gate(path: Path) -> Gate:
    return load_gate(path)


def by_hand(features: np.ndarray) -> np.ndarray:
    hidden = 1.0 / (1.0 + np.exp(-(features @ WEIGHTS["w1"] + WEIGHTS["b1"])))
    return 1.0 / (1.0 + np.exp(-(hidden @ WEIGHTS["w2"] + WEIGHTS["b2"])))


def test_rates_as_numpy_does_alone_and_together(gate: Gate) -> None:
    low, high = np.array(list(BOX.values())).T
    rows = np.random.default_rng(0).uniform(low - 0.2, high + 0.2, (300, 3))
    p, inside, novelty = gate.rate_many(rows)
    assert np.abs(p - by_hand(rows)).max() < 1e-5
    assert np.abs(novelty - rows[:, 2] / 50.0).max() < 1e-6
    assert inside.tolist() == (((rows >= low) & (rows <= high)).all(axis=1) & (rows[:, 2] <= 50.0)).tolist()
    assert 0 < inside.sum() < 300
    for row, pair, within, new in zip(rows, p, inside, novelty, strict=True):
        one = gate.rate(*row.tolist())
        assert one.novelty == pytest.approx(new, abs=1e-6)
        assert (one.p_two, one.p_three) == pytest.approx(pair, abs=1e-6)
        assert one.in_domain == within
        assert one == gate.rate(*row.tolist())


def test_says_where_it_came_from_and_has_its_faces(gate: Gate, path: Path) -> None:
    assert gate.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert gate.provenance == {"seed": 3}
    assert gate.domain == ((2.0, 8.0), (0.3, 0.9), (20.0, 60.0))
    assert gate.rate(2.0, 0.9, 20.0).in_domain
    assert not gate.rate(np.nextafter(2.0, 0.0), 0.9, 20.0).in_domain
    assert not gate.rate(2.0, np.nextafter(0.9, 1.0), 20.0).in_domain


@given(st.floats(), st.floats(), st.floats())
def test_no_input_gives_a_nan_or_a_domain_outside_the_box(gate, distance, ratio, hood):
    one = gate.rate(distance, ratio, hood)
    assert one.in_domain == (2.0 <= distance <= 8.0 and 0.3 <= ratio <= 0.9 and 20.0 <= hood <= 60.0
                             and one.novelty is not None and one.novelty <= 1.0)
    if one.p_two is None or one.p_three is None:
        assert one == NO_RATING
    else:
        assert 0.0 <= one.p_two <= 1.0 and 0.0 <= one.p_three <= 1.0
    if not np.isfinite([distance, ratio, hood]).all():
        assert one == NO_RATING
    p, inside, _ = gate.rate_many(np.array([[distance, ratio, hood], [5.0, 0.5, 45.0]]))
    assert inside.tolist() == [one.in_domain, True]
    assert np.isnan(p[0]).all() == (one.p_two is None)
    assert np.isfinite(p[1]).all()


def without(key: str) -> dict[str, str]:
    return {name: value for name, value in METADATA.items() if name != key}


def domain(**changed: Any) -> dict[str, str]:
    return METADATA | {gate_model.KEY_DOMAIN: json.dumps(BOX | changed)}


REFUSED = {
    "empty": (b"", "not a usable ONNX model"),
    "words": (b"this is not a model at all", "not a usable ONNX model"),
    "no contract": (build(metadata={}), "carries no contract"),
    **{f"no {key}": (build(metadata=without(key)), key) for key in (
        gate_model.KEY_CONTRACT_HASH, gate_model.KEY_DOMAIN, gate_model.KEY_NOVELTY, gate_model.KEY_PROVENANCE,
        KEY_SEAL)},
    "foreign hash": (build(metadata=METADATA | {gate_model.KEY_CONTRACT_HASH: "0" * 64}), "another contract"),
    "contract beside its hash": (build(metadata=METADATA | {gate_model.KEY_CONTRACT: "{}"}), "does not match"),
    "domain not JSON": (build(metadata=METADATA | {gate_model.KEY_DOMAIN: "{"}), gate_model.KEY_DOMAIN),
    "domain of other features": (build(metadata=domain(speed=[0, 1])), "'speed'"),
    "domain upside down": (build(metadata=domain(hood_deg=[60.0, 20.0])), "hood_deg"),
    "domain beyond the contract": (build(metadata=domain(motor_ratio=[0.3, 1.5])), "motor_ratio"),
    "domain of words": (build(metadata=domain(distance_m="near")), "distance_m"),
    "domain not finite": (build(metadata=METADATA | {gate_model.KEY_DOMAIN: json.dumps(BOX | {"hood_deg": [
        float("nan"), 60.0]})}), gate_model.KEY_DOMAIN),
    "no novelty, as before the contract had it": (build(two_outputs=False), "novelty tensor(float) [n, 1]"),
    "novelty not a number": (build(WEIGHTS | {"bn": np.full(1, -9.0)}, far="Log"), "no novelty inside its own domain"),
    "a foreign seal": (build(metadata=METADATA | {KEY_SEAL: "0" * 64}), "damaged or altered"),
    "other input": (build(name="x"), "the input is x"),
    "other output": (build(out="q"), "the output is q"),
    "four features": (build(WEIGHTS | {"w1": np.zeros((4, 8)), "wn": np.zeros((4, 1))}, shape=("n", 4)),
                      "asks for features"),
    "one output": (build(WEIGHTS | {"w2": np.zeros((8, 1)), "b2": np.zeros(1)}, out_shape=("n", 1)), "asks for p"),
    "one row only": (build(shape=(1, 3), out_shape=(1, 2)), "asks for features"),
    "double precision": (build(kind=TensorProto.DOUBLE), "tensor(double)"),
    "NaN weights": (build(WEIGHTS | {"b1": np.full(8, np.nan)}), "no probability inside its own domain"),
    "infinite weights": (build(WEIGHTS | {"w1": np.full((3, 8), np.inf), "b1": np.full(8, -np.inf)}), "no probability"),
    "log odds, not p": (build(last="Identity"), "no probability")}


@pytest.mark.parametrize("what", REFUSED)
def test_refuses(tmp_path: Path, what: str) -> None:
    data, words = REFUSED[what]
    path = tmp_path / "foreign.onnx"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        load_gate(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_refuses_no_file_a_directory_and_one_cut_short_anywhere(tmp_path: Path) -> None:
    for path in (tmp_path / "none.onnx", tmp_path):
        with pytest.raises(InputError, match=str(path)):
            load_gate(path)
    data = build()
    path = tmp_path / "cut.onnx"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            load_gate(path)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_damaged_file_is_refused_or_still_gives_probabilities(tmp_path_factory, data):
    model = bytearray(build())
    for _ in range(data.draw(st.integers(1, 3))):
        model[data.draw(st.integers(0, len(model) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.onnx"
    path.write_bytes(model)
    try:
        gate = load_gate(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    centre = [0.5 * (low + high) for low, high in gate.domain]
    one = gate.rate(*centre)
    assert one == NO_RATING or (0.0 <= one.p_two <= 1.0 and 0.0 <= one.p_three <= 1.0)      # type: ignore[operator]


def altered(change: Any) -> bytes:
    """A sealed gate whose graph was changed by `change` before it was sealed: damage is not what gives it away."""
    model = onnx.load_from_string(build().replace(*reversed_seal(build())))
    change(model)
    return seal(model.SerializeToString())


def reversed_seal(data: bytes) -> tuple[bytes, bytes]:
    entry = next(one for one in onnx.load_from_string(data).metadata_props if one.key == KEY_SEAL)
    return entry.value.encode(), UNSEALED.encode()


def endless_loop(model: Any) -> None:
    """`p` goes through a Loop that is told to go on for ever: 2^63 - 1 times."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["goes_on"], ["still"]), helper.make_node("Identity", ["was"], ["is"])], "body",
        [helper.make_tensor_value_info("round", TensorProto.INT64, []),
         helper.make_tensor_value_info("goes_on", TensorProto.BOOL, []),
         helper.make_tensor_value_info("was", TensorProto.FLOAT, None)],
        [helper.make_tensor_value_info("still", TensorProto.BOOL, []),
         helper.make_tensor_value_info("is", TensorProto.FLOAT, None)])
    model.graph.node[3].output[0] = "once"
    model.graph.node.append(helper.make_node("Loop", ["rounds", "yes", "once"], ["p"], body=body))
    model.graph.initializer.extend([numpy_helper.from_array(np.array(2 ** 63 - 1), "rounds"),
                                    numpy_helper.from_array(np.array(True), "yes")])


def folded(size: int, products: int) -> Any:
    """Constants that onnxruntime multiplies while it loads: matrices of that size, so many times."""
    def change(model: Any) -> None:
        nodes = [helper.make_node("MatMul", ["column", "row"], ["m0"]),
                 *(helper.make_node("MatMul", [f"m{k}", f"m{k}"], [f"m{k + 1}"]) for k in range(products)),
                 helper.make_node("MatMul", [f"m{products}", "two"], ["narrow"]),
                 helper.make_node("Gather", ["narrow", "first"], ["zero"], axis=0),
                 helper.make_node("Add", ["z2", "zero"], ["z3"])]
        for node in reversed(nodes):
            model.graph.node.insert(3, node)
        model.graph.node[3 + len(nodes)].input[0] = "z3"
        zeros = {"column": (size, 1), "row": (1, size), "two": (size, 2)}
        model.graph.initializer.extend(numpy_helper.from_array(np.zeros(shape, np.float32), name)
                                       for name, shape in zeros.items())
        model.graph.initializer.append(numpy_helper.from_array(np.array(0), "first"))
    return change


def own_operation(model: Any) -> None:
    model.graph.node[3].domain = "team"
    model.functions.append(helper.make_function("team", "Sigmoid", ["x"], ["y"], [], []))


def other_file(model: Any) -> None:
    onnx.external_data_helper.set_external_data(model.graph.initializer[0], "weights.bin")


@pytest.mark.parametrize(("change", "words"), [
    (endless_loop, "operation 'Loop' is not one of Abs,"), (own_operation, "its own operations"),
    (other_file, "another file")], ids=lambda value: getattr(value, "__name__", ""))
def test_refuses_what_has_no_bound_before_onnxruntime_sees_it(tmp_path, monkeypatch, change, words):
    path = tmp_path / "gate.onnx"
    path.write_bytes(altered(change))
    for name in ("try_gate", "_open_session"):
        monkeypatch.setattr(gate_model, name, lambda *_: pytest.fail("was loaded"))
    with pytest.raises(InputError, match=words):
        load_gate(path)


def test_checks_the_seal_before_onnxruntime_sees_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "gate.onnx"
    path.write_bytes(build().replace(b"Sigmoid", b"Softmax"))
    for name in ("try_gate", "_open_session"):
        monkeypatch.setattr(gate_model, name, lambda *_: pytest.fail("was loaded"))
    with pytest.raises(InputError, match="damaged or altered"):
        load_gate(path)


def test_a_gate_is_refused_at_another_target(tmp_path: Path) -> None:
    hub = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6, points=1.0)
    higher = replace(CONFIG.rig, target=replace(hub, centre_height_m=2.64))
    front, up = tmp_path / "front.onnx", tmp_path / "up.onnx"
    rig = replace(CONFIG.rig, target=hub)
    front.write_bytes(build())
    up.write_bytes(build(metadata={**METADATA, gate_model.KEY_PROVENANCE: json.dumps({"target": facing_up_of(rig)})}))
    assert not load_gate_for(front, CONFIG.rig).hit_or_miss and load_gate_for(up, rig).hit_or_miss
    assert load_gate_for(up, replace(rig, target=replace(hub, points=3.0))).target == facing_up_of(rig)
    for path, other in ((front, rig), (up, CONFIG.rig), (up, higher)):
        with pytest.raises(InputError, match=r"\.onnx: trained for a target that faces .*, but this robot's faces"):
            load_gate_for(path, other)


def test_refuses_a_model_that_takes_too_long_to_load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quick, slow = tmp_path / "quick.onnx", tmp_path / "slow.onnx"
    quick.write_bytes(altered(folded(50, 2)))
    load_gate(quick)
    slow.write_bytes(altered(folded(2500, 2000)))         # 31 GFlop, two thousand times, or until memory ends
    monkeypatch.setattr(gate_model, "LIMIT_S", 1)         # a fast processor fills the memory in three
    with pytest.raises(InputError, match=r"slow\.onnx: takes (more than 1 s of processor|longer than 12 s)"):
        load_gate(slow)


@pytest.mark.skipif(sys.platform != "linux", reason="the system limits no data of a process")
def test_refuses_a_model_that_takes_too_much_memory_to_load(tmp_path: Path) -> None:
    path = tmp_path / "large.onnx"
    path.write_bytes(altered(folded(20_000, 0)))          # 1.6 GB
    with pytest.raises(InputError, match=r"large\.onnx: does not run .*MatMul"):
        load_gate(path)
