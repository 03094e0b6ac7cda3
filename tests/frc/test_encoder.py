"""The hood's angle from NetworkTables: what the key may say, what it may not, and a real server."""

import math
import time
from typing import Any

import ntcore
import pytest
from msgspec.structs import replace

from tests.frc.nt_server import free_port
from tests.robot.alike import codes
from tests.robot.encoders import NT4
from tests.robot.good_tick import NOW_NS, good_inputs, good_memory
from truearc.hw.devices.family import FAILURE, Around
from truearc.robot import reasons as because
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.tick import step
from truearc_frc.inputs import NtEncoder, examine
from truearc_frc.keys import Reading

TABLE = NT4.hood_encoder


class Said:
    """A server that has one key, or none."""

    def __init__(self, value: float | str | None, t_ns: int = NOW_NS, connected: bool = True) -> None:
        self.connected = connected
        self._found = {} if value is None else {TABLE.key: Reading(t_ns, value)}

    def read(self, now_ns: int) -> dict[str, Reading]:
        return self._found


def test_a_key_in_turns_is_an_angle_with_the_stamp_of_its_publication() -> None:
    encoder = NtEncoder(TABLE, Said(0.125, 17))
    reading = encoder.read(NOW_NS)
    assert (reading.t_ns, reading.angle_rad, reading.magnet_ok) == (17, pytest.approx(math.radians(45.0)), True)
    assert encoder.faults(NOW_NS) == () and encoder.ids() == () and encoder.frames(NOW_NS) == ()
    degrees = NtEncoder(replace(TABLE, unit="deg"), Said(-30.0))
    assert degrees.read(NOW_NS).angle_rad == pytest.approx(math.radians(330.0))
    assert NtEncoder(replace(TABLE, unit="rad"), Said(1.0)).read(NOW_NS).angle_rad == pytest.approx(1.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1.01, -2.0, "0.125"])
def test_what_is_not_an_angle_is_a_fault_and_no_reading(value: float | str) -> None:
    encoder = NtEncoder(TABLE, Said(value))
    assert encoder.read(NOW_NS) is None
    assert codes(encoder.faults(NOW_NS)) == [because.KEY_IMPLAUSIBLE.name]


def test_a_key_that_is_gone_and_a_server_that_is_gone_are_named() -> None:
    encoder = NtEncoder(TABLE, Said(None, connected=False))
    assert encoder.read(NOW_NS) is None
    assert encoder.faults(NOW_NS) == (because.NT_LOST(), because.KEY_MISSING(key="/Hood/Rot"))


@pytest.mark.parametrize(("age_s", "off_deg", "code"), [
    (0.02, 0.0, None), (0.2, 0.0, because.DEVICE_STALE), (0.02, 4.0, because.HOOD_ENCODERS_DISAGREE)])
def test_a_key_that_freezes_or_jumps_is_a_hold(age_s: float, off_deg: float, code) -> None:
    truth_deg = good_memory().aim.hood_deg + off_deg
    encoder = NtEncoder(TABLE, Said((90.0 - truth_deg) / 360.0, NOW_NS - int(age_s * 1e9)))
    tick = step(replace(good_inputs(), hood_angle=encoder.read(NOW_NS)), good_memory(), NT4, None)
    assert tick.verdict.fire is (code is None)
    assert code is None or code.name in codes(tick.verdict.reasons)


def test_a_real_server_is_read_without_waiting_and_the_doctor_sees_what_it_publishes(
        nt_server: tuple[Any, str]) -> None:
    finding, = examine(TABLE, Around(0.1, {"nt4": {"server": f"127.0.0.1:{free_port()}"}}), None)
    assert finding.level == FAILURE and "no connection" in finding.says
    server, address = nt_server
    table, around = TABLE, Around(0.1, {"nt4": {"server": address}})
    options = ntcore.PubSubOptions(keepDuplicates=True, sendAll=True, periodic=0.01)
    topic = server.getDoubleTopic(TABLE.key).publish(options)
    encoder = encoder_family_of(table).make(table, around)
    try:
        stamps, longest_s, until = [], 0.0, time.monotonic() + 20.0
        while len(stamps) < 4 and time.monotonic() < until:
            topic.set(0.125)
            began = time.monotonic()
            reading = encoder.read(time.monotonic_ns())
            longest_s = max(longest_s, time.monotonic() - began)
            if reading is not None:
                assert reading.angle_rad == pytest.approx(math.radians(45.0))
                stamps += [reading.t_ns] if not stamps or reading.t_ns - stamps[-1] > 1_000_000 else []
            time.sleep(0.02)
        assert len(stamps) >= 4 and encoder.faults(0) == ()
        assert all(abs(time.monotonic_ns() - t_ns) < 20e9 for t_ns in stamps) and longest_s < 0.5
        finding, = examine(table, around, None)
        assert finding.level == FAILURE and "stands still" in finding.says
    finally:
        encoder._keys.close()
