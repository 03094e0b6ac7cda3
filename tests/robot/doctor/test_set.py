"""`truearc doctor --set` on emulated axes: it compares, asks, writes, saves and reads back; and where it refuses."""

import io
import itertools
import struct
import sys

import pytest
from msgspec.structs import replace

from tests.hw.spinning_plant import SpinningPlant
from tests.robot.good_tick import CONFIG
from tests.robot.sparks import ALL_SPARK
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.devices.family import Endpoints
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.emulated.nodes import StepClock, Twin
from truearc.hw.real.can_bus import open_can
from truearc.robot.doctor import check_stored, set_stored, stored_of
from truearc.sim.world.emulated_robot import make_nodes

ON, TIME, SPEED, CURRENT, SAVE = 400, 401, 402, 403, 404
TABLE = Endpoints("0.6.10", {
    "axis0.config.enable_watchdog": ON, "axis0.config.watchdog_timeout": TIME,
    "axis0.controller.config.vel_limit": SPEED, "axis0.config.motor.current_soft_max": CURRENT,
    "save_configuration": SAVE, "axis0.config.encoder_bandwidth": 405})
CHANNELS = itertools.count()


def bits(value: float) -> int:
    return int.from_bytes(struct.pack("<f", value), "little")


def value(node, endpoint: int) -> float:
    return struct.unpack("<f", dict(node.settings.parameters)[endpoint].to_bytes(4, "little"))[0]


class Bench:
    """Four axes as they come: no watchdog, and limits that are another motor's."""

    def __init__(self, **changes) -> None:
        plant = SpinningPlant()
        self.nodes = make_nodes(CONFIG, plant)
        for node in self.axes():
            node.settings = replace(node.settings, save_endpoint=SAVE, **{"parameters": (
                (ON, 0), (TIME, bits(0.0)), (SPEED, bits(10.0)), (CURRENT, bits(10.0)))} | changes)
            node.restart(0)
        self.clock = StepClock(lambda t_ns: self.twin.advance(t_ns))
        channel = f"set-{next(CHANNELS)}"
        self.near, self.far = (open_can("virtual", channel, 1_000_000, self.clock) for _ in range(2))
        self.twin = Twin(plant, self.far, tuple(self.nodes.values()))

    def axes(self):
        return [node for name, node in self.nodes.items() if name != "hood_encoder"]

    def set(self, yes: bool = True, table: Endpoints = TABLE) -> int:
        return set_stored(self.near, self.clock, CONFIG, table, yes)


def test_watchdogs_and_limits_are_written_saved_and_read_back(capsys) -> None:
    bench = Bench()
    assert bench.set() == 0
    for node in bench.axes():
        node.restart(bench.clock.now_ns())                 # power comes back
        assert dict(node.settings.parameters)[ON] == 1 and value(node, TIME) == pytest.approx(0.1)
    wheel, hood, feeder = bench.nodes["flywheel_a"], bench.nodes["hood"], bench.nodes["feeder"]
    assert value(wheel, SPEED) == pytest.approx(1.15 * 594.0 / 6.2832, rel=1e-3)       # of free speed, in rev/s
    assert value(wheel, CURRENT) == 66.0                   # 1.2 Nm at 0.02 Nm/A, and a tenth
    assert 1.5 * 100.0 < value(hood, SPEED) * 6.2832 < 250.0 and value(hood, CURRENT) == 17.0
    assert (value(feeder, SPEED), value(feeder, CURRENT)) == (10.0, 10.0)              # nothing is known of it
    assert "flywheel motor 1: axis0.controller.config.vel_limit is 10, the rig needs 108.7" in capsys.readouterr().out
    assert bench.set() == 0 and "4 axes are as this rig needs them" in capsys.readouterr().out


def test_the_doctor_names_what_differs_and_nothing_afterwards() -> None:
    from truearc.hw.devices.family import listen
    bench, known = Bench(), stored_of(CONFIG, TABLE)
    questions = [frame for one in known.values() for frame in one.questions()]
    levels = [one.level for one in check_stored(known, listen(bench.near, bench.clock, questions, 0.5))]
    bench.set()
    assert levels == ["warning"] * 4
    assert {one.level for one in check_stored(known, listen(bench.near, bench.clock, questions, 0.5))} == {"ok"}


def test_without_a_yes_nothing_is_written(monkeypatch, capsys) -> None:
    bench = Bench()
    before = [node.settings for node in bench.axes()]
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(InputError, match="expected --yes"):
        bench.set(yes=False)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", lambda question: "y")
    assert bench.set(yes=False) == 1 and "nothing was written" in capsys.readouterr().out
    assert [node.settings for node in bench.axes()] == before
    monkeypatch.setattr("builtins.input", lambda question: "Yes")
    assert bench.set(yes=False) == 0


@pytest.mark.parametrize(("change", "message"), [
    ({"firmware": (0, 6, 9)}, "flywheel motor 1: has firmware 0.6.9, got a table of 0.6.10"),
    ({"heartbeat_ms": 0}, "flywheel motor 1: is in state 0, expected 1, idle")])
def test_another_firmware_and_a_driven_axis_are_refused(change, message: str) -> None:
    bench = Bench(**change)
    with pytest.raises(InputError, match=message):
        bench.set()


def test_an_axis_that_is_driven_or_keeps_nothing_is_refused(capsys) -> None:
    bench = Bench(watchdog_ms=0)
    bench.near.write(odrive.make_state(odrive.OdriveAxis(1, 1), odrive.CLOSED_LOOP))
    with pytest.raises(InputError, match="flywheel motor 1: is in state 8"):
        bench.set()
    bench = Bench()
    bench.nodes["hood"].settings = replace(bench.nodes["hood"].settings, save_endpoint=0)
    assert bench.set() == 0                                # written, though it may not outlast its power
    bench = Bench(parameters=((ON, 0), (TIME, 0)))         # has no limits
    with pytest.raises(InputError, match="no answer after writing; nothing was saved"):
        bench.set()


def test_what_cannot_be_done_is_said_with_exit_code_two(capsys, tmp_path) -> None:
    assert main(["doctor", "--set", "--config", str(SHIPPED)]) == 2
    assert "--set needs --endpoints" in capsys.readouterr().err
    bench = Bench()
    with pytest.raises(InputError, match="has no endpoint 'save_configuration'"):
        bench.set(table=replace(TABLE, ids={key: at for key, at in TABLE.ids.items() if key != "save_configuration"}))
    with pytest.raises(InputError, match="none keeps settings"):
        set_stored(bench.near, bench.clock, ALL_SPARK, TABLE, True)
