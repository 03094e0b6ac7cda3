"""Drivers are config lines: what the rig and the gate make of each, on hand-made wires."""

import io
import math
import re
import struct
import tomllib
from pathlib import Path

import can
import msgspec
import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, SPARK_WHEELS, only_advice
from tests.robot.test_rig import ASKED, Blind, Stream, Time, Wire
from truearc.errors import InputError
from truearc.hw import fault_codes as hw
from truearc.hw.devices.advisory.family import AdvisoryConfig
from truearc.hw.devices.axis import Axis, Bounds
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.family import SparkConfig
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config, read_axis
from truearc.robot.estimate import estimate
from truearc.robot.gate.verdict import judge
from truearc.robot.motors import bound_axes, make_motors, name_axes
from truearc.robot.reasons import IMAGE_DARK, MOTOR_ERROR, MOTOR_NOT_DRIVEN, text
from truearc.robot.recording.files import candump_line
from truearc.robot.rig import HardwareRig
from truearc.robot.types import Command, Sent, Sighting
from truearc.robot.vision_source import InlineEyes

MS = 1_000_000
STATUS_0, STATUS_1, STATUS_2 = 0x0205B800, 0x0205B840, 0x0205B880


class Bench:
    """A rig whose SPARKs are answered for by hand."""

    def __init__(self, config: Config) -> None:
        self.bus, self.clock = Wire(), Time()
        eyes = InlineEyes(Blind(), lambda frame: Sighting(frame.t_ns, False, IMAGE_DARK()))
        self.rig = HardwareRig(config, self.bus, Stream(), eyes, self.clock, lambda: False)

    def hear(self, base: int, device: int, data: bytes) -> None:
        self.bus.frames.append(Frame(self.clock.t_ns, base + device, data, True))

    def tick(self, command: Command, *devices: int, major: int = 26, status_0: bytes = b"") -> Sent:
        """One tick in which every device has said all that it can, and answers what it was asked in the last."""
        asked, self.bus.sent = self.bus.sent, []
        for frame in asked:
            base, device = frame.arbitration_id & ~0x3F, frame.arbitration_id & 0x3F
            if frame.is_remote:
                self.hear(base, device, bytes([major, 0, 0, 0, 0, 0, 0, 0]))
            elif base == 0x02050400:
                self.hear(base + 0x40, device, bytes([0, 7, 0, 7, 0]))
            elif base == 0x02053800:
                self.hear(base + 0x40, device, frame.data[:1] + b"\x02" + frame.data[1:] + b"\x00")
        for device in devices:
            self.hear(STATUS_0, device, status_0 or struct.pack("<HH4B", 0, 1638, 0, 25, 0, 0))     # 12.0 V
            self.hear(STATUS_1, device, bytes(8))
            self.hear(STATUS_2, device, bytes(8))
        self.inputs = self.rig.read()
        return self.rig.write(command)


def test_what_a_spark_was_sent_is_recorded_beside_its_torque() -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(5):
        sent = bench.tick(ASKED, 3)
    hood = sent.duties[2]
    assert sent.duties == (None, None, hood, None) and hood == pytest.approx(-0.02 / 2.6, rel=2e-3)
    assert sent.hood_torque_nm == pytest.approx(-0.02) and sent.flywheel_torque_nm == 0.1
    duty = [frame for frame in bench.bus.sent if frame.arbitration_id == 0x02050083]
    assert all(struct.unpack("<fI", frame.data)[0] == pytest.approx(hood) for frame in duty)


def test_until_a_spark_is_set_up_nothing_is_said_to_be_sent() -> None:
    bench = Bench(ALL_SPARK)
    sent = bench.tick(ASKED, 3, 11, 12, 14)
    assert sent == Sent(True, True, True, 0.0, 0.0, 0.0) and isinstance(sent.duties, msgspec.UnsetType)
    assert b"duties" not in msgspec.json.encode(sent)
    for _ in range(5):
        sent = bench.tick(ASKED, 3, 11, 12, 14)
    assert sent.flywheel_torque_nm == pytest.approx(0.1) and None not in sent.duties


def test_ticks_with_and_without_duties_are_read_as_they_were_written() -> None:
    driven = Sent(True, True, True, 0.1, 0.2, 0.3, 1)
    for sent in (driven, replace(driven, refused=0, duties=(None, None, 0.25, None))):
        assert msgspec.json.decode(msgspec.json.encode(sent), type=Sent) == sent


def verdict_of(config: Config, inputs) -> tuple[Reason, ...]:
    memory = good_memory()
    return judge(inputs, estimate(inputs, memory, config), memory.aim, memory, config, None).reasons


def with_hood(bench: Bench):
    """A tick in which all is well, except the bench's hood motor and the rig's faults."""
    inputs, good = bench.inputs, good_inputs()
    hood = replace(inputs.hood_motor, t_ns=good.t_ns, heartbeat_t_ns=good.t_ns, errors_t_ns=good.t_ns,
                   velocity_rad_s=0.0, position_rad=good.hood_motor.position_rad)
    faults = tuple(fault for fault in inputs.faults if not fault.code.startswith("box_"))
    return replace(good, hood_motor=hood, faults=faults)


def test_a_spark_that_is_driven_may_fire() -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(5):
        bench.tick(ASKED, 3)
    assert bench.inputs.hood_motor.axis_state == spark.DRIVEN
    inputs = with_hood(bench)
    assert verdict_of(SPARK_HOOD, inputs) == ()
    for state in (spark.UNKNOWN, spark.IDLE):
        released = replace(inputs, hood_motor=replace(inputs.hood_motor, axis_state=state))
        assert verdict_of(SPARK_HOOD, released)[0] == MOTOR_NOT_DRIVEN(motor="hood motor", state=state)


@pytest.mark.parametrize(("spoilt", "reason"), [
    ({"major": 24}, "hood motor: spark 3 runs firmware 24.0.0, expected 25 to 26: update it"),
    ({"status_0": struct.pack("<HH4B", 0, 1638, 0, 25, 0x20, 0)}, "hood motor: locked to a competition controller"),
])
def test_what_it_refuses_is_a_hold_that_says_so_and_nothing_is_driven(spoilt, reason: str) -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(50):
        sent = bench.tick(ASKED, 3, **spoilt)
        assert not [frame for frame in bench.bus.sent if frame.arbitration_id in (0x02050083, 0x02052C80)]
    assert any(text(one).startswith(reason) for one in verdict_of(SPARK_HOOD, with_hood(bench)))
    assert sent.hood_torque_nm == 0.0 and isinstance(sent.duties, msgspec.UnsetType)


@pytest.mark.parametrize("listens_to", ["odrive", "spark"])
def test_advice_is_silent_on_the_bus_whatever_is_commanded(listens_to: str) -> None:
    bench = Bench(only_advice(listens_to))
    for number in range(200):
        sent = bench.tick(Command(*[number % 3 > 0] * 3, 1.0, -0.3, 0.2), 3, 11, 12, 14)
        assert sent == Sent(*[number % 3 > 0] * 3, 0.0, 0.0, 0.0)
        assert bench.bus.sent == []
    bench.rig.release()
    assert bench.bus.sent == []


def test_advice_fires_on_what_another_controller_does() -> None:
    config = only_advice("spark")
    inputs = good_inputs()
    motors = [replace(motor, axis_state=0, axis_error=spark.LOCKED | spark.HAS_RESET)
              for motor in (*inputs.flywheels, inputs.hood_motor, inputs.feeder)]
    inputs = replace(inputs, flywheels=tuple(motors[:2]), hood_motor=motors[2], feeder=motors[3])
    assert verdict_of(config, inputs) == ()
    hot = replace(inputs, feeder=replace(inputs.feeder, axis_error=0x10))
    assert verdict_of(config, hot) == (MOTOR_ERROR(motor="feeder motor", errors=(hw.ERROR_OVER_TEMPERATURE(),)),)
    idle = replace(inputs, feeder=replace(inputs.feeder, axis_state=1, axis_error=0))
    assert verdict_of(only_advice("odrive"), idle)[-1] == MOTOR_NOT_DRIVEN(motor="feeder motor", state=1)


def test_two_axes_on_one_device_are_named() -> None:
    wrong = replace(CONFIG, axes=replace(CONFIG.axes, feeder=replace(CONFIG.axes.feeder, node=3)))
    with pytest.raises(InputError, match="hood motor and feeder motor are the same device"):
        make_motors(wrong)
    heard = only_advice("spark").axes.hood
    with pytest.raises(InputError, match="hood motor and feeder motor"):
        make_motors(replace(SPARK_HOOD, axes=replace(SPARK_HOOD.axes, feeder=heard)))
    assert len(make_motors(SPARK_WHEELS)) == 4             # node 3 and device 3 would be two things


def test_axes_are_named_in_the_inputs_order() -> None:
    assert [name for name, _ in name_axes(CONFIG)] == ["flywheel motor 1", "flywheel motor 2", "hood motor",
                                                       "feeder motor"]


def test_the_lines_in_the_manual_are_taken() -> None:
    manual = (Path(__file__).parents[2] / "docs" / "how-to" / "motors.md").read_text(encoding="utf-8")
    axes = tomllib.loads(re.search(r"```toml\n(.*?)```", manual, re.DOTALL)[1])["axes"]
    taken = [read_axis(Axis, lines) for lines in (axes["feeder"], axes["hood"], axes["flywheels"][0])]
    assert [type(axis) for axis in taken] == [OdriveConfig, SparkConfig, AdvisoryConfig]


def test_a_question_is_logged_with_the_length_of_its_answer() -> None:
    line = candump_line(spark.make_version_query(spark.SparkAxis(3, 1)), True, 1_500_000_000)
    assert line == "(1.500000) can0 02052603#R8 T\n"
    message, = can.CanutilsLogReader(io.StringIO(line))
    assert (message.arbitration_id, message.is_remote_frame, message.dlc) == (0x02052603, True, 8)


def test_an_axis_is_bounded_by_what_the_rest_of_the_configuration_asks_of_it() -> None:
    """Of the hood: 20 deg/s where its lever is longest, 0.25 m, and half as much again, at which its interlock acts."""
    left, right, hood, feeder = bound_axes(CONFIG)
    assert left == right == Bounds(594.0, 1.2, False) and feeder == Bounds(None, 0.2, None)
    lever_rad_s = math.tau * math.radians(20.0) * 0.25 / 0.005
    assert hood.top_rad_s == pytest.approx(1.5 * max(lever_rad_s, CONFIG.identify.hood.top_rad_s), rel=2e-3)
    assert (hood.top_nm, hood.brakes) == (0.3, True)
    slow = bound_axes(replace(CONFIG, identify=None))[2]
    assert slow.top_rad_s == pytest.approx(1.5 * lever_rad_s, rel=2e-2)


@pytest.mark.parametrize("torque_nm_a", [1e-9, 1e-300, 10.0])
def test_limits_that_no_frame_can_say_are_none_and_no_error(torque_nm_a: float) -> None:
    flywheels = tuple(replace(axis, torque_nm_a=torque_nm_a) for axis in CONFIG.axes.flywheels)
    hood = replace(CONFIG.hood, screw_lead_m=1e-8)
    assert len(make_motors(replace(CONFIG, hood=hood, axes=replace(CONFIG.axes, flywheels=flywheels)))) == 4
    wheels = tuple(replace(axis, torque_nm_a=torque_nm_a) for axis in SPARK_WHEELS.axes.flywheels)
    assert len(make_motors(replace(SPARK_WHEELS, axes=replace(SPARK_WHEELS.axes, flywheels=wheels)))) == 4
