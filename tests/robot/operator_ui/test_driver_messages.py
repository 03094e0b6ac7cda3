"""Every reason that the robot can give has a driver's words: those in the source, and those that come out."""

import ast
import errno
import itertools
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from truearc import robot
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.readings import AngleReading, CameraFrame, MotorReading
from truearc.robot.aim import IDLE
from truearc.robot.config.schema import in_words
from truearc.robot.estimate import estimate
from truearc.robot.gate.model import Rating
from truearc.robot.gate.verdict import judge
from truearc.robot.operator_ui.driver_messages import FAULT, SEVERAL, TABLE, WAIT, YOU, find_words, placeholders, tell
from truearc.robot.types import Aim, Memory
from truearc.robot.vision import detect

ROOT = Path(robot.__file__).parents[1]
DOC = ROOT / "docs" / "page.md"
MODEL = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))
MOTOR = "flywheel motor 1"
SAMPLE = "7"                          # stands for whatever a sentence has put in
# (file, function or None for all of them, what is said around it)
SOURCES = (
    ("robot/gate/verdict.py", None, "{}"),
    ("robot/aim.py", "from_here", "{}"),
    ("robot/rig.py", "_read_bus", "{}"),
    ("robot/rig.py", "_read_eyes", "{}"),
    ("robot/rig.py", "_read_box", "{}"),
    ("robot/rig.py", "_stall", "{}"),
    ("robot/vision_source.py", "vision_failed", "camera lost: {}"),
    ("robot/processes/vision.py", "_trouble", "camera lost: {}"),
    ("robot/recording/file_writers.py", "trouble", "not recording: {}"),
    ("robot/processes/recorder_client.py", "trouble", "not recording: {}"),
    ("hw/encoder_plausibility.py", "fault", "hood motor: {}"),
    ("robot/recording/append_file.py", "flush", "not recording: {}"),
    ("robot/sysid/tick.py", "say", "{}"),
    ("robot/sysid/tick.py", "_trespasses", "identify: {}"),
    ("robot/sysid/tick.py", "_hood", "identify: {}"),
    ("robot/sysid/tick.py", "_overdue", "identify: {}"),
    ("hw/devices/button_box/frames.py", "parse_lines", "button box: {}"),
    ("hw/devices/button_box/press_sequence.py", "take", "button box: {}"),
    ("hw/tx_allowlist.py", "faults", "{}"),
    ("hw/tx_allowlist.py", "refuse", "not sent: {}"),
    ("hw/monitor.py", "faults", "{}"),
    ("hw/monitor.py", "fault", "{}"),
    ("hw/devices/spark/motor.py", "_setup_fault", "hood motor: spark 3 {}"),
    ("hw/devices/spark/motor.py", "_driving_fault", "hood motor: spark 3 {}"),
    ("hw/real/supervised_bus.py", "faults", "{}"),
    ("hw/real/supervised_bus.py", "_listen", "CAN lost: {}"),
    ("hw/real/can_bus.py", "_take", "CAN lost: {}"),
    ("hw/real/can_bus.py", "write", "CAN lost: {}"),
    ("hw/real/camera.py", "read", "camera lost: {}"),
    ("hw/real/serial_port.py", "read", "button box lost: {}"),
)
# whose strings are said by one of these around them, when not alone
AROUND = {("robot/rig.py", "_read_box"): "button box: {}"}
# what others say; no reasons; parts of one
NO_SENTENCES = {SAMPLE, f"button box: {SAMPLE}", f"for {SAMPLE} s", "yet", "", "plan", " up", " down", f" ({SAMPLE})",
                "lost presses", "has restarted"}
# files with a `faults` of which there is nothing to be said here: they pass on, or have none
SILENT = {
    "hw/protocols.py",
    "hw/motor.py",
    "hw/devices/advisory/motor.py",
    "hw/devices/odrive/motor.py",
    "hw/real/can_bus.py",
    "robot/recording/replay/frame_replay.py",
    "robot/recording/candump.py",
}


def samples(node, constants):
    """What an expression may come to, as text; SAMPLE where only a run could say."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr(values=values):
            return ["".join(parts) for parts in itertools.product(*(samples(value, constants) for value in values))]
        case ast.FormattedValue(value=ast.Name(id=name)) if name in constants:
            return [constants[name]]
        case ast.FormattedValue(value=ast.Name(id="name")):
            return [MOTOR]
        case ast.Name(id="why"):
            return ["", f" ({SAMPLE})"]
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return [one + other for one in samples(left, constants) for other in samples(right, constants)]
        case ast.IfExp(body=body, orelse=orelse):
            return samples(body, constants) + samples(orelse, constants)
    return [SAMPLE]


def is_text(node):
    return (isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
            or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add) and (is_text(node.left)
                                                                                 or is_text(node.right))))


def sentences(node, constants):
    """Every text below a node, but for docstrings, what is compared with, defaults and what others are joined by."""
    if isinstance(node, ast.Compare | ast.arguments | ast.Attribute) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return []
    if is_text(node):
        return samples(node, constants)
    return [text for child in ast.iter_child_nodes(node) for text in sentences(child, constants)]


def collect(path, function):
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    constants = {node.targets[0].id: node.value.value for node in tree.body if isinstance(node, ast.Assign)
                 and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)}
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
                 and function in (None, node.name)]
    assert functions, f"{path} has no function {function}"
    return {text for node in functions for child in node.body for text in sentences(child, constants)}


@pytest.mark.parametrize(("path", "function", "around"), SOURCES)
def test_every_sentence_in_the_source_has_words(path, function, around):
    found = collect(path, function) - NO_SENTENCES
    assert found
    for text in found:
        wrapped = [around.format(text), AROUND.get((path, function), "{}").format(text)]
        fitting = [words for reason in wrapped if (words := find_words(reason)) is not None]
        assert fitting, f"{path}: nobody has words for {text!r}"
        if path == "hw/devices/spark/motor.py":
            assert fitting[0].template != "{motor}: {errors}", text


def test_the_source_is_read_as_it_is_meant():
    found = collect("robot/gate/verdict.py", None)
    assert {"not armed", f"{MOTOR} silent for 7 s", "flywheel motors differ by 7 rad/s: belt?", "no gate model loaded",
            "model: outside what it was trained on (novelty 7)"} <= found and len(found) > 20
    assert "CAN lost: 7" in collect("robot/rig.py", "_read_bus")


def test_no_file_with_faults_is_forgotten():
    have = {str(path.relative_to(ROOT)) for room in ("hw", "robot") for path in (ROOT / room).rglob("*.py")
            if "emulated" not in path.parts and "def faults(" in path.read_text(encoding="utf-8")}
    assert have == {path for path, _, _ in SOURCES} & have | SILENT


@pytest.mark.parametrize("word", [word for _, word in (*odrive.ERROR_WORDS, *spark.ERROR_WORDS)] + ["error 0x80000000"])
def test_every_error_of_a_motor_has_words(word):
    for reason in (f"{MOTOR}: {word}", f"hood motor: {word}, watchdog expired"):
        assert find_words(reason) is not None
    assert word.split(":")[0] in " ".join(tell([f"{MOTOR}: {word}"])[0].reasons)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO, errno.EDQUOT])
def test_a_disk_that_refuses_has_words(number):
    (told,) = tell([f"not recording: {in_words(OSError(number, os.strerror(number)))}"])
    assert told.kind == FAULT and "nothing is recorded" in told.means.lower()


stamps = st.sampled_from([0, NOW_NS - seconds(0.004), NOW_NS - seconds(0.3), NOW_NS + seconds(1)])
numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-400, 400)
motors = st.builds(MotorReading, t_ns=stamps, position_rad=numbers, velocity_rad_s=numbers, heartbeat_t_ns=stamps,
                   axis_state=st.sampled_from([0, 1, 8]), axis_error=st.just(0) | st.integers(0, 2**32 - 1))
angles = st.none() | st.builds(AngleReading, t_ns=stamps, angle_rad=st.floats(0, 6.28), magnet_ok=st.booleans())
seen = st.sampled_from([None, good_memory().last_sighting, replace(good_memory().last_sighting, t_ns=1)])
memories = st.builds(Memory, armed=st.booleans(), homed=st.booleans(), awaiting=st.booleans(), request_t_ns=stamps,
                     feed_t_ns=stamps, steady_t_ns=stamps, last_sighting=seen)
aims = st.builds(Aim, motor_ratio=st.sampled_from([0.0, 0.5]), hood_deg=numbers,
                 source=st.sampled_from(["plan", "stand at 4.25 m"])) | st.just(IDLE)
ratings = st.builds(Rating, *[st.none() | st.floats(0, 1) | st.just(float("nan"))] * 2, st.booleans(),
                    st.none() | st.floats(0, 3))


class Says:
    def __init__(self, rating):
        self.rating = rating

    def rate(self, *features):
        if self.rating is None:
            raise RuntimeError("out of memory")
        return self.rating


@settings(max_examples=1500)
@given(wheels=st.tuples(motors, motors), hood=motors, feeder=motors, angle=angles, memory=memories, aim=aims,
       gate=st.none() | st.builds(Says, st.none() | ratings), config=st.sampled_from([CONFIG, MODEL]))
def test_every_reason_that_comes_out_has_words(wheels, hood, feeder, angle, memory, aim, gate, config):
    inputs = replace(good_inputs(), flywheels=wheels, hood_motor=replace(hood, position_rad=1.0), feeder=feeder,
                     hood_angle=angle)
    verdict = judge(inputs, estimate(inputs, memory, config), aim, memory, config, gate)
    for reason in verdict.reasons:
        assert find_words(reason) is not None, reason
    told = tell(verdict.reasons)
    assert sorted(reason for one in told for reason in one.reasons) == sorted(verdict.reasons)
    assert bool(told) == (not verdict.fire)


@pytest.mark.parametrize("words", TABLE, ids=lambda words: words.template)
def test_a_template_is_met_by_its_own_words(words):
    reason = words.template.format_map({name: {"motor": "hood motor", "device": "hood encoder"}.get(name, SAMPLE)
                                        for name in placeholders(words.template)})
    assert find_words(reason) is words                # nothing before it takes it away
    (told,) = tell([reason])
    assert words.kind in (FAULT, YOU, WAIT) and told.reasons == (reason,) and "{" not in told.means + told.do
    assert words.do or words.kind == WAIT


def test_what_the_driver_can_mend_comes_first():
    told = tell(["not armed", "wheels at 312 rad/s, wanted 358", "hood motor silent for 0.31 s",
                 "CAN lost: CAN slcan /dev/ttyACM0: gone", "target last seen 2.1 s ago"])
    assert [one.means for one in told] == [
        "CAN adapter pulled out?", "Hood motor: silent for 0.31 s", "Not armed", "Target out of sight for 2.1 s",
        "Wheels are not at speed: 312 of 358 rad/s"]
    assert [one.do for one in told][2:4] == ["press ARM", "turn towards the target"]


@pytest.mark.parametrize("look", [
    lambda: detect(CameraFrame(0, np.full((480, 640, 3), 250, np.uint8)), CONFIG.camera, CONFIG.tape, CONFIG.vision),
    lambda: detect(CameraFrame(0, np.zeros((480, 640, 3), np.uint8)), CONFIG.camera, CONFIG.tape, CONFIG.vision)])
def test_what_vision_says_of_an_image_has_words_of_its_own(look):
    inputs = replace(good_inputs(), unseen=look().reason)
    memory = replace(good_memory(), last_sighting=None)
    (reason,) = (reason for reason in judge(inputs, estimate(inputs, memory, CONFIG), good_memory().aim, memory, CONFIG,
                                            None).reasons if reason.startswith("target"))
    assert find_words(reason).template not in ("target {seen} ({why})", "target never seen")


def test_motors_in_the_same_trouble_are_told_as_one():
    told = tell(["flywheel motor 1 silent for 0.31 s", "hood encoder silent for 0.30 s",
                 "flywheel motor 1: watchdog expired", "hood motor: motor too hot", "feeder motor: spinout"])
    assert [one.means for one in told] == [
        "Flywheel motor 1, hood encoder: silent for 0.31 s",
        "Flywheel motor 1: let go, having heard nothing from the robot for too long",
        "Hood motor: motor too hot", "Feeder motor: its controller reports spinout"]
    assert told[0].reasons == ("flywheel motor 1 silent for 0.31 s", "hood encoder silent for 0.30 s")


def test_what_nobody_has_words_for_is_shown_as_it_is_and_first():
    told = tell(["not armed", "the moon is full", "the sun is up"])
    assert [one.means for one in told] == ["the moon is full", "the sun is up", "Not armed"] and told[0].kind == FAULT
    assert tell(()) == ()


def table():
    rows = ["| the robot says | the page says | what to do |", "|---|---|---|"]
    for words in TABLE:
        cells = [text.format_map({name: name if name in SEVERAL else "…" for name in placeholders(text)})
                 for text in (words.template, words.means, words.do)]
        rows.append(f"| `{cells[0]}` | {cells[1][:1].upper()}{cells[1][1:]} | {cells[2]} |")
    return "\n".join(rows)


def test_the_docs_have_the_same_table():
    assert table() in DOC.read_text(encoding="utf-8"), f"docs/page.md wants this table:\n{table()}"
