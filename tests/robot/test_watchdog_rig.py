"""Messages to systemd: from the tick alone, after it has sent its commands."""

import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs
from truearc.robot.processes.watchdog_rig import WatchedRig, first_missing
from truearc.robot.reasons import BOX_SILENT, IMAGE_DARK
from truearc.robot.types import Command, Sent, Sighting

IDLE = Command(False, False, False, 0.0, 0.0, 0.0)
SEEN = Sighting(NOW_NS - 50_000_000, False, IMAGE_DARK())


class Given:
    """A rig that reads what it is given."""

    def __init__(self, *inputs):
        self.inputs = list(inputs)

    def read(self):
        return self.inputs.pop(0) if self.inputs else None

    def write(self, command):
        return Sent(command.enable_flywheel, command.enable_hood, command.enable_feeder, 0.0, 0.0, 0.0)

    def picture(self): ...


def later(inputs, tick, **changes):
    """The same, `tick` ticks on, as fresh as before."""
    by = tick * 5_000_000
    fresh = [replace(motor, t_ns=motor.t_ns + by, heartbeat_t_ns=motor.heartbeat_t_ns + by)
             for motor in (*inputs.flywheels, inputs.hood_motor, inputs.feeder)]
    angle = replace(inputs.hood_angle, t_ns=inputs.hood_angle.t_ns + by)
    return replace(inputs, t_ns=inputs.t_ns + by, flywheels=tuple(fresh[:2]), hood_motor=fresh[2], feeder=fresh[3],
                   hood_angle=angle, **changes)


def test_ready_once_and_then_alive_ten_times_a_second():
    said = []
    rig = WatchedRig(Given(*(later(good_inputs(), tick, sighting=SEEN) for tick in range(41))), CONFIG, said.append)
    while rig.read() is not None:
        rig.write(IDLE)
    assert said[0] == "READY=1\nSTATUS=running"
    assert said[1:] == ["WATCHDOG=1"] * 3                 # 0, 0.1 and 0.2 s: 41 ticks of 5 ms


def test_a_loop_that_reads_but_does_not_get_to_write_falls_silent():
    said = []
    rig = WatchedRig(Given(*(later(good_inputs(), tick, sighting=SEEN) for tick in range(100))), CONFIG, said.append)
    while rig.read() is not None:
        ...
    assert said == ["READY=1\nSTATUS=running"]


def test_not_ready_before_everything_has_been_heard():
    said = []
    deaf = replace(good_inputs(), hood_angle=None)
    rig = WatchedRig(Given(deaf, deaf, good_inputs(), replace(good_inputs(), sighting=SEEN)), CONFIG, said.append)
    while rig.read() is not None:
        rig.write(IDLE)
    assert said == ["STATUS=waiting: hood encoder", "STATUS=waiting: camera", "READY=1\nSTATUS=running", "WATCHDOG=1"]


@pytest.mark.parametrize(("changes", "missing"), [
    ({}, ""),
    ({"flywheels": "old"}, "flywheel motor 2"),
    ({"feeder": "mute"}, "feeder motor"),
    ({"hood_angle": None}, "hood encoder"),
    ({"faults": (BOX_SILENT(),)}, "button box: no heartbeat, outcomes cannot be marked"),
])
def test_what_is_missing_is_named(changes, missing):
    inputs = good_inputs()
    first, second = inputs.flywheels
    if changes.get("flywheels") == "old":
        changes = {"flywheels": (first, replace(second, t_ns=second.t_ns - 200_000_000))}
    if changes.get("feeder") == "mute":
        changes = {"feeder": replace(inputs.feeder, heartbeat_t_ns=0)}
    assert first_missing(replace(inputs, **changes), SEEN.t_ns, CONFIG) == missing


@pytest.mark.parametrize("seen_ns", [None, NOW_NS - 1_000_000_000, NOW_NS + 1])
def test_an_image_that_is_absent_old_or_from_the_future_is_no_image(seen_ns):
    assert first_missing(good_inputs(), seen_ns, CONFIG) == "camera"
