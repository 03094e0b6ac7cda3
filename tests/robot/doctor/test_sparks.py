"""The doctor on SPARK and advisory axes: emulated devices answer and speak for a second, well or not."""

import pytest

from tests.hw.spinning_plant import SpinningPlant
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, only_advice
from truearc.hw.devices.family import FAILURE, OK, WARNING, Finding, Heard
from truearc.hw.devices.odrive.emulator import OdriveNode
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.family import SparkConfig, check_firmware
from truearc.hw.devices.spark.frames import CONTROLLER_HEARTBEAT, locked_spark
from truearc.hw.emulated.nodes import Node
from truearc.hw.protocols import Frame
from truearc.robot.doctor import check_devices, check_heartbeat_lock, questions
from truearc.robot.motors import name_axes
from truearc_proof.world.faults import SILENT, TRUNCATED, UNPLUGGED, Fault, FaultyNode

MS, ALWAYS = 1_000_000, 1 << 60
PLANT = SpinningPlant()
MOTORS = {"flywheel motor 1": "flywheel_a", "flywheel motor 2": "flywheel_b", "hood motor": "hood",
          "feeder motor": "feeder"}


def hear(nodes: list[Node], config) -> dict[str, Finding]:
    """Findings of the doctor from a second of these devices, each queried once and stamped as a bus would."""
    frames = [answer for question in questions(config, None) for node in nodes
              if (question.arbitration_id, question.is_extended) in node.ids() for answer in node.receive(question, 0)]
    for t_ns in range(MS, 1000 * MS, MS):
        frames += [frame._replace(t_ns=t_ns) for node in nodes if node.due_ns() <= t_ns for frame in node.step(t_ns)]
    return {finding.check: finding for finding in check_devices(config, None, Heard(tuple(frames), 1.0))}


def sparks(config, faults=(), settings: SparkSettings | None = None) -> list[Node]:
    """The configuration's SPARKs; the hood's has the faults and settings."""
    nodes: list[Node] = []
    for name, axis in name_axes(config):
        if isinstance(axis, SparkConfig):
            mine = settings if name == "hood motor" else None
            node = SparkNode(axis, MOTORS[name], PLANT, mine,
                             PLANT.hood_at_limit if axis.has_endstop else None)
            nodes.append(FaultyNode(node, faults) if name == "hood motor" else node)
    return nodes


@pytest.mark.parametrize(("fault", "settings", "check", "level", "words"), [
    (Fault(UNPLUGGED, 0, ALWAYS), None, "firmware", FAILURE, "device 3 does not answer"),
    (Fault(SILENT, 0, ALWAYS), None, "status", FAILURE, "device 3 is silent"),
    (None, SparkSettings(firmware=(24, 0, 1)), "firmware", FAILURE, "24.0.1"),
    (None, SparkSettings(firmware=(27, 0, 0)), "firmware", FAILURE, "27.0.0"),
    (Fault(TRUNCATED, 0, ALWAYS, frame_id=0x0205B803, length=3), None, "status", FAILURE, "cannot be"),
    (Fault(TRUNCATED, 0, ALWAYS, frame_id=0x02052603, length=1), None, "firmware", FAILURE, "cannot be read"),
])
def test_what_is_wrong_with_a_spark_is_said(fault, settings, check, level, words):
    finding = hear(sparks(SPARK_HOOD, (fault,) if fault else (), settings), SPARK_HOOD)[f"hood motor, {check}"]
    assert finding.level == level and words in finding.says and finding.do


def test_standing_faults_and_doubled_numbers_are_told():
    (node,) = sparks(SPARK_HOOD, settings=SparkSettings(faults=0x10))
    node.receive(spark.make_statuses(SPARK_HOOD.axes.hood, spark.STATUSES), 0)      # as a run leaves it
    finding = hear([node], SPARK_HOOD)["hood motor, status"]
    assert finding.level == WARNING and "too hot" in finding.says
    both = sparks(SPARK_HOOD) + sparks(SPARK_HOOD)
    findings = hear(both, SPARK_HOOD)
    assert "2 devices answer as 3" in findings["hood motor, firmware"].says
    assert "0x0205b803 200/s instead of 100/s" in findings["device numbers"].says


def test_two_unique_ids_and_a_controller_with_the_say_are_told():
    (node,) = sparks(SPARK_HOOD)
    frame_id = spark.frame_id(SPARK_HOOD.axes.hood, "UNIQUE_ID_BROADCAST")
    assert frame_id == 0x0205BC03
    told = [Frame(0, frame_id, bytes([number] * 4), is_extended=True) for number in (1, 2, 1)]
    answer = node.receive(spark.make_version_query(SPARK_HOOD.axes.hood), 0)
    for frames, level in ((told[:1] + told[2:], OK), (told, FAILURE)):
        finding = check_firmware("hood motor", SPARK_HOOD.axes.hood, Heard((*answer, *frames), 2.0))
        assert finding.level == level and ("2 devices" in finding.says) == (level == FAILURE)
    lock = Frame(
        0, spark.frame_id(spark.SparkAxis(3, 1, False), "STATUS_0"), bytes([0] * 6 + [0x20, 0]), is_extended=True
    )
    alive = Frame(0, CONTROLLER_HEARTBEAT, bytes(8), is_extended=True)
    for frame in (lock, alive):
        heard = Heard((frame,), 1.0)
        assert check_heartbeat_lock([axis for _, axis in name_axes(ALL_SPARK)], heard).level == FAILURE
        assert check_heartbeat_lock([axis for _, axis in name_axes(only_advice("spark"))], heard).level == OK
    assert locked_spark(lock) == 3 and locked_spark(lock._replace(data=bytes(3))) is None


def test_of_advisory_axes_nothing_is_asked_and_each_must_be_heard():
    config = only_advice("odrive")
    assert questions(config, None) == []
    there = OdriveNode(OdriveAxis(11, 1), "flywheel_a", PLANT)
    findings = hear([there], config)
    assert findings["flywheel motor 1, status"].level == OK
    assert findings["flywheel motor 2, status"].level == FAILURE
