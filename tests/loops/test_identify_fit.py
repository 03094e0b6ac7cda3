"""truearc sysid on the emulated robot: faults and buttons end in HOLD; what is fitted is what its world was made of."""

import signal
import threading
import time
import tomllib

import msgspec
import pytest
from msgspec.structs import replace

from tests.faulty_robot import nodes_with
from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.cli.run_robot import ARM, drive_twin
from truearc.hw.devices.button_box import open_button_box
from truearc.robot.config.schema import Config, read_axis
from truearc.robot.reasons import DEVICE_STALE, IDENTIFY_DONE, IDENTIFY_RELEASED
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay
from truearc.robot.recording.session import load_trials
from truearc.sim.sysid.fit import fit_law, fit_motion
from truearc.sim.sysid.session import load_driven
from truearc.sim.world import drive
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.options import Options
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


MOTORS = len(CONFIG.axes.flywheels)


def repeated(flywheel, hood):
    both = {"flywheel": replace(CONFIG.identify.flywheel, repeats=flywheel),
            "hood": replace(CONFIG.identify.hood, repeats=hood)}
    return replace(CONFIG, identify=replace(CONFIG.identify, **both))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify") / "first"
    assert drive_twin(repeated(1, 2), folder, World(3), lambda text: None) == IDENTIFY_DONE()
    return folder


@pytest.fixture(scope="module")
def fits(session):
    driven = load_driven(session)
    assert driven.whole and not driven.warnings
    return {joint: fit_motion(record) for joint, record in driven.records.items()}


@pytest.mark.slow
def test_friction_inertia_and_delay_are_the_worlds(fits):
    fit = fits["flywheel"]
    assert fit.r2 > 0.9999
    assert fit.value("ka") * MOTORS == pytest.approx(drive.INERTIA_KG_M2, rel=0.005)
    assert fit.value("ks") * MOTORS == pytest.approx(drive.COULOMB_NM, rel=0.02)
    assert fit.value("kv") * MOTORS == pytest.approx(drive.VISCOUS_NM_S, rel=0.02)
    assert fit.value("kq") * MOTORS == pytest.approx(drive.WINDAGE_NM_S2, rel=0.02)
    fit = fits["hood"]
    assert fit.r2 > 0.9999
    for name, truth in (("ka", drive.SCREW_INERTIA_KG_M2), ("ks", drive.HOOD_COULOMB_NM),
                        ("ks_back", drive.HOOD_COULOMB_NM), ("kv", drive.SCREW_VISCOUS_NM_S)):
        assert fit.value(name) == pytest.approx(truth, rel=0.02), name
    for fit in fits.values():
        assert fit.value("delay_s") == pytest.approx(0.002 - 0.005, abs=0.0005)


@pytest.mark.slow
def test_another_worlds_inertia_is_found_without_being_told(tmp_path):
    world = World(1, Options(flywheel_inertia_scale=1.6, battery_start_v=12.0))
    assert drive_twin(repeated(1, 0), tmp_path / "s", world, lambda text: None) == IDENTIFY_DONE()
    driven = load_driven(tmp_path / "s")
    fit = fit_law(driven.records["flywheel"], windage=True)
    assert fit.value("ka") * MOTORS == pytest.approx(1.6 * drive.INERTIA_KG_M2, rel=0.01)


def merged(fragment: str) -> Config:
    """The shipped configuration with the fragment's keys pasted in."""
    def put(into: dict, what: dict) -> None:
        for key, value in what.items():
            if isinstance(value, dict):
                put(into[key], value)
            else:
                assert key in into, key
                into[key] = value
    whole = tomllib.loads(SHIPPED.read_text(encoding="utf-8"))
    put(whole, tomllib.loads(fragment))
    return msgspec.convert(whole, Config, dec_hook=read_axis)


@pytest.mark.slow
def test_the_door_writes_gains_that_the_robot_shoots_with(session, tmp_path, capsys):
    gains, page = tmp_path / "gains.toml", tmp_path / "page.html"
    before = SHIPPED.read_bytes()
    assert main(["sysid", str(session), "-o", str(gains), "--report", str(page), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert out == gains.read_text(encoding="utf-8") and "R^2" in out
    assert page.read_text(encoding="utf-8").count("<svg ") == 2
    assert main(["sysid", str(session), "-o", str(gains), "--quiet"]) == 2
    assert "exists already" in capsys.readouterr().err and SHIPPED.read_bytes() == before
    config = merged(out)
    assert config.flywheel.pid.kp != CONFIG.flywheel.pid.kp and config.hood.pid.kp != CONFIG.hood.pid.kp
    results = emulate(config, tmp_path / "shots", trials=2, seed=11)
    assert len(results) == 2
    assert all(trial.outcome.outcome != "held" for trial in load_trials(tmp_path / "shots"))
