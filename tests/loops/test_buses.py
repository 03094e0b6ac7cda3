"""The same short session, armed, homed and fired, on every bus; and a bus that is pulled out in the middle of one."""

import itertools
import os
import re
import signal
import threading
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from benchmarks.real_robot import PATIENT, SHIPPED, WATCHDOG_MS, begin, save_config
from tests.hw.host_speed import excuse_stalls
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import load_config, split_bus, with_ports
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import Trial
from truearc.sim.world.emulated_robot import keep_time, open_device_bus

LIMIT_S = 240.0

posix = pytest.mark.skipif(os.name != "posix", reason="ends the robot with a signal")
FAST_VCAN = (pytest.mark.socketcan, pytest.mark.fast_bus)
BUSES = ["virtual", pytest.param("slcan:auto", marks=[posix, pytest.mark.slow]),
         pytest.param("slcan:socket", marks=[posix, pytest.mark.slow]),
         pytest.param("socketcan:vcan0", marks=[posix, pytest.mark.slow, *FAST_VCAN])]


@pytest.fixture
def config_path(tmp_path: Path) -> Path:
    """The shipped configuration with the patience of a machine that runs tests; its emulated world may be slower than
    the robot too: a ball takes longer to feed, but the next comes no sooner than in 0.6 s."""
    return save_config(tmp_path / "launcher.toml", PATIENT | {"fps = 20.0": "fps = 5.0"})


def shoot_in_two(bus: str, config_path: Path, out: Path) -> tuple[Path, str, str]:
    """One trial with the robot and its devices in two processes; the session, and what either has said."""
    devices = begin("-m", "truearc", "emulate", "--trials", 1, "--seed", 3, "--bus", bus, "--config", config_path,
                    "--watchdog-ms", WATCHDOG_MS)
    late = threading.Timer(LIMIT_S, devices.kill)
    late.start()
    try:
        assert devices.stdout is not None and devices.stderr is not None
        devices.stdout.readline()
        command = devices.stdout.readline().split()
        assert command[:2] == ["truearc", "run"], devices.stderr.read()
        near = begin("-m", *command, "--out", out)
        said, _ = devices.communicate()
        near.send_signal(signal.SIGTERM)
        recorded, complaint = near.communicate(timeout=LIMIT_S)
        assert devices.returncode == 0 and near.returncode == 0, complaint
    finally:
        late.cancel()
        devices.kill()
    return next(out.iterdir()), said, recorded


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Trial:
    """The session that all buses should give, except for effects of time: on the virtual bus, in stepped time."""
    folder = tmp_path_factory.mktemp("reference") / "session"
    assert main(["emulate", "--quiet", "--trials", "1", "--seed", "3", "--out", str(folder)]) == 0
    return read_trial(folder)


def tell(session: Path) -> str:
    """Button events, faults and reasons for a HOLD, for the message of a failed test."""
    ticks = [tick for tick, _ in TickReader(session)]
    heard = [f"{tick.inputs.cycle}: {[event.button for event in tick.inputs.buttons]} {tick.inputs.faults}"
             for tick in ticks if tick.inputs.buttons or tick.inputs.faults]
    return "\n".join([*heard[:50], f"last: {ticks[-1].verdict.reasons}"])


def read_trial(session: Path) -> Trial:
    (line,) = (session / "trials.jsonl").read_bytes().splitlines()
    return msgspec.json.decode(line, type=Trial)


@pytest.mark.parametrize("bus", BUSES)
def test_the_same_session_on_every_bus(bus: str, config_path: Path, tmp_path: Path, reference: Trial, capsys) -> None:
    if bus == "virtual":
        session = tmp_path / "session"
        assert main(["emulate", "--quiet", "--trials", "1", "--seed", "3", "--out", str(session)]) == 0
        check_session(session, capsys.readouterr().out, "", reference)
        return
    with excuse_stalls():
        check_session(*shoot_in_two(bus, config_path, tmp_path / "out"), reference)


def check_session(session: Path, said: str, recorded: str, reference: Trial) -> None:
    """One ball, launched as in the reference by a robot that was armed and homed, and nothing odd on the bus."""
    assert not re.search("not allowed|unknown|another host|garbled", recorded), recorded
    assert (session / "trials.jsonl").read_bytes(), said + recorded + tell(session)
    trial = read_trial(session)
    assert "1 ball launched (" in said and f"1 {trial.outcome.outcome}" in said      # as the world saw it
    assert trial.shot is not None and reference.shot is not None
    assert trial.shot.distance_m == pytest.approx(reference.shot.distance_m, abs=0.06)
    assert trial.shot.hood_deg == pytest.approx(reference.shot.hood_deg, abs=0.7)      # both within 0.3 of the aim
    assert trial.shot.motor_rad_s == pytest.approx(reference.shot.motor_rad_s, abs=8.0)
    ticks = [tick for tick, _ in TickReader(session)]
    assert [sum(tick.verdict.fire for tick in ticks), ticks[0].memory.armed, ticks[0].memory.homed] == [1, False, False]
    fired = next(tick for tick in ticks if tick.verdict.fire)
    assert fired.memory.armed and fired.memory.homed and not fired.inputs.faults


CONFIG = load_config(SHIPPED)
CONFIG = replace(CONFIG, gate=replace(CONFIG.gate, reading_age_s=1.0))


def test_ports_on_the_command_line_take_the_place_of_the_configurations() -> None:
    config = with_ports(CONFIG, "slcan:socket://127.0.0.1:5000", "/dev/pts/3", "http://127.0.0.1:5001/")
    assert (config.can.interface, config.can.channel) == ("slcan", "socket://127.0.0.1:5000")
    assert (config.buttons.port, config.camera.device) == ("/dev/pts/3", "http://127.0.0.1:5001/")
    assert replace(config, can=CONFIG.can, buttons=CONFIG.buttons, camera=CONFIG.camera) == CONFIG
    assert with_ports(CONFIG, None, None, None) == CONFIG


@pytest.mark.parametrize("bus", ["slcan", "", ":can0", "slcan:"])
def test_a_bus_that_is_no_bus_is_named(bus: str) -> None:
    with pytest.raises(InputError, match=f"--can {bus}: an interface and a channel"):
        split_bus(bus, "--can")


@pytest.mark.parametrize("bus", ["slcan:/dev/ttyACM0", "pcan:0", "socketcan:nosuchcan7"])
def test_a_far_end_that_cannot_be_had_is_named(bus: str) -> None:
    with pytest.raises(InputError, match=f"--bus {bus}"):
        open_device_bus(bus, CONFIG, MonotonicClock())


def test_a_world_keeps_time_and_stands_still_where_the_machine_did() -> None:
    class Clock:
        t_ns = 0

        def now_ns(self) -> int:
            return self.t_ns

        def sleep_until_ns(self, t_ns: int) -> None:
            self.t_ns = max(self.t_ns, t_ns)

    clock, moments = Clock(), []

    def advance(t_ns: int) -> None:
        moments.append((t_ns, clock.t_ns))
        clock.t_ns += 10_000_000_000 if len(moments) == 100 else 0

    keep_time(clock, advance, lambda: len(moments) == 200)
    steps = {later[0] - sooner[0] for sooner, later in itertools.pairwise(moments)}
    assert steps == {2_000_000}                        # never a leap, for the devices' watchdogs would bite
    assert moments[98][1] == moments[98][0] and moments[-1][1] == moments[-1][0] + 10_000_000_000 - 2_000_000
