"""Devices that go silent, deaf or mad between two times."""

import math
import struct

import pytest

from tests.hw.spinning_plant import SpinningPlant
from truearc.hw.devices.canandmag import CanandmagNode, make_position_period
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.emulator import OdriveNode
from truearc.hw.devices.odrive.frames import CLOSED_LOOP, IDLE, PASSTHROUGH, TORQUE, OdriveAxis
from truearc.hw.emulated.nodes import Twin
from truearc.hw.protocols import BadFrame, MotorReading
from truearc.hw.real.can_bus import open_can
from truearc_proof.world.faults import (
    DEAF,
    DOUBLED,
    HELD,
    LENGTHENED,
    MOVED,
    OVERWRITTEN,
    SILENT,
    STUCK,
    TRUNCATED,
    UNPLUGGED,
    UNPOWERED,
    Fault,
    FaultyNode,
)

MS = 1_000_000
AXIS = OdriveAxis(1, 1)
ESTIMATE_ID = 0x29


@pytest.fixture
def wired(plant, clock):
    """Runs one axis with faults; gives (heard frames, node)."""
    buses = [open_can("virtual", "test_faults", 1_000_000, clock) for _ in range(2)]

    def run(*faults: Fault):
        node = OdriveNode(AXIS, "flywheel_a", plant)
        twin = Twin(plant, buses[1], (FaultyNode(node, faults),))
        buses[0].write(odrive.make_controller_mode(AXIS, TORQUE, PASSTHROUGH))
        buses[0].write(odrive.make_state(AXIS, CLOSED_LOOP))
        heard = []
        for t_ns in range(5 * MS, 1001 * MS, 5 * MS):
            buses[0].write(odrive.make_torque(AXIS, 0.01))
            twin.advance(t_ns)
            clock.t_ns = t_ns
            heard += buses[0].read()
        return heard, node

    yield run
    for bus in buses:
        bus.close()


def estimates(heard) -> list:
    return [frame for frame in heard if frame.arbitration_id == ESTIMATE_ID]


def test_a_silent_node_still_obeys(wired) -> None:
    heard, node = wired(Fault(SILENT, 300 * MS, 700 * MS))
    assert not [frame for frame in heard if 300 * MS < frame.t_ns < 700 * MS]
    assert len(estimates(heard)) == 60 and node.state == CLOSED_LOOP


def test_an_unplugged_node_trips_its_watchdog_and_comes_back_disarmed(wired) -> None:
    heard, node = wired(Fault(UNPLUGGED, 300 * MS, 700 * MS))
    assert len(estimates(heard)) == 60
    assert node.state == IDLE and node.errors == odrive.WATCHDOG_EXPIRED


def test_one_kind_of_frame_may_go_missing(wired) -> None:
    heard, _ = wired(Fault(SILENT, 0, 500 * MS, frame_id=ESTIMATE_ID))
    assert len(estimates(heard)) == 50 and sum(frame.arbitration_id == 0x34 for frame in heard) == 100


@pytest.mark.parametrize("fault", [
    Fault(TRUNCATED, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID, length=4),
    Fault(OVERWRITTEN, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID, at=4, data=struct.pack("<f", math.nan)),
    Fault(OVERWRITTEN, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID, at=4, data=struct.pack("<f", 1e20))])
def test_mad_frames_are_refused_by_the_driver_and_only_those(wired, fault: Fault) -> None:
    heard, _ = wired(fault)
    assert len(estimates(heard)) == 100
    refused, reading = 0, MotorReading()
    for frame in estimates(heard):
        try:
            reading = odrive.parse(AXIS, frame, reading)
        except BadFrame:
            refused += 1
            assert 300 * MS <= frame.t_ns <= 705 * MS
    assert refused == 40 and abs(reading.velocity_rad_s) < 20.0


def test_unknown_faults_are_refused() -> None:
    with pytest.raises(ValueError, match="tired"):
        Fault("tired", 0, 1)


def test_a_node_without_power_is_silent_drives_nothing_and_starts_anew(plant, wired) -> None:
    heard, node = wired(Fault(UNPOWERED, 300 * MS, 700 * MS))
    assert not [frame for frame in heard if 300 * MS < frame.t_ns < 700 * MS]
    assert len(estimates(heard)) == 60 and node.state == IDLE and node.errors == 0
    gained = 0.01 / plant.inertia_kg_m2 * 0.3               # torque for 0.3 s, and then none
    assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(gained)
    again = odrive.parse(AXIS, estimates(heard)[-1], MotorReading())
    assert again.position_rad == pytest.approx(gained * (again.t_ns - 702 * MS) * 1e-9, abs=0.01)


def test_an_encoder_without_power_forgets_its_period_and_its_turns(plant, clock) -> None:
    near, far = (open_can("virtual", "test_faults_encoder", 1_000_000, clock) for _ in range(2))
    node = CanandmagNode(5, plant, 0.0, 1)
    twin = Twin(plant, far, (FaultyNode(node, (Fault(UNPOWERED, 200 * MS, 300 * MS),)),))
    near.write(make_position_period(5, 10))
    plant.hood_rad = 0.9
    twin.advance(199 * MS)
    before = [frame for frame in near.read() if frame.arbitration_id == 0x070E07C5]
    twin.advance(500 * MS)
    after = [frame for frame in near.read() if frame.arbitration_id == 0x070E07C5]
    near.close()
    far.close()
    assert (len(before), len(after)) == (19, 11)            # every 10 ms; then every 20 ms from 300 ms on
    assert before[-1].data[:4] != bytes(4) and after[-1].data[:4] == bytes(4)


def test_a_deaf_node_speaks_on_until_its_watchdog_bites(wired) -> None:
    heard, node = wired(Fault(DEAF, 300 * MS, 700 * MS))
    assert len(estimates(heard)) == 100 and node.errors == odrive.WATCHDOG_EXPIRED


def test_a_stuck_node_says_the_same_again_and_again(wired) -> None:
    heard, _ = wired(Fault(STUCK, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID))
    said = [frame.data for frame in estimates(heard)]
    assert len(said) == 100 and said[30:70] == [said[30]] * 40 and len(set(said)) == 61


def test_a_node_whose_frames_come_twice(wired) -> None:
    heard, _ = wired(Fault(DOUBLED, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID))
    assert len(estimates(heard)) == 140


def test_frames_held_back_all_come_at_the_end_in_order(wired) -> None:
    heard, _ = wired(Fault(HELD, 300 * MS, 700 * MS))
    stamps = [frame.t_ns for frame in estimates(heard)]
    assert len(stamps) == 100 and not [t_ns for t_ns in stamps if 305 * MS < t_ns < 700 * MS]
    assert stamps.count(705 * MS) == 41
    positions = [odrive.parse(AXIS, frame, MotorReading()).position_rad for frame in estimates(heard)]
    assert positions == sorted(positions)


def test_frames_under_another_id_and_of_another_length(wired) -> None:
    heard, _ = wired(Fault(MOVED, 300 * MS, 700 * MS, frame_id=ESTIMATE_ID, by=0x20))
    assert len(estimates(heard)) == 60 and sum(frame.arbitration_id == 0x49 for frame in heard) == 40
    node = FaultyNode(OdriveNode(AXIS, "flywheel_a", SpinningPlant()), ())
    node.suffer(Fault(LENGTHENED, 0, MS * 10, frame_id=ESTIMATE_ID, length=12))
    assert {len(frame.data) for frame in node.step(5 * MS) if frame.arbitration_id == ESTIMATE_ID} == {12}
