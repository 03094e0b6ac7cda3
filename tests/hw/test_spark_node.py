"""The emulated SPARK by itself, frames written by hand: rates, heartbeat, limits, what it forgets."""

import struct

import pytest

from tests.hw.spinning_plant import closed_after
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.emulated.nodes import Twin
from truearc.hw.protocols import Frame
from truearc.hw.real.can_bus import open_can

MS = 1_000_000
KT, OHM = 0.02, 0.1
HEARTBEAT, BASE = 0x02052C80, 0x02050000
STATUS_0, STATUS_1, STATUS_2 = 0xB800, 0xB840, 0xB880


class Bench:
    """One device on a bus; this end of it is the test."""

    def __init__(self, plant, clock, axis: SparkAxis | None = None, settings: SparkSettings | None = None) -> None:
        self.axis, self.plant, self.clock = axis or SparkAxis(3, 1), plant, clock
        self.near, self.far = (open_can("virtual", "test_spark_node", 1_000_000, clock) for _ in range(2))
        self.node = SparkNode(self.axis, "hood", plant, settings, plant.hood_at_limit)
        self.twin = Twin(plant, self.far, (self.node,))
        self.log: list[Frame] = []

    def send(self, command: int, data: bytes, is_remote: bool = False) -> None:
        assert self.near.write(Frame(0, BASE + command + self.axis.device, data, True, is_remote))

    def beat(self, bits: int = 1 << 3) -> None:
        assert self.near.write(Frame(0, HEARTBEAT, bits.to_bytes(8, "little"), True))

    def duty(self, duty: float) -> None:
        self.send(0x080, struct.pack("<fI", duty, 0))

    def run(self, ms: int, beating: bool = False) -> None:
        """Let so many ms pass, in steps of 1 ms; with a heartbeat every 20 if `beating`."""
        for number in range(ms):
            if beating and number % 20 == 0:
                self.beat()
            self.twin.advance(self.clock.t_ns + MS)
            self.clock.t_ns += MS
            self.log += self.near.read()

    def close(self) -> None:
        self.near.close()
        self.far.close()

    def heard(self, command: int) -> list[bytes]:
        return [frame.data for frame in self.log if frame.arbitration_id == BASE + command + self.axis.device]


make = closed_after(Bench, "plant", "clock")


@pytest.fixture
def bench(make):
    return make()


def test_rates_of_a_new_device_and_what_it_refuses(bench) -> None:
    bench.run(2000)
    assert [len(bench.heard(status)) for status in (STATUS_0, STATUS_1, STATUS_2)] == [200, 8, 0]
    bench.send(0x400, bytes([0, 0x80, 0, 0x80]))
    bench.run(1)
    assert bench.heard(0x440) == [bytes([1, 0, 0x80, 0x03, 0])]
    bench.send(0x3800, bytes([250, 16, 0, 0, 0]))
    bench.send(0x3800, bytes([136]) + struct.pack("<f", float("nan")))
    bench.run(1)
    assert bench.heard(0x3840) == [bytes([250, 0, 0, 0, 0, 0, 1]), bytes([136, 3]) + struct.pack("<f", 0.03125) + b"\1"]


@pytest.mark.parametrize("last_ms", [0, 40])
def test_the_output_is_zero_100_ms_after_the_last_heartbeat(bench, plant, last_ms: int) -> None:
    bench.duty(0.5)
    bench.beat()
    if last_ms:
        bench.run(last_ms)
        bench.beat()
    bench.run(99)
    assert bench.node.output == 0.5 and bench.node.torque_nm() > 0.0
    bench.run(1)
    assert bench.node.output == 0.0 and bench.node.torque_nm() == 0.0
    speed = plant.velocity_rad_s["hood"]
    bench.run(200)
    assert plant.velocity_rad_s["hood"] == speed
    assert bench.heard(STATUS_0)[-1][:2] == bytes(2)
    bench.beat()
    bench.run(1)
    assert bench.node.output == 0.5                       # the setpoint stood all the while


def test_torque_is_that_of_a_motor_at_a_share_of_the_bus_voltage(bench, plant) -> None:
    """dw/dt = kt (d V - kt w) / (R J): the closed form, against the device's 1 ms loop."""
    bench.duty(0.25)
    bench.run(400, beating=True)
    tau_s = plant.inertia_kg_m2 * OHM / KT**2
    assert plant.velocity_rad_s["hood"] == pytest.approx(
        0.25 * 12.25 / KT * (1.0 - 2.718281828 ** (-0.4 / tau_s)), rel=0.01)


def test_stall_current_is_limited(bench, plant) -> None:
    bench.duty(1.0)
    bench.run(1, beating=True)
    assert bench.node.torque_nm() == pytest.approx(80.0 * KT)      # 122 A would flow
    bench.send(0x3800, bytes([59, 10, 0, 0, 0]))
    bench.run(1)
    assert bench.node.torque_nm() == pytest.approx(10.0 * KT)


@pytest.mark.parametrize(("direction", "duty", "stops"), [(1, -0.25, True), (1, 0.25, False),
                                                          (-1, 0.25, True), (-1, -0.25, False)])
def test_a_closed_switch_stops_it_in_one_direction(make, plant, direction: int, duty: float, stops: bool) -> None:
    bench, plant.limit = make(SparkAxis(3, direction)), True
    bench.duty(duty)
    bench.run(20, beating=True)
    assert (plant.velocity_rad_s["hood"] == 0.0) is stops
    assert bench.heard(STATUS_0)[-1][6] == (2 if direction > 0 else 1)
    plant.limit = False
    bench.run(2)
    assert bench.node.output == duty


def test_a_new_device_smears_speed_over_a_tenth_of_a_second_and_less_is_a_setting(bench, plant) -> None:
    bench.send(0x400, bytes([0x04, 0, 0x04, 0]))
    bench.run(300)
    plant.velocity_rad_s["hood"] = 62.8318530718
    bench.run(60)
    assert 200.0 < struct.unpack("<ff", bench.heard(STATUS_2)[-1])[0] < 400.0     # it turns for half of the window
    bench.send(0x3800, bytes([71, 16, 0, 0, 0]))
    bench.run(40)
    assert bench.heard(0x3840) == [bytes([71, 2, 16, 0, 0, 0, 0])]
    assert struct.unpack("<ff", bench.heard(STATUS_2)[-1])[0] == pytest.approx(600.0, rel=1e-4)


def test_malformed_frames_are_counted_and_change_nothing(bench) -> None:
    bench.duty(0.5)
    bench.run(5, beating=True)
    bench.duty(float("nan"))
    bench.duty(1.5)
    bench.send(0x080, bytes(3))
    assert bench.near.write(Frame(0, HEARTBEAT, bytes(4), True))
    bench.run(5)
    assert bench.node.output == 0.5 and bench.node.bad_frames == 4
