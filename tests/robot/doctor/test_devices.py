"""The doctor listens to emulated devices, well and with each of the things that go wrong; SPARKs and advice, too."""

import itertools
import math
import os
import re
import struct

import cantools
import pytest
from msgspec.structs import replace

from tests.hw.spinning_plant import SpinningPlant
from tests.robot.good_tick import CONFIG
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, only_advice
from truearc.cli.doctor_checks import look_at_bus
from truearc.errors import InputError
from truearc.hw.devices.canandmag import CanandmagNode
from truearc.hw.devices.family import FAILURE, OK, WARNING, Finding, Heard
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.family import SparkConfig, check_firmware
from truearc.hw.devices.spark.frames import CONTROLLER_HEARTBEAT, locked_spark
from truearc.hw.emulated.nodes import Node, StepClock, Twin
from truearc.hw.protocols import Frame
from truearc.hw.real.can_bus import open_can
from truearc.robot.doctor import check_devices, check_heartbeat_lock, load_endpoints, questions
from truearc.robot.motors import name_axes
from truearc_proof.world.faults import SILENT, TRUNCATED, UNPLUGGED, Fault, FaultyNode

CHANNELS = itertools.count()
ALWAYS = 1 << 60
NAMES = ("flywheel_a", "flywheel_b", "hood", "feeder")
ENDPOINTS = """{"fw_version": "0.6.10", "hw_version": "5.2.0", "endpoints": {
 "axis0.config.enable_watchdog": {"id": 200, "type": "bool"}, "axis0.min_endstop.endstop_state": {"id": 596},
 "axis0.config.watchdog_timeout": {"id": 201, "type": "float"}, "save_configuration": {"id": 9, "type": "function"},
 "axis0.config.encoder_bandwidth": {"id": 243, "type": "float"}, "vbus_voltage": {"id": 1, "type": "float"}}}"""


def as_number(value: float) -> int:
    return int.from_bytes(struct.pack("<f", value), "little")


def inside(watchdog: bool = True, timeout_s: float = 0.1, bandwidth: float = 1000.0):
    return ((200, int(watchdog)), (201, as_number(timeout_s)), (243, as_number(bandwidth)))


@pytest.fixture
def endpoints(tmp_path):
    path = tmp_path / "flat_endpoints.json"
    path.write_text(ENDPOINTS)
    return load_endpoints(path)


@pytest.mark.parametrize("number", ["1e999", "70000", "-1"])
def test_a_table_of_endpoints_with_an_impossible_id_is_refused(tmp_path, number):
    path = tmp_path / "flat_endpoints.json"
    path.write_text(re.sub(r'"id": \d+', f'"id": {number}', ENDPOINTS, count=1))
    with pytest.raises(InputError, match=r"flat_endpoints\.json: "):
        load_endpoints(path)


class Bench:
    """All the devices of the shipped configuration; `settings` and `faults` by device name."""

    def __init__(self, settings=None, faults=None, more=(), wrap=lambda name, node: node, is_serial=False):
        self.plant = plant = SpinningPlant()
        axes = [*CONFIG.axes.flywheels, CONFIG.axes.hood, CONFIG.axes.feeder]
        self.nodes = {}
        for name, axis in zip(NAMES, axes, strict=True):
            well = replace(SETTINGS.get(name, OdriveSettings()), parameters=inside())
            self.nodes[name] = OdriveNode(axis, name, plant, (settings or {}).get(name, well),
                                          plant.hood_at_limit if axis.endstop_endpoint else None)
        self.nodes["hood_encoder"] = CanandmagNode(CONFIG.hood_encoder.device, plant, 40.0, 1)
        nodes = [wrap(name, FaultyNode(node, (faults or {})[name]) if name in (faults or {}) else node)
                 for name, node in self.nodes.items()]
        self.clock = StepClock(lambda t_ns: self.twin.advance(t_ns))
        if is_serial:
            from truearc.hw.emulated.serial_link import PtyCable, SlcanAdapter
            self.far = SlcanAdapter(PtyCable())
            self.near = open_can("slcan", self.far.port, 1_000_000, self.clock)
        else:
            channel = f"doctor-{next(CHANNELS)}"
            self.near, self.far = (open_can("virtual", channel, 1_000_000, self.clock) for _ in range(2))
        self.twin = Twin(plant, self.far, (*nodes, *more), (self._say_more,))
        self.more: list[Frame] = []

    def _say_more(self, t_ns):
        for frame in self.more:
            self.far.write(frame)

    def findings(self, endpoints=None):
        try:
            return {finding.check: finding
                    for finding in look_at_bus(CONFIG, self.near, self.clock, None, endpoints, 1.0)}
        finally:
            self.near.close()
            self.far.close()


def levels(findings, level):
    return {check for check, finding in findings.items() if finding.level == level}


def fault(kind, frame_id=None, length=0):
    return (Fault(kind, 0, ALWAYS, frame_id, length),)


def test_a_well_robot_passes_everything_and_nothing_moves_or_changes(endpoints):
    bench = Bench()
    findings = bench.findings(endpoints)
    assert all(node.state == 1 and node.errors == 0 for name, node in bench.nodes.items() if name in NAMES)
    assert all(node.bad_frames == 0 for node in bench.nodes.values())
    assert levels(findings, OK) == set(findings) and len(findings) == 2 + 4 * 7 + 5 + 1      # and what the feeder keeps
    assert findings["hood motor, limit switch"].says.startswith("reported as open")
    assert findings["hood, switch and encoder"].says == "the encoder reads 28.6 deg, the limit switch at 15 deg is open"
    assert findings["flywheel motor 1, firmware"].says == "firmware 0.6.10"
    assert findings["hood motor, watchdog"].says == "0.1 s"


def test_without_table_or_anybody_it_says_so_and_revisions_matter_less():
    findings = Bench().findings()
    assert levels(findings, FAILURE) == set()
    assert levels(findings, WARNING) == {"settings of flywheel motor 1, flywheel motor 2, hood motor, feeder motor"}
    findings = Bench(faults={name: fault(UNPLUGGED) for name in (*NAMES, "hood_encoder")}).findings()
    assert findings["bitrate"].level == FAILURE and "nothing at all" in findings["bitrate"].says
    assert Bench({"feeder": replace(SETTINGS["feeder"], firmware=(0, 6, 11))}).findings()[
        "feeder motor, firmware"].level == OK


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
@pytest.mark.parametrize("has_table", [False, True])
def test_answers_of_a_serial_adapter_make_no_feedback_late(endpoints, has_table):
    findings = Bench(is_serial=True).findings(endpoints if has_table else None)
    assert findings["feedback"].level == OK and int(findings["feedback"].says.split()[2]) <= 15, findings["feedback"]
    assert levels(findings, FAILURE) == set()


@pytest.mark.parametrize(("device", "name"), [("flywheel_b", "flywheel motor 2"), ("hood", "hood motor"),
                                              ("feeder", "feeder motor")])
def test_a_silent_axis_is_named_and_no_other(endpoints, device, name):
    findings = Bench(faults={device: fault(UNPLUGGED)}).findings(endpoints)
    assert levels(findings, FAILURE) == {f"{name}, firmware", f"{name}, status rates", f"{name}, errors"}
    assert "silent" in findings[f"{name}, status rates"].says and "power" in findings[f"{name}, status rates"].do


def test_what_is_wrong_with_the_hood_encoder_is_named(endpoints):
    findings = Bench(faults={"hood_encoder": fault(SILENT)}).findings(endpoints)
    assert levels(findings, FAILURE) == {"hood encoder"} and "device 5 is silent" in findings["hood encoder"].says
    bench = Bench()
    bench.nodes["hood_encoder"].magnet_ok = False
    findings = bench.findings(endpoints)
    assert levels(findings, FAILURE) == {"hood encoder"} and "magnet" in findings["hood encoder"].says
    bench = Bench(more=(CanandmagNode(CONFIG.hood_encoder.device, SpinningPlant(), 40.0, 1),))
    finding = bench.findings()["hood encoder"]
    assert finding.level == FAILURE and "two devices have number 5" in finding.says


@pytest.mark.parametrize(("firmware", "level"), [((0, 5, 6), FAILURE), ((0, 7, 0), FAILURE), ((0, 6, 11), WARNING)])
def test_the_wrong_firmware(firmware, level):
    settings = replace(SETTINGS["hood"], firmware=firmware)
    findings = Bench({"hood": settings}).findings()
    assert findings["hood motor, firmware"].level == level
    assert ".".join(map(str, firmware)) in findings["hood motor, firmware"].says


@pytest.mark.parametrize(("changes", "level", "words"), [
    ({"encoder_ms": 20}, FAILURE, "Get_Encoder_Estimates 50/s instead of 100/s"),
    ({"heartbeat_ms": 0}, FAILURE, "Heartbeat 0/s instead of 10/s"),
    ({"current_ms": 0}, WARNING, "Get_Iq 0/s instead of 100/s"),
    ({"bus_ms": 0}, WARNING, "Get_Bus_Voltage_Current 0/s instead of 10/s"),
    ({"encoder_ms": 5}, OK, "Get_Encoder_Estimates 200/s")])
def test_status_rates(changes, level, words):
    finding = Bench({"flywheel_a": replace(OdriveSettings(), **changes)}).findings()["flywheel motor 1, status rates"]
    assert finding.level == level and words in finding.says
    assert (finding.do == "") == (level == OK)


def test_torn_frames_standing_errors_and_a_mute_switch_are_told():
    finding = Bench(faults={"flywheel_a": fault(TRUNCATED, 0x29, 4)}).findings()["flywheel motor 1, errors"]
    assert finding.level == FAILURE and "0x029" in finding.says
    bench = Bench()
    bench.nodes["feeder"].errors = 0x2000
    finding = bench.findings()["feeder motor, errors"]
    assert finding.level == WARNING and "motor too hot" in finding.says
    bench = Bench(wrap=lambda name, node: Spoilt(node, lambda frame: frame._replace(arbitration_id=0x7FE)
                                                 if frame.arbitration_id == 0x65 else frame))
    finding = bench.findings()["hood motor, limit switch"]
    assert finding.level == FAILURE and "596" in finding.says


def test_two_devices_with_one_number():
    twin = OdriveNode(CONFIG.axes.feeder, "feeder", SpinningPlant(), replace(SETTINGS["feeder"], serial=0xABC))
    findings = Bench(more=(twin,)).findings()
    finding = findings["feeder motor, firmware"]
    assert finding.level == FAILURE and "2 devices answer as node 4" in finding.says
    assert "000000000ABC, 385F324D3037" in finding.says
    assert levels(findings, FAILURE) == {"feeder motor, firmware", "device numbers"}
    assert "0x081 20/s instead of 10/s" in findings["device numbers"].says


class Spoilt:
    """A device whose frames go through `spoil` on their way, and come `late_ns` later, or those that `is_late` says."""

    def __init__(self, node, spoil=lambda frame: frame, late_ns=0, is_late=lambda frame: True):
        self.node, self.motor, self._spoil, self._late_ns, self._queue = node, node.motor, spoil, late_ns, []
        self._is_late = is_late

    def __getattr__(self, name):
        return getattr(self.node, name)

    def due_ns(self):
        return min([self.node.due_ns(), *(due_ns for due_ns, _ in self._queue[:1])])

    def receive(self, frame, t_ns):
        return self._pass_on(self.node.receive(frame, t_ns), t_ns)

    def step(self, t_ns):
        return self._pass_on(self.node.step(t_ns), t_ns)

    def _pass_on(self, frames, t_ns):
        self._queue += [(t_ns + self._late_ns * self._is_late(frame), self._spoil(frame)) for frame in frames]
        self._queue.sort(key=lambda one: one[0])
        due = [frame for due_ns, frame in self._queue if due_ns <= t_ns]
        self._queue = [one for one in self._queue if one[0] > t_ns]
        return due


def swap(frame):
    """Its two 32-bit floats with their bytes the other way round."""
    estimates = frame.arbitration_id & 0x1F == 0x09 and not frame.is_remote
    return frame._replace(data=frame.data[3::-1] + frame.data[:3:-1]) if estimates else frame


@pytest.mark.parametrize("position_rad", [1.234, -0.37, 6.283185307, 3e4, 1e-3])
def test_estimates_that_are_big_endian_are_named(position_rad):
    bench = Bench(wrap=lambda name, node: Spoilt(node, swap) if name == "flywheel_a" else node)
    bench.plant.position_rad.update(flywheel_a=position_rad, flywheel_b=position_rad)
    findings = bench.findings()
    finding = findings["flywheel motor 1, estimates"]
    assert finding.level == FAILURE and "big-endian" in finding.says
    assert findings["flywheel motor 2, estimates"].level == OK


def test_a_speed_without_motion_and_a_wheel_that_turns():
    def fast(frame):
        return frame._replace(data=frame.data[:4] + struct.pack("<f", 50.0)) if frame.arbitration_id == 0x29 else frame

    bench = Bench(wrap=lambda name, node: Spoilt(node, fast))
    bench.plant.velocity_rad_s["feeder"] = 30.0
    findings = bench.findings()
    assert findings["flywheel motor 1, estimates"].level == FAILURE
    assert "encoder stuck" in findings["flywheel motor 1, estimates"].says
    finding = findings["feeder motor, estimates"]
    assert finding.level == WARNING and "30 rad/s" in finding.says


@pytest.mark.parametrize(("late_ms", "level"), [(0, OK), (30, OK), (60, FAILURE), (200, FAILURE), (500, FAILURE),
                                                (520, FAILURE)])
def test_feedback_that_comes_late_is_a_failure(late_ms, level):
    bench = Bench(wrap=lambda name, node: Spoilt(node, late_ns=late_ms * 1_000_000) if name == "flywheel_b" else node)
    finding = bench.findings()["feedback"]
    assert finding.level == level
    if late_ms:
        assert ("flywheel motor 2" in finding.says) == (level == FAILURE)
    if late_ms in (60, 200):          # asked again after a quarter of the second, so longer ones are told shorter
        told_ms = float(finding.says.split("flywheel motor 2 ")[1].split(" ms")[0])
        assert late_ms <= told_ms <= late_ms + 15


@pytest.mark.parametrize(("late_ms", "level"), [(30, OK), (60, FAILURE), (200, FAILURE)])
def test_a_hood_encoder_that_comes_late_is_a_failure_at_rest(late_ms, level):
    bench = Bench(wrap=lambda name, node: Spoilt(node, late_ns=late_ms * 1_000_000, is_late=lambda frame: True)
                  if name == "hood_encoder" else node)
    finding = bench.findings()["feedback"]
    assert finding.level == level and (f"hood encoder {late_ms} ms" in finding.says) == (level == FAILURE)


@pytest.mark.parametrize(("hood_deg", "closed", "level", "words"), [
    (40.0, True, FAILURE, "40.0 deg, the limit switch at 15 deg is closed"), (15.2, True, OK, "closed"),
    (10.0, False, FAILURE, "travel is 15 to 75"), (80.0, False, FAILURE, "travel"), (74.0, False, OK, "open")])
def test_switch_and_encoder_of_a_hood_at_rest(hood_deg, closed, level, words):
    bench = Bench()
    bench.plant.hood_rad, bench.plant.limit = math.radians(hood_deg), closed
    finding = bench.findings()["hood, switch and encoder"]
    assert finding.level == level and words in finding.says


@pytest.mark.parametrize(("changes", "check", "level", "words"), [
    ({"watchdog": False}, "watchdog", FAILURE, "go on turning"),
    ({"timeout_s": 5.0}, "watchdog", FAILURE, "waits 5 s"),
    ({"timeout_s": 0.01}, "watchdog", FAILURE, "waits 0.01 s"),
    ({"timeout_s": float("nan")}, "watchdog", FAILURE, "waits nan s"),
    ({"bandwidth": 100.0}, "encoder filter", WARNING, "lags by 10 ms"),
    ({"bandwidth": float("nan")}, "encoder filter", WARNING, "does not answer")])
def test_settings_inside_an_axis(endpoints, changes, check, level, words):
    settings = replace(OdriveSettings(), parameters=inside(**changes))
    finding = Bench({"flywheel_b": settings}).findings(endpoints)[f"flywheel motor 2, {check}"]
    assert finding.level == level and words in finding.says and finding.do


def test_tables_of_another_firmware_or_axis_are_told(endpoints):
    findings = Bench({"flywheel_b": OdriveSettings()}).findings(endpoints)
    assert levels(findings, WARNING) == {"flywheel motor 2, watchdog", "flywheel motor 2, encoder filter"}
    findings = Bench().findings(replace(endpoints, firmware="0.6.9"))
    assert "hood motor, parameter numbers" in levels(findings, FAILURE)
    ids = dict(endpoints.ids) | {"axis0.min_endstop.endstop_state": 600, "vbus_voltage": 596}
    finding = Bench().findings(replace(endpoints, ids=ids))["hood motor, parameter numbers"]
    assert finding.level == FAILURE and "596 is vbus_voltage" in finding.says
    assert "600 = axis0.min_endstop.endstop_state" in finding.do


@pytest.mark.parametrize("text", ["", "[]", '{"endpoints": {}}', '{"fw_version": "0.6.10", "endpoints": {"a": 3}}',
                                  '{"fw_version": "0.6.10", "endpoints": {}}'])
def test_a_table_that_is_none_is_named(tmp_path, text):
    path = tmp_path / "table.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"table\.json"):
        load_endpoints(path)


@pytest.mark.data
def test_a_locked_spark_is_told_by_the_makers_own_table(data_dir):
    """Against REV's published table of frames, not ours."""
    table = cantools.database.load_file(data_dir / "dbc" / "rev_spark_2.1.0_generated.dbc", strict=False)
    message = table.get_message_by_name("STATUS_0")
    lock = next(signal.name for signal in message.signals if "HEARTBEAT_LOCK" in signal.name.upper())
    for value in (0, 1):
        signals = {signal.name: 1 if signal.name != lock else value for signal in message.signals
                   if signal.length == 1} | {signal.name: 0 for signal in message.signals if signal.length > 1}
        frame = Frame(0, message.frame_id + 7, message.encode(signals, scaling=False), is_extended=True)
        assert locked_spark(frame) == (7 if value else None)
    bench = Bench()
    bench.more = [frame]
    finding = bench.findings()["heartbeat lock"]
    assert finding.level == FAILURE and "SPARK 7" in finding.says and "power off" in finding.do


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
            node = SparkNode(axis, MOTORS[name], PLANT, mine, PLANT.hood_at_limit if axis.has_endstop else None)
            nodes.append(FaultyNode(node, faults) if name == "hood motor" else node)
    return nodes


@pytest.mark.parametrize(("fault", "settings", "check", "level", "words"), [
    (Fault(UNPLUGGED, 0, ALWAYS), None, "firmware", FAILURE, "device 3 does not answer"),
    (Fault(SILENT, 0, ALWAYS), None, "status", FAILURE, "device 3 is silent"),
    (None, SparkSettings(firmware=(24, 0, 1)), "firmware", FAILURE, "24.0.1"),
    (None, SparkSettings(firmware=(27, 0, 0)), "firmware", FAILURE, "27.0.0"),
    (Fault(TRUNCATED, 0, ALWAYS, frame_id=0x0205B803, length=3), None, "status", FAILURE, "impossible values"),
    (Fault(TRUNCATED, 0, ALWAYS, frame_id=0x02052603, length=1), None, "firmware", FAILURE, "unreadable answer")])
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
        0, spark.frame_id(spark.SparkAxis(3, 1, False), "STATUS_0"), bytes([0] * 6 + [0x20, 0]), is_extended=True)
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
