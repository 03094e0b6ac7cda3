"""SparkMotor against the emulated device, over a bus: it drives what it has verified, and nothing else."""

import itertools
import struct

import pytest

from tests.hw.spinning_plant import closed_after
from truearc.hw import fault_codes as hw
from truearc.hw.devices.drivers import DcMotor
from truearc.hw.devices.family import Bounds
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor
from truearc.hw.emulated.nodes import Twin
from truearc.hw.protocols import BadFrame, Frame
from truearc.hw.real.can_bus import open_can
from truearc.hw.reason import Reason
from truearc_proof.world.faults import OVERWRITTEN, SILENT, UNPOWERED, Fault, FaultyNode

MS = 1_000_000
TICK_MS = 5
MOTOR = DcMotor(2.45, 612.5, 12.25)                       # 0.02 Nm/A and 0.1 ohm, what SparkSettings() has
HEARTBEAT, BASE = 0x02052C80, 0x02050000
FOREVER = 1 << 62
NOTHING_KNOWN = Bounds()


class Bench:
    """A robot's end of the bus with one motor or more, at 200 Hz, with their devices at the other."""

    def __init__(self, plant, clock, settings=None, faults=(), devices=(3,), direction=1,
                 bounds=NOTHING_KNOWN) -> None:
        self.plant, self.clock = plant, clock
        self.near, self.far = (open_can("virtual", "test_spark_motor", 1_000_000, clock) for _ in range(2))
        axes = [SparkAxis(device, direction, has_endstop=True) for device in devices]
        self.nodes = [SparkNode(axis, name, plant, settings, plant.hood_at_limit)
                      for axis, name in zip(axes, ("hood", "feeder"), strict=False)]
        far = (FaultyNode(self.nodes[0], faults) if faults else self.nodes[0], *self.nodes[1:])
        self.twin = Twin(plant, self.far, far)
        heartbeat = SparkHeartbeat()
        self.motors = [SparkMotor(axis, MOTOR, heartbeat, spark.settings(axis, bounds, 0.02)) for axis in axes]
        self.motor, self.node = self.motors[0], self.nodes[0]
        self.sent: list[Frame] = []
        self.bad: list[str] = []
        self.orders = []

    def run(self, ticks: int, torque_nm: float | None = None, others_nm: float | None = None) -> None:
        """Ticks as HardwareRig has them: what came, what stands in the way, what is sent."""
        for _ in range(ticks):
            t_ns = self.clock.t_ns + TICK_MS * MS
            self.twin.advance(t_ns)
            self.clock.t_ns = t_ns
            for frame in self.near.read():
                self.hear(frame)
            for motor in self.motors:
                motor.faults(t_ns)
            asked = [torque_nm] + [others_nm] * (len(self.motors) - 1)
            self.orders = [motor.order(nm, t_ns) for motor, nm in zip(self.motors, asked, strict=True)]
            for order in self.orders:
                for frame in order.frames:
                    assert self.near.write(frame)
                    self.sent.append(frame._replace(t_ns=t_ns))

    def hear(self, frame: Frame) -> None:
        for motor in self.motors:
            if (frame.arbitration_id, frame.is_extended) in motor.ids():
                try:
                    motor.take(frame)
                except BadFrame as error:
                    self.bad.append(str(error))

    def faults(self) -> tuple[Reason, ...]:
        return self.motor.faults(self.clock.t_ns)

    def frames(self, base: int) -> list[Frame]:
        return [frame for frame in self.sent if frame.arbitration_id == BASE + base + 3]

    def enabled(self) -> list[int]:
        return [int.from_bytes(frame.data, "little") for frame in self.sent if frame.arbitration_id == HEARTBEAT]

    def close(self) -> None:
        self.near.close()
        self.far.close()


make = closed_after(Bench, "plant", "clock")


def armed(bench, torque_nm: float = 0.0) -> None:
    bench.run(60)
    bench.run(60, torque_nm)
    assert bench.motor.reading.axis_state == spark.DRIVEN and bench.faults() == ()


def test_it_sets_a_device_up_before_anybody_arms_and_sends_no_duty(make) -> None:
    bench = make()
    assert bench.faults() == (hw.SPARK_FIRMWARE_UNKNOWN(spark=3),)
    bench.run(60)
    assert bench.faults() == () and bench.motor.reading.axis_state == spark.IDLE
    assert [frame.is_remote for frame in bench.frames(0x2600)] == [True]
    assert [frame.data for frame in bench.frames(0x400)] == [bytes([7, 0, 7, 0])]
    assert [frame.data[0] for frame in bench.frames(0x3800)] == [70, 71, 136, 137, 160, 53]
    assert bench.node.parameters[71] == 16.0 and bench.node.parameters[160] == 10.0
    assert bench.frames(0x080) == [] and bench.enabled() == []
    assert bench.clock.t_ns - bench.motor.reading.t_ns <= 15 * MS


def test_torque_becomes_duty_and_turns_the_motor_as_asked(make, plant) -> None:
    bench = make()
    armed(bench)
    start = plant.velocity_rad_s["hood"]
    bench.run(100, 0.1)                                    # 0.5 s at 100 rad/s2
    gained = plant.velocity_rad_s["hood"] - start
    # Of the back-EMF the driver knows what was true some 10 ms ago: a ninth of the motor's own time constant.
    assert gained == pytest.approx(50.0, rel=0.1)
    assert bench.orders[0].duty == pytest.approx(bench.node.output, abs=0.01)
    assert bench.orders[0].torque_nm == pytest.approx(0.1)


def test_the_devices_sign_is_hidden(make, plant) -> None:
    bench = make(direction=-1)
    armed(bench)
    bench.run(40, 0.2)
    assert plant.velocity_rad_s["hood"] > 20.0 and bench.motor.reading.velocity_rad_s > 15.0
    assert bench.orders[0].duty > 0.0 > bench.node.output


def test_what_a_duty_cannot_give_is_not_said_to_be_sent(make, plant) -> None:
    bench = make()
    armed(bench)
    bench.run(2, 5.0)
    assert bench.orders[0].duty == 1.0
    speed, bus_v = bench.motor.reading.velocity_rad_s, bench.motor.reading.bus_v
    assert bench.orders[0].torque_nm == pytest.approx(0.02 * (bus_v - 0.02 * speed) / 0.1) and speed < 200.0


def test_a_bus_voltage_that_cannot_be_drives_nothing(make, plant) -> None:
    """By a voltage that is read six times too low, a duty would give six times the torque."""
    bench = make()
    armed(bench)
    bench.run(10, 0.1)
    assert bench.orders[0].torque_nm == pytest.approx(0.1)
    plant.volts = 2.0
    bench.run(20, 0.1)
    assert bench.orders[0].duty is None and bench.node.output == 0.0
    assert bench.motor.reading.axis_state != spark.DRIVEN


def test_the_heartbeat_is_the_ticks_own(make) -> None:
    bench = make()
    armed(bench)
    bench.sent.clear()
    bench.run(200, 0.0)                                    # a second
    beats = [frame.t_ns for frame in bench.sent if frame.arbitration_id == HEARTBEAT]
    assert 45 <= len(beats) <= 52 and set(bench.enabled()) == {1 << 3}
    assert max(later - sooner for sooner, later in itertools.pairwise(beats)) <= 25 * MS


def test_released_is_duty_zero_and_disabled_at_once(make) -> None:
    bench = make()
    armed(bench, 0.1)
    bench.sent.clear()
    bench.run(1)
    assert [frame.arbitration_id for frame in bench.sent] == [0x02050083, HEARTBEAT]
    assert bench.sent[0].data == bytes(8) and bench.sent[1].data == bytes(8)
    bench.run(100)
    assert bench.orders[0].torque_nm == 0.0 and bench.orders[0].duty is None
    duties, beats = bench.frames(0x080), [frame for frame in bench.sent if frame.arbitration_id == HEARTBEAT]
    for said in (duties, beats):                          # again every 0.1 s: one of these may be lost
        assert [frame.t_ns - said[0].t_ns for frame in said] == [at * 100 * MS for at in range(6)]
        assert {frame.data for frame in said} == {bytes(8)}


@pytest.mark.parametrize(("brakes", "mode"), [(True, 1.0), (False, 0.0)])
def test_a_hood_brakes_and_wheels_coast_when_they_are_let_go(make, plant, brakes: bool, mode: float) -> None:
    bench = make(bounds=Bounds(600.0, 1.2, brakes))
    armed(bench, 0.1)
    bench.run(60, 0.1)
    assert (bench.node.parameters[6], bench.node.parameters[59]) == (mode, 66.0)     # 1.2 Nm at 0.02 Nm/A, and a tenth
    speed = plant.velocity_rad_s["hood"]
    bench.run(100)                                         # 0.5 s: twice the time constant of a short circuit
    left = plant.velocity_rad_s["hood"] / speed
    assert left < 0.2 if brakes else left == pytest.approx(1.0, abs=0.02)


def test_an_old_setpoint_is_replaced_before_the_heartbeat(make) -> None:
    bench = make()
    bench.run(60)
    bench.near.write(Frame(0, 0x02050083, struct.pack("<fI", 1.0, 0), True))     # somebody's, before us
    bench.sent.clear()
    while not bench.enabled():
        bench.run(1, 0.0)
    assert [frame.arbitration_id for frame in bench.sent[-2:]] == [0x02050083, HEARTBEAT]
    bench.run(20, 0.0)
    assert bench.node.output == 0.0


@pytest.mark.parametrize(("firmware", "text"), [((24, 0, 1), "24.0.1"), ((1, 6, 4), "1.6.4"), ((27, 0, 0), "27.0.0")])
def test_foreign_firmware_is_refused_by_its_number(make, plant, firmware, text: str) -> None:
    bench = make(settings=SparkSettings(firmware=firmware))
    bench.run(60)
    bench.run(200, 0.1)
    assert bench.faults() == (hw.SPARK_FIRMWARE_UNSUPPORTED(spark=3, version=text, oldest=25, newest=26),)
    assert bench.enabled() == [] and bench.frames(0x080) == [] and plant.velocity_rad_s["hood"] == 0.0
    assert bench.orders[0].torque_nm == 0.0 and bench.motor.reading.axis_state == spark.UNKNOWN
    assert 13 <= len(bench.frames(0x2600)) <= 15           # in 1.3 s: it may be exchanged for a newer one


def test_a_lock_is_refused_and_named(make, plant) -> None:
    bench = make()
    armed(bench, 0.0)
    bench.near.write(Frame(0, 0x01011840, bytes(8), True))
    bench.run(40, 0.1)
    assert spark.errors_of(bench.motor.reading.axis_error)[0] == hw.ERROR_LOCKED()
    assert bench.motor.reading.axis_state != spark.DRIVEN and bench.enabled()[-1] == 0
    assert bench.orders[0].torque_nm == 0.0
    bench.run(60)
    bench.run(200, 0.1)                                    # arming anew does not help
    assert bench.motor.reading.axis_error & spark.LOCKED and bench.enabled()[-1] == 0
    assert abs(plant.velocity_rad_s["hood"]) < 5.0


def test_a_reset_is_noticed_set_up_again_and_stands_until_the_operator_arms_anew(make, plant) -> None:
    bench = make(faults=(Fault(UNPOWERED, 1000 * MS, 1300 * MS),))
    armed(bench)
    bench.run(100, 0.01)                                   # to 1.1 s: it has been gone for 0.1 s
    assert bench.enabled()[-1] == 0 and bench.orders[0].torque_nm == 0.0
    speed, before = plant.velocity_rad_s["hood"], len(bench.frames(0x3800))
    bench.run(140, 0.01)                                   # to 1.8 s: power is back
    assert bench.node.parameters[71] == 16.0 and len(bench.frames(0x3800)) > before
    assert len(bench.frames(0x400)) >= 2 and bench.faults() == ()
    assert spark.errors_of(bench.motor.reading.axis_error) == (hw.ERROR_HAS_RESET(),)
    assert bench.enabled()[-1] == 0 and plant.velocity_rad_s["hood"] == speed
    bench.run(5)
    bench.run(80, 0.01)
    assert bench.motor.reading.axis_error == 0 and bench.motor.reading.axis_state == spark.DRIVEN
    assert bench.enabled()[-1] == 1 << 3


def test_lost_status_frames_are_noticed_and_asked_for_again(make) -> None:
    bench = make(faults=(Fault(SILENT, 1000 * MS, 1250 * MS, frame_id=0x0205B883),))
    armed(bench)
    bench.sent.clear()
    bench.run(100, 0.0)                                    # to 1.1 s
    bench.run(10, 0.0)
    assert bench.orders[0].duty is None and bench.enabled()[-1] == 0
    assert bench.frames(0x2600) and bench.frames(0x400)
    bench.run(60, 0.0)
    assert bench.faults() == () and bench.motor.reading.axis_state == spark.DRIVEN      # no error stood


def test_what_a_reset_may_have_lost_is_set_again_before_it_drives(make) -> None:
    bench = make()
    bench.run(60)
    assert bench.motor.reading.axis_error == spark.HAS_RESET and len(bench.frames(0x3800)) == 6
    bench.run(60, 0.0)
    assert len(bench.frames(0x3800)) == 12 and bench.motor.reading.axis_state == spark.DRIVEN
    bench.run(20)
    bench.run(60, 0.0)
    assert len(bench.frames(0x3800)) == 12                 # nothing has been lost since


@pytest.mark.parametrize(("fault", "named"), [
    (Fault(SILENT, 0, FOREVER, frame_id=0x02050443), hw.SPARK_STATUS_OFF(spark=3)),
    (Fault(OVERWRITTEN, 0, FOREVER, frame_id=0x02050443, at=3, data=b"\x03"), hw.SPARK_STATUS_OFF(spark=3)),
    (Fault(OVERWRITTEN, 0, FOREVER, frame_id=0x02053843, at=6, data=b"\x01"),
     hw.SPARK_SETTINGS_UNCONFIRMED(spark=3, parameters=(70, 71, 136, 137, 160, 53))),
    (Fault(SILENT, 0, FOREVER, frame_id=0x0205B843), hw.SPARK_FAULTS_STALE(spark=3))])
def test_what_a_device_does_not_confirm_is_named_and_it_is_not_driven(make, fault: Fault, named: Reason) -> None:
    bench = make(faults=(fault,))
    bench.run(60)
    bench.run(100, 0.1)
    assert bench.faults() == (named,) and bench.enabled() == [] and bench.frames(0x080) == []


def test_faults_of_the_device_keep_it_from_driving(make, plant) -> None:
    bench = make(settings=SparkSettings(faults=0x10))
    bench.run(60)
    bench.run(100, 0.1)
    assert spark.errors_of(bench.motor.reading.axis_error) == (hw.ERROR_OVER_TEMPERATURE(),)
    assert plant.velocity_rad_s["hood"] == 0.0


def test_a_device_that_applies_nothing_is_deaf(make) -> None:
    """Another host keeps disabling it: the device does not say so, but what it applies does."""
    bench = make()
    armed(bench, 0.1)
    for _ in range(60):
        bench.run(1, 0.1)
        bench.near.write(Frame(0, HEARTBEAT, bytes(8), True))
    assert bench.faults() == (hw.SPARK_NOT_DRIVING(spark=3),)
    assert bench.motor.reading.axis_state == spark.IDLE
    bench.run(30, 0.1)
    assert bench.faults() == () and bench.motor.reading.axis_state == spark.DRIVEN


def test_that_it_was_deaf_outlasts_a_short_feed(make) -> None:
    """A feeder is asked for a quarter of a second, then rests: what it did not do then must keep the next shot back."""
    bench = make()
    armed(bench, 0.0)
    for torque_nm in [0.1] * 50 + [0.0] * 100:
        bench.run(1, torque_nm)
        bench.near.write(Frame(0, HEARTBEAT, bytes(8), True))
    assert bench.faults() and bench.motor.reading.axis_state == spark.IDLE
    bench.run(100, 0.0)                                    # nobody disables it any longer, but nothing has shown that
    assert bench.faults()
    bench.run(2, None)
    bench.run(10, 0.0)                                     # wanted anew
    assert bench.faults() == () and bench.motor.reading.axis_state == spark.DRIVEN


def test_ticks_that_stand_still_do_not_make_it_deaf(make) -> None:
    """Unfed for so long, it lets go by itself."""
    bench = make()
    armed(bench, 0.1)
    bench.run(20, 0.1)
    bench.clock.t_ns += 600 * MS
    for _ in range(60):
        bench.run(1, 0.1)
        assert bench.faults() == () and bench.motor.reading.axis_state == spark.DRIVEN


def test_against_its_switch_it_may_rest(make, plant) -> None:
    bench = make()
    plant.limit = True
    armed(bench)
    bench.sent.clear()
    bench.run(100, -0.05)
    assert 20 <= len(bench.frames(0x080)) <= 21            # in 0.5 s: a duty that stands is repeated every 25 ms
    assert bench.motor.reading.endstop and bench.faults() == () and plant.velocity_rad_s["hood"] == 0.0
    assert bench.motor.reading.axis_state == spark.DRIVEN


def test_one_heartbeat_names_all_that_may_drive_and_only_those(make, plant) -> None:
    bench = make(devices=(3, 40))
    bench.run(60, None, None)
    bench.run(80, 0.05, 0.05)
    assert bench.enabled()[-1] == 1 << 3 | 1 << 40
    assert plant.velocity_rad_s["hood"] > 1.0 and plant.velocity_rad_s["feeder"] > 1.0
    bench.run(10, None, 0.05)
    assert bench.enabled()[-1] == 1 << 40 and bench.nodes[0].output == 0.0 and bench.nodes[1].output > 0.0
    beats = [frame.t_ns for frame in bench.sent if frame.arbitration_id == HEARTBEAT][-10:]
    assert len(beats) == len(set(beats))                   # never one a motor


def test_one_that_was_deaf_is_not_driven_by_an_old_duty(make) -> None:
    bench = make()
    armed(bench)
    bench.run(20, 0.2)
    receive, bench.node.receive = bench.node.receive, lambda frame, t_ns: []
    bench.run(60, 0.2)
    assert hw.SPARK_NOT_DRIVING(spark=3) in bench.faults()
    for waited in range(100, 106):                     # wherever it is between two repetitions of the duty
        bench.run(waited, 0.0)
        bench.node.receive, driven_nm = receive, []
        for _ in range(20):
            bench.run(1, 0.0)
            driven_nm.append(abs(bench.node.torque_nm()))
        assert max(driven_nm) < 0.05
        bench.node.receive = lambda frame, t_ns: []
