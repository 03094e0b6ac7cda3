"""truearc sysid on the emulated robot: faults and buttons end in HOLD, and bad input is named."""

import signal
import threading
import time

import pytest
from msgspec.structs import replace

from tests.faulty_robot import nodes_with
from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.cli.run_robot import ARM, drive_twin
from truearc.hw.devices.button_box import open_button_box
from truearc.robot.reasons import DEVICE_STALE, IDENTIFY_RELEASED
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay
from truearc.sim.sysid.session import load_driven
from truearc.sim.world.world import World
from truearc_proof.world.faults import SILENT, Fault

SECOND = 1_000_000_000
FOREVER = 1 << 62


def only(joint):
    both = {name: replace(getattr(CONFIG.identify, name), repeats=int(name == joint)) for name in ("flywheel", "hood")}
    return replace(CONFIG, identify=replace(CONFIG.identify, **both))


@pytest.mark.parametrize(("device", "joint"), [("flywheel_b", "flywheel"), ("hood_encoder", "hood"),
                                               ("feeder", "hood")])
def test_a_reading_that_goes_stale_ends_it_in_hold(tmp_path, device, joint):
    fault = Fault(SILENT, 3 * SECOND, FOREVER)
    over = drive_twin(only(joint), tmp_path / "s", World(2), lambda text: None, nodes_of=nodes_with({device: (fault,)}))
    assert DEVICE_STALE.name in codes(over.params["causes"])
    last = [tick for tick, _ in TickReader(tmp_path / "s")][-1]
    assert not last.sent.enable_flywheel and last.sent.flywheel_torque_nm == last.sent.hood_torque_nm == 0.0
    assert last.inputs.t_ns <= 3 * SECOND + (CONFIG.gate.reading_age_s + 0.1) * SECOND
    assert not last.verdict.fire and last.verdict.reasons == (over,)
    assert replay(tmp_path / "s")[1] is None
    driven = load_driven(tmp_path / "s")
    assert not driven.whole and not driven.records and joint in driven.warnings[0]


def test_the_operators_button_ends_it(tmp_path, capsys):
    over = drive_twin(only("flywheel"), tmp_path / "s", World(2), lambda text: None, (*ARM, (4 * SECOND, "fire")))
    assert over == IDENTIFY_RELEASED(button="fire")
    assert main(["sysid", str(tmp_path / "s"), "--quiet"]) == 1
    assert "released by the operator" in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "words"), [
    ([], "give --config"), (["--emulate"], "needs --out"), (["--config", "nowhere.toml"], "nowhere.toml"),
    (["--csv", "nowhere.csv"], "nowhere.csv"), (["--emulate", "--out", "x", "--seed", "-1"], "--seed: got -1"),
    (["--csv", "a.csv", "-o", "no/such/gains.toml"], "no such directory"),
])
def test_bad_input_is_exit_2_with_a_name(arguments, words, capsys):
    assert main(["sysid", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_a_robot_without_the_section_is_told(tmp_path, capsys):
    text = SHIPPED.read_text(encoding="utf-8")
    begin, end = text.index("[identify.flywheel]"), text.index("[rig.ball]")
    (tmp_path / "old.toml").write_text(text[:begin] + text[end:], encoding="utf-8")
    assert main(["sysid", "--config", str(tmp_path / "old.toml")]) == 2
    assert "[identify] is missing" in capsys.readouterr().err


@pytest.fixture
def handlers():
    """The door takes over Ctrl-C; give it back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_real_door_with_silent_devices_ends_in_hold_and_leaves_a_session(tmp_path, handlers, capsys):
    """Real clock, a real serial port, a bus without devices: the operator arms, and nothing is ever driven."""
    box, over = open_button_box(), threading.Event()

    def operate():
        begin_ns, armed = time.monotonic_ns(), False
        while not over.wait(0.05):
            box.step(time.monotonic_ns() - begin_ns)
            if not armed and time.monotonic_ns() - begin_ns > SECOND // 2:
                box.press("arm")
                armed = True

    text = SHIPPED.read_text(encoding="utf-8").replace("/dev/buttonbox", box.port)
    text = text.replace('interface = "socketcan"', 'interface = "virtual"').replace('"can0"', f'"{tmp_path.name}"')
    (tmp_path / "launcher.toml").write_text(text, encoding="utf-8")
    operator = threading.Thread(target=operate)
    operator.start()
    try:
        code = main(["sysid", "--config", str(tmp_path / "launcher.toml"), "--out", str(tmp_path / "s")])
    finally:
        over.set()
        operator.join()
        box.unplug()
    said = capsys.readouterr().err
    assert code == 1 and "waiting for the axes" in said and "no frames received since the start" in said
    ticks = [tick for tick, _ in TickReader(tmp_path / "s")]
    assert any(tick.sent.enable_flywheel for tick in ticks)
    assert all(tick.sent.flywheel_torque_nm == tick.sent.hood_torque_nm == 0.0 for tick in ticks)
    assert replay(tmp_path / "s")[1] is None
