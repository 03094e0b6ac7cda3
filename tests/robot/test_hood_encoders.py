"""[hood_encoder] of every driver: its table, its frames, the doctor, homing, and how well its angle is known."""

import itertools
import math
from collections import Counter
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from tests.hw.spinning_plant import SpinningPlant, closed_after
from tests.robot.alike import codes
from tests.robot.encoders import COUNTING, NONE, NT4, ODRIVE, SPARK, SPARK_OWN
from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from truearc.cli.doctor_checks import look_at_bus
from truearc.errors import InputError
from truearc.hw.devices.family import FAILURE, OK
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.emulated.nodes import StepClock, Twin
from truearc.hw.protocols import MotorReading
from truearc.hw.real.can_bus import open_can
from truearc.robot import reasons as because
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import Config, config_hash, load_config, read_axis
from truearc.robot.motion import BLIND
from truearc.robot.motors import around_encoder, guard
from truearc.robot.tick import step
from truearc.robot.types import Count, Inputs, Memory
from truearc.sim.world.emulated_robot import make_nodes

ALL = {"canandmag": CONFIG, "none": NONE, "spark": SPARK, "spark-own": SPARK_OWN, "odrive": ODRIVE,
       "counting": COUNTING, "nt4": NT4}
SHIPPED = (Path(__file__).parents[2] / "robot" / "launcher.toml").read_text(encoding="utf-8")
BEGIN, END = SHIPPED.index("[hood_encoder]"), SHIPPED.index("[flywheel]")
CHANNELS = itertools.count()


def load(tmp_path: Path, table: str, sigma_deg: float = 0.6) -> Config:
    path = tmp_path / "launcher.toml"
    text = SHIPPED[:BEGIN] + "[hood_encoder]\n" + table + "\n" + SHIPPED[END:]
    path.write_text(text.replace("hood_deg = 0.2", f"hood_deg = {sigma_deg}"), encoding="utf-8")
    return load_config(path)


@pytest.mark.parametrize(("table", "config"), [
    ('driver = "none"', NONE),
    ('driver = "spark"\ndevice = 7\nperiod_ms = 10\nzero_deg = 40.0\ndirection = -1', SPARK),
    ('driver = "motor"\ngear = 2.0\nzero_deg = 33.0\n[hood_encoder.controller]\ndriver = "odrive"\nnode = 6\n'
     'direction = -1\nendstop_endpoint = 0', ODRIVE),
    ('driver = "nt4"\nkey = "/Hood/Rot"\nunit = "rev"\nzero_deg = 90.0\ndirection = -1\n'
     '[nt4]\nserver = "127.0.0.1:1"', NT4)])
def test_a_table_is_read_and_recorded(tmp_path: Path, table: str, config: Config) -> None:
    read = load(tmp_path, table)
    assert read == config
    again = msgspec.json.decode(msgspec.json.encode(read), type=Config, dec_hook=read_axis)
    assert again == read and config_hash(again) == config_hash(read) != config_hash(CONFIG)


@pytest.mark.parametrize(("table", "sigma_deg", "message"), [
    ('driver = "magnet"', 0.6, r":\d+: hood_encoder\.driver: 'magnet' is not known here; there are canandmag, spark, "
     "motor, none, nt4$"),
    ('driver = "none"\ndevice = 5', 0.6, r":\d+: hood_encoder\.device: unknown key$"),
    ('driver = "spark"\ndevice = 7', 0.6, "keys are missing: hood_encoder.period_ms, hood_encoder.zero_deg, "
     "hood_encoder.direction$"),
    ('driver = "motor"\ngear = 1.0\n[hood_encoder.controller]\ndriver = "odrive"\nnod = 6\ndirection = 1\n'
     'endstop_endpoint = 0', 0.6, r":\d+: hood_encoder\.controller\.nod: unknown key; did you mean node\?"),
    ('driver = "motor"\ngear = 1.0\n[hood_encoder.controller]\ndriver = "odrive"\nnode = 3\ndirection = 1\n'
     'endstop_endpoint = 0', 0.6, r"hood_encoder\.controller\.node: 3 is that of axes\.hood, too"),
    ('driver = "nt4"\nkey = "/a"\nunit = "deg"\nzero_deg = 0.0\ndirection = 1', 0.6,
     r"hood_encoder\.driver: 'nt4' needs \[nt4\]"),
    ('driver = "nt4"\nkey = "/a"\nunit = "grad"\nzero_deg = 0.0\ndirection = 1', 0.6,
     r":\d+: hood_encoder\.unit: 'grad' is not known"),
    ('driver = "none"', 0.2, r"rig\.noise\.hood_deg: 0\.2 is too small: hood_encoder\.driver 'none' knows the angle to "
     r"0\.5 deg at best")])
def test_a_wrong_table_is_refused_by_key(tmp_path: Path, table: str, sigma_deg: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load(tmp_path, table, sigma_deg)


class Bench:
    """All emulated devices of a configuration on a virtual bus behind the robot's own rules."""

    def __init__(self, config: Config) -> None:
        self.config, self.plant = config, SpinningPlant()
        self.nodes = make_nodes(config, self.plant)
        self.clock = StepClock(lambda t_ns: self.twin.advance(t_ns))
        channel = f"hood-{next(CHANNELS)}"
        self.near, self.far = (open_can("virtual", channel, 1_000_000, self.clock) for _ in range(2))
        self.twin = Twin(self.plant, self.far, tuple(self.nodes.values()))
        self.bus = guard(self.near, config, self.clock, Counter())

    def findings(self) -> list:
        found = look_at_bus(self.config, self.near, self.clock, None, None, 1.0)
        return [one for one in found if one.check.startswith("hood encoder")]

    def close(self) -> None:
        self.near.close()
        self.far.close()


bench = closed_after(Bench)


@pytest.mark.parametrize("name", ["canandmag", "spark", "spark-own", "odrive", "counting"])
def test_angles_come_over_the_bus_and_nothing_else_may_be_sent(bench, name: str) -> None:
    on = bench(ALL[name])
    table = on.config.hood_encoder
    encoder = encoder_family_of(table).make(table, around_encoder(CONFIG))
    keys, start_rad = set(encoder.ids()), on.plant.hood_rad
    seen = []
    for tick in range(200):
        on.clock.sleep_until_ns(tick * 5_000_000)
        on.plant.hood_rad = start_rad + 0.3 * (tick >= 100)
        for frame in on.bus.read():
            if (frame.arbitration_id, frame.is_extended) in keys:
                encoder.take(frame)
        encoder.faults(on.clock.now_ns())
        assert all(on.bus.write(frame) for frame in encoder.frames(on.clock.now_ns()))
        seen.append(encoder.read(on.clock.now_ns()))
        assert not on.bus.faults()
    assert not encoder.faults(on.clock.now_ns())
    before, after = seen[99], seen[-1]
    assert on.clock.now_ns() - after.t_ns <= 30_000_000 and after.magnet_ok     # a tick, and 10 ms for the round trip
    turned = (after.angle_rad - before.angle_rad + math.pi) % math.tau - math.pi
    assert turned * table.direction == pytest.approx(0.3, abs=0.004)
    if table.zero_deg is not None:
        zero = math.radians(table.zero_deg) + table.direction * (start_rad + 0.3)
        assert math.cos(after.angle_rad - zero) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("name", "says"), [
    ("canandmag", ["magnet in sight"]), ("none", ["there is none"]), ("spark", ["firmware 26.1.0", "once the robot"]),
    ("spark-own", ["firmware 26.1.0", "once the robot"]), ("odrive", ["firmware 0.6.10"])])
def test_the_doctor_says_how_it_is(bench, name: str, says: list[str]) -> None:
    findings = bench(ALL[name]).findings()
    assert not [one for one in findings if one.level == FAILURE and "watchdog" not in one.check]
    for one, words in zip(findings, says, strict=False):
        assert one.level == OK and words in one.says


def test_the_doctor_names_what_is_wrong_with_a_through_bore(bench) -> None:
    heard = replace(SPARK, hood_encoder=replace(SPARK.hood_encoder, period_ms=0))
    finding, = bench(heard).findings()
    assert finding.level == FAILURE and "device 7 does not report it" in finding.says
    on = bench(heard)
    on.nodes["hood_encoder"].absolute_rev = None
    on.nodes["hood_encoder"]._take_statuses({"mask": 0b1100000, "enabled": 0b1100000}, 0)
    finding, = on.findings()
    assert finding.level == FAILURE and "no signal" in finding.says
    silent = bench(SPARK)
    silent.nodes["hood_encoder"].settings = replace(silent.nodes["hood_encoder"].settings, firmware=(24, 0, 0))
    assert "firmware 24.0.0" in silent.findings()[0].says and silent.findings()[0].level == FAILURE


# --- no encoder: the count

def counted(inputs: Inputs, **changes: float) -> Memory:
    motor = inputs.hood_motor
    count = Count(motor.t_ns - 10_000_000, motor.position_rad, motor.velocity_rad_s)
    return replace(good_memory(), count=replace(count, **changes))


def without() -> Inputs:
    return replace(good_inputs(), hood_angle=None)


def closed_once(inputs: Inputs, memory: Memory, config: Config) -> Memory:
    """After the first answer that the switch is closed, which does not yet home it; the second comes 5 ms later."""
    motor = replace(inputs.hood_motor, endstop_t_ns=inputs.hood_motor.endstop_t_ns - 5_000_000)
    memory = step(replace(inputs, hood_motor=motor), memory, config, None).memory
    assert not memory.homed
    return memory


def test_one_wrong_answer_of_the_switch_homes_nothing() -> None:
    inputs, memory = without(), replace(counted(without()), homed=False)
    for closed in (True, False, True, False):
        motor = replace(inputs.hood_motor, endstop=closed, endstop_t_ns=NOW_NS)
        memory = step(replace(inputs, hood_motor=motor), memory, NONE, None).memory
        assert not memory.homed


def test_the_angle_is_the_screws_and_fires() -> None:
    tick = step(without(), counted(without()), NONE, None)
    assert tick.verdict.fire and tick.memory.homed
    assert tick.estimate.hood_deg == tick.estimate.hood_screw_deg == pytest.approx(good_memory().aim.hood_deg)
    assert 0.0 < tick.estimate.oldest_s < 0.01


@pytest.mark.parametrize("change", [
    {"position_rad": 1.2}, {"position_rad": -1.2}, {"position_rad": math.nan}, {"t_ns": -seconds(0.12)},
    {"t_ns": seconds(0.5)}], ids=["jump up", "jump down", "not a number", "gap", "backwards"])
def test_a_count_that_is_lost_is_a_hold_until_it_is_homed(change: dict[str, float]) -> None:
    inputs = without()
    (name, by), = change.items()
    memory = counted(inputs, **{name: getattr(counted(inputs).count, name) + by})
    tick = step(inputs, memory, NONE, None)
    assert not tick.verdict.fire and not tick.memory.homed and tick.estimate.hood_deg is None
    assert because.HOOD_NOT_HOMED() in tick.verdict.reasons
    assert tick.command.hood_torque_nm == -BLIND * NONE.hood.friction_nm       # until its motor shows that it moves
    later = replace(inputs, hood_motor=replace(inputs.hood_motor, endstop=True, endstop_t_ns=inputs.hood_motor.t_ns))
    homed = step(later, closed_once(later, tick.memory, NONE), NONE, None)
    assert homed.memory.homed and homed.estimate.hood_deg == pytest.approx(NONE.hood.low_deg)


def test_a_motor_that_is_silent_has_lost_its_count_and_is_not_driven_home() -> None:
    inputs = without()
    stale = replace(inputs, hood_motor=replace(inputs.hood_motor, t_ns=NOW_NS - seconds(0.2)))
    tick = step(stale, counted(stale), NONE, None)
    assert not tick.memory.homed and because.HOOD_NOT_HOMED() in tick.verdict.reasons
    assert tick.command.hood_torque_nm == 0.0


# --- an encoder that homing zeroes

def test_a_counting_encoder_is_zeroed_at_the_switch_and_then_checked() -> None:
    inputs = good_inputs()
    at_switch = replace(inputs, hood_motor=replace(inputs.hood_motor, endstop=True, endstop_t_ns=NOW_NS, t_ns=NOW_NS))
    memory = replace(good_memory(), homed=False)
    assert step(inputs, memory, COUNTING, None).estimate.hood_deg is None
    closed = closed_once(at_switch, memory, COUNTING)
    homed = step(at_switch, closed, COUNTING, None)
    assert homed.memory.homed and homed.estimate.hood_deg == pytest.approx(COUNTING.hood.low_deg)
    assert not step(replace(at_switch, hood_angle=None), closed, COUNTING, None).memory.homed
    turned = replace(inputs.hood_angle, angle_rad=(inputs.hood_angle.angle_rad + math.radians(9.0)) % math.tau)
    later = step(replace(at_switch, hood_angle=turned), homed.memory, COUNTING, None)
    assert later.estimate.hood_deg == pytest.approx(COUNTING.hood.low_deg + 9.0)
    assert because.HOOD_ENCODERS_DISAGREE.name in codes(later.verdict.reasons)


@pytest.mark.parametrize("bit", [bit for bit, _ in odrive.ERRORS] + [1 << 31])
def test_an_error_of_the_controller_that_is_the_encoder_is_a_hold_with_that_error(bit: int) -> None:
    table, inputs = ODRIVE.hood_encoder, good_inputs()
    encoder, stamp = encoder_family_of(table).make(table, around_encoder(CONFIG)), inputs.hood_angle.t_ns
    turned = math.radians(table.zero_deg + table.direction * good_memory().aim.hood_deg)
    for errors in (0, bit):
        encoder._motor.reading = MotorReading(t_ns=stamp, position_rad=table.gear * turned, heartbeat_t_ns=stamp,
                                              axis_error=errors)
        read = encoder.read(NOW_NS)
        assert read.magnet_ok is not bool(errors)
        tick = step(replace(inputs, hood_angle=replace(read, magnet_ok=True)), good_memory(), ODRIVE, None)
        assert tick.verdict.fire is not bool(errors)          # nor where a recording from before says that it is well
    assert tick.verdict.reasons == (because.MOTOR_ERROR(motor="hood encoder", errors=odrive.errors_of(bit)),)


@pytest.mark.parametrize("bits", [0, 0x04, 0x100, 0x200, 0x300, 0x104])
def test_a_sparks_reset_and_lock_are_about_driving_and_its_faults_about_the_angle(bits: int) -> None:
    table = COUNTING.hood_encoder
    encoder = encoder_family_of(table).make(table, around_encoder(CONFIG))
    encoder._motor.reading = MotorReading(t_ns=5, axis_error=bits)
    assert encoder.read(9).magnet_ok is not bool(bits & spark.FAULTS)
