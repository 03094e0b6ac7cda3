"""Frames that the configuration allows on the bus, against numbers worked out by hand from the devices' documents."""

from collections import Counter

import pytest
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG
from tests.robot.sparks import SPARK_HOOD, SPARK_WHEELS, only_advice
from tests.robot.test_rig import Blind, Stream, Time, Wire
from truearc.hw.bus_rules import Allowed
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.fault_codes import DUPLICATE_ID, FOREIGN_HOST, FRAME_RATE_EXCEEDED
from truearc.hw.protocols import Frame
from truearc.robot.config.schema import Config
from truearc.robot.motors import guard, make_rules
from truearc.robot.reasons import IMAGE_DARK
from truearc.robot.rig import HardwareRig
from truearc.robot.types import Command, Sighting
from truearc.robot.vision_source import InlineEyes

# ODrive CANSimple: node << 5 | command; the hood, node 3, has a limit switch to ask for, command 0x04
ADDRESS = 0x06                        # with a serial number: two devices with one id give two
ESTOP, AXIS_STATE, CONTROLLER_MODE, TORQUE, LIMITS, CLEAR_ERRORS = 0x02, 0x07, 0x0B, 0x0E, 0x0F, 0x18
COMMANDS = (ESTOP, AXIS_STATE, CONTROLLER_MODE, TORQUE, CLEAR_ERRORS)
ENCODER_SETTING, ENCODER_ASKED = 0x070E00C0 + 5, 0x070E0080 + 5


def allowed_of(config: Config) -> list[Allowed]:
    return [kind for one in make_rules(config) for kind in one.allowed]


def limits_of(config: Config) -> dict[tuple[int, bool, bool, int], int]:
    return {(kind.arbitration_id, kind.is_extended, kind.is_remote, kind.length): kind.most
            for kind in allowed_of(config)}


@pytest.fixture
def bench():
    wire, clock, tally = Wire(), Time(), Counter()
    return wire, clock, tally, guard(wire, CONFIG, clock, tally)


def test_exactly_these_frames_may_be_sent() -> None:
    kinds = {(kind.arbitration_id, kind.is_extended, kind.is_remote) for kind in allowed_of(CONFIG)}
    expected = {(node << 5 | command, False, False) for node in (1, 2, 3, 4) for command in COMMANDS}
    expected |= {(node << 5 | asked, False, True) for node in (1, 2, 3, 4) for asked in (0, ADDRESS)}
    expected |= {(node << 5 | LIMITS, False, False) for node in (1, 2, 3)}      # the feeder's are not known
    assert kinds == expected | {(3 << 5 | 0x04, False, False), (ENCODER_SETTING, True, False),
                                (ENCODER_ASKED, True, False)}


def test_each_by_its_length_and_how_often() -> None:
    """A set point 31 times in 0.1 s: at 200 Hz 20 are due, half as many again may come early, and one begins."""
    commands = {ESTOP: (0, 5), AXIS_STATE: (8, 31), CONTROLLER_MODE: (8, 5), TORQUE: (8, 31), CLEAR_ERRORS: (1, 5)}
    expected = {(node << 5 | command, False, False, length): most for node in (1, 2, 3, 4)
                for command, (length, most) in commands.items()}
    expected |= {(node << 5 | asked, False, True, 0): 5 for node in (1, 2, 3, 4) for asked in (0, ADDRESS)}
    expected |= {(node << 5 | LIMITS, False, False, 8): 5 for node in (1, 2, 3)}
    assert limits_of(CONFIG) == expected | {(3 << 5 | 0x04, False, False, 8): 5, (ENCODER_SETTING, True, False, 8): 5,
                                            (ENCODER_ASKED, True, False, 8): 5}


def test_a_set_point_a_tick_and_not_many_more(bench) -> None:
    most = {kind.most for kind in allowed_of(CONFIG) if kind.arbitration_id == 1 << 5 | 0x0E}
    per_window = CONFIG.tick_hz / 10
    assert len(most) == 1 and per_window < most.pop() <= 2 * per_window


def test_another_tick_rate_gives_another_limit() -> None:
    fast = allowed_of(replace(CONFIG, tick_hz=2 * CONFIG.tick_hz))
    assert max(kind.most for kind in fast) > 1.8 * max(kind.most for kind in allowed_of(CONFIG))


def test_what_a_rig_sends_is_allowed_whatever_it_is_asked(bench) -> None:
    wire, clock, tally, bus = bench
    eyes = InlineEyes(Blind(), lambda frame: Sighting(frame.t_ns, False, IMAGE_DARK()))
    rig = HardwareRig(CONFIG, bus, Stream(), eyes, clock, lambda: False)
    for tick in range(1000):
        rig.read()
        rig.write(Command(*[tick // 50 % 2 == 0] * 3, 0.001 * tick, -0.0001 * tick, 0.1))
    rig.release()
    assert not tally and len(wire.sent) > 2000


def test_a_loop_gone_wild_is_cut_off(bench) -> None:
    wire, clock, tally, bus = bench
    torque = odrive.make_torque(odrive.OdriveAxis(1, 1), 1.2)
    for _ in range(1000):
        bus.write(torque)
        clock.t_ns += 100_000
    assert len(wire.sent) <= 2 * CONFIG.tick_hz / 10 and tally["frames not allowed"] == 1000 - len(wire.sent)
    assert any(fault.code == FRAME_RATE_EXCEEDED.name and fault.params["frame"] == "0x02e" for fault in bus.faults())


@pytest.mark.parametrize("frame", [
    Frame(0, 5 << 5 | 0x0E, bytes(8)),            # an axis that the configuration does not have
    Frame(0, 1 << 5 | 0x0D, bytes(8)),            # a speed rather than a torque: the device would run its own loop
    Frame(0, 4 << 5 | 0x0F, bytes(8)),            # limits of an axis of which they are not known
    Frame(0, 0x000, bytes(8)), Frame(0, 1 << 5 | 0x0E, bytes(3)), Frame(0, 1 << 5 | 0x0E, bytes(8), True)])
def test_what_the_configuration_has_no_use_for_is_never_sent(bench, frame: Frame) -> None:
    wire, _, tally, bus = bench
    assert not bus.write(frame) and wire.sent == [] and tally == {"frames not allowed": 1}


@pytest.mark.parametrize("command", [0x02, 0x04, 0x07, 0x0B, 0x0D, 0x0E, 0x0F, 0x18])
def test_another_host_that_commands_our_axes_is_told(bench, command: int) -> None:
    wire, _, _, bus = bench
    wire.frames = [Frame(1_000_000_000, 2 << 5 | command, bytes(8))]
    bus.read()
    assert bus.faults() == [FOREIGN_HOST(frame=f"0x{2 << 5 | command:03x}")]


def test_another_host_is_a_fault_of_the_very_tick_that_hears_it(bench) -> None:
    wire, clock, _, bus = bench
    rig = HardwareRig(CONFIG, bus, Stream(), InlineEyes(Blind(), lambda frame: Sighting(0, False, IMAGE_DARK())), clock,
                      lambda: False)
    wire.frames = [Frame(clock.t_ns, 0x2E, bytes(8))]
    assert FOREIGN_HOST.name in codes(rig.read().faults)


def test_nothing_that_devices_send_is_ours_and_their_pulses_are_theirs() -> None:
    devices, host = ({kind for one in make_rules(CONFIG) for kind in part(one)} for part in (
        lambda one: one.by_device, lambda one: one.by_host))
    assert devices and host and not devices & host
    pulses = {kind: period for one in make_rules(CONFIG) for kind, period in one.pulse.items()}
    assert set(pulses) <= devices
    assert pulses[1 << 5 | 0x01, False, False] == 100_000_000
    assert pulses[0x070E07C0 + 5, True, False] == CONFIG.hood_encoder.period_ms * 1_000_000


def test_a_spark_may_be_sent_what_its_driver_sends_and_no_speed() -> None:
    """By the ids of REV's table: duty, heartbeat of all, parameters, status frames, faults, and who it is."""
    kinds = {(kind.arbitration_id, kind.is_remote) for kind in allowed_of(SPARK_HOOD)
             if kind.is_extended and kind.arbitration_id >> 16 == 0x0205}
    assert kinds == {(0x02050083, False), (0x02052C80, False), (0x02053803, False), (0x02050403, False),
                     (0x02051B83, False), (0x02052603, True)}


def test_a_spark_by_length_and_how_often() -> None:
    """Each setting that there is may be said twice."""
    limits = limits_of(SPARK_HOOD)
    assert {key: most for key, most in limits.items() if key[0] >> 16 == 0x0205} == {
        (0x02050083, True, False, 8): 31, (0x02052C80, True, False, 8): 31, (0x02053803, True, False, 5): 22,
        (0x02050403, True, False, 4): 5, (0x02051B83, True, False, 0): 5, (0x02052603, True, True, 8): 5}
    assert limits_of(SPARK_WHEELS)[0x0205380B, True, False, 5] == 22


SPARK_SENDS = (0x0205BC03, 0x0205B803, 0x0205B843, 0x0205B883, 0x0205B943, 0x0205B983, 0x02050443, 0x02052603,
               0x02053843)
SPARK_IS_SENT = (0x02050003, 0x02050083, 0x02050403, 0x02051B83, 0x02053803, 0x02052C80)
ODRIVE_SENDS = tuple(3 << 5 | command for command in (0x00, 0x01, 0x03, 0x05, ADDRESS, 0x09, 0x14, 0x15, 0x17))
ODRIVE_IS_SENT = tuple(3 << 5 | command for command in (0x02, 0x04, 0x07, 0x0B, 0x0D, 0x0E, 0x0F, 0x18))
ENCODER_SENDS, ENCODER_IS_SENT = (0x070E07C5, 0x070E0785, 0x070E0185, 0x070E0105), (0x070E0145, 0x070E00C5, 0x070E0085)


@pytest.mark.parametrize(("config", "sends", "is_sent", "pulse"), [
    (CONFIG, ODRIVE_SENDS, ODRIVE_IS_SENT, {(3 << 5 | 0x01, False, False): 100_000_000}),
    (only_advice("odrive"), ODRIVE_SENDS, ODRIVE_IS_SENT, {(3 << 5 | 0x01, False, False): 100_000_000}),
    (SPARK_HOOD, SPARK_SENDS, SPARK_IS_SENT, {(0x0205B803, True, False): 10_000_000}),
    (only_advice("spark"), SPARK_SENDS, SPARK_IS_SENT, {(0x0205B803, True, False): 10_000_000}),
])
def test_whose_frames_they_are(config, sends, is_sent, pulse) -> None:
    """Of the hood's axis, and of its encoder; by the tables of their makers."""
    encoder, hood = make_rules(config)[0], make_rules(config)[3]
    extended = sends is SPARK_SENDS
    assert set(hood.by_device) == {(frame_id, extended, False) for frame_id in sends}
    assert set(hood.by_host) == {(frame_id, extended, False) for frame_id in is_sent}
    assert hood.pulse == pulse
    assert set(encoder.by_device) == {(frame_id, True, False) for frame_id in ENCODER_SENDS}
    assert set(encoder.by_host) == {(frame_id, True, False) for frame_id in ENCODER_IS_SENT}
    advised = not hood.allowed
    assert encoder.pulse == ({(0x070E0185, True, False): 100_000_000} if advised else {
        (ENCODER_SENDS[0], True, False): 10_000_000})
    assert bool(encoder.allowed) != advised


def test_what_devices_and_other_hosts_say_is_known_and_what_only_we_may_say_is_not() -> None:
    """Questions about our axes that another host asks are ours, too; unknown frames are counted without a fault."""
    wire, clock, tally = Wire(), Time(), Counter()
    bus = guard(wire, CONFIG, clock, tally)
    wire.frames = [Frame(clock.t_ns, 1 << 5 | 0x09, bytes(8)), Frame(clock.t_ns, 0x070E0185, bytes(8), True)]
    assert len(bus.read()) == 2 and bus.faults() == [] and not tally
    wire.frames = [Frame(clock.t_ns, 0x7FE, bytes(8)), Frame(clock.t_ns, 1 << 5, b"", is_remote=True)]
    bus.read()
    assert tally == {"unknown frames 0x7fe": 1, "frames of another host": 1}
    assert bus.faults() == [FOREIGN_HOST(frame="0x020")]


def test_two_axes_that_answer_to_one_id_are_told() -> None:
    wire, clock, tally = Wire(), Time(), Counter()
    bus = guard(wire, CONFIG, clock, tally)
    wire.frames = [Frame(clock.t_ns - at, 1 << 5 | 0x01, bytes(8)) for at in range(990_000_000, 0, -50_000_000)]
    bus.read()
    fault = bus.faults()[0]
    assert fault.code == DUPLICATE_ID.name and fault.params["frame"] == "0x021"


def test_an_axis_of_another_controller_may_be_sent_nothing_and_is_commanded_by_it() -> None:
    wire, clock, tally = Wire(), Time(), Counter()
    config = only_advice("odrive")
    bus = guard(wire, config, clock, tally)
    assert allowed_of(config) == []
    torque = odrive.make_torque(odrive.OdriveAxis(11, 1), 0.1)
    assert not bus.write(torque) and wire.sent == []
    wire.frames.append(torque._replace(t_ns=1))
    bus.faults()
    assert bus.read() and bus.faults() == [] and set(tally) == {"frames not allowed"}
