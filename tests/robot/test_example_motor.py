"""The example of a motor driver outside the package: installed as a user would, the robot's tick drives it."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from tests.hw.family_checks import CHECKS, check_frames, codec_of
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.test_rig import ASKED, Time, Wire, rig_on
from tools.pages import reasons_page
from truearc import robot
from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.hw.devices import registry
from truearc.hw.devices.family import Bounds
from truearc.hw.protocols import Frame
from truearc.hw.reason import FAULT, Reason
from truearc.robot.config.schema import Config, config_hash, load_config
from truearc.robot.estimate import estimate
from truearc.robot.motors import guard
from truearc.robot.operator_ui.view import Told, tell
from truearc.robot.reasons import BAD_FRAME, NOT_ARMED, text
from truearc.robot.recording.replay import replay
from truearc.robot.recording.session import CAN, load_session_config
from truearc.robot.verdict import judge
from truearc.sim.world.emulated_robot import emulate

EXAMPLE = Path(robot.__file__).parent.parent / "examples" / "truearc-samplemotor"
FEEDER = re.search(r"    \[axes\.feeder\]\n(?:    .*\n)+", (EXAMPLE / "README.md").read_text(encoding="utf-8"))[0]
OTHER_FIRMWARE = {"is_driven": 0, "faults": 0, "current_a": 0.0, "bus_v": 12.0, "firmware": 7}
DUTY, CLEAR, MOTION, HEALTH = (base + 9 for base in (0x680, 0x6C0, 0x700, 0x740))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pip has put the example, without a network."""
    folder = tmp_path_factory.mktemp("installed")
    source = shutil.copytree(EXAMPLE, folder / "source")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--no-deps", "--no-build-isolation", "--no-index", "--target", str(folder / "site"),
                    str(source)], check=True)
    return folder / "site"


@pytest.fixture
def installed(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The example, importable for one test."""
    with monkeypatch.context() as patch:
        patch.syspath_prepend(site)
        patch.setenv("PYTHONPATH", str(site), prepend=os.pathsep)       # for the emulated camera's process
        yield site
    registry._load.cache_clear()
    registry.find_messages.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "truearc_samplemotor"]:
        del sys.modules[name]


@pytest.fixture
def toml(tmp_path: Path) -> Path:
    """The shipped launcher.toml with the feeder of the example's README."""
    table = "".join(line.removeprefix("    ") for line in FEEDER.splitlines(keepends=True))
    path = tmp_path / "launcher.toml"
    path.write_text(re.sub(r"\[axes\.feeder\]\n[^\[]*", table + "\n", SHIPPED.read_text(encoding="utf-8")))
    return path


@pytest.fixture
def config(installed: Path, toml: Path) -> Config:
    return load_config(toml)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_passes_what_built_in_families_pass(check, installed: Path) -> None:
    check(registry.find_family("samplemotor"))


def test_its_frames_come_back_as_they_went_out(installed: Path) -> None:
    check_frames(codec_of(registry.find_family("samplemotor")))


def test_the_robot_shoots_with_it_and_replays_the_recording(config: Config, tmp_path: Path) -> None:
    balls = emulate(config, tmp_path / "session", trials=1, seed=3)
    assert len(balls) == 1
    log = (tmp_path / "session" / CAN).read_text()
    assert len(re.findall(rf" {DUTY:03X}#[0-9A-F]{{8}} T", log)) > 100
    assert len(re.findall(rf" {MOTION:03X}#[0-9A-F]{{16}} R", log)) > 100
    assert config_hash(load_session_config(tmp_path / "session")) == config_hash(config)
    assert replay(tmp_path / "session").ticks > 200


def test_ticks_look_for_no_plugins(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    wire, clock = Wire(), Time()
    rig = rig_on(guard(wire, config, clock, Counter()), clock, config)
    monkeypatch.setattr(registry, "entry_points", lambda **group: pytest.fail("plugins were looked for"))
    for _ in range(20):
        rig.read()
        rig.write(ASKED)
    assert any(frame.arbitration_id == CLEAR for frame in wire.sent)


def test_its_own_reason_has_its_text_wherever_reasons_are_shown(config: Config) -> None:
    motor, = registry.find_family("samplemotor").make_motors([config.axes.feeder], [Bounds()])
    motor.take(Frame(1, HEALTH, codec_of(registry.find_family("samplemotor")).make("Health", OTHER_FIRMWARE)))
    fault, = (one.about(motor="feeder motor") for one in motor.faults(2))
    assert fault.code == "samplemotor.wrong_firmware"
    shown = "feeder motor: samplemotor node 9 has firmware 7, expected 1"
    assert text(fault) == shown and text(BAD_FRAME(cause=fault)) == f"bad frame: {shown}"
    assert tell([NOT_ARMED(), fault])[0] == Told(
        FAULT, "Feeder motor: unsupported firmware 7", "update it to 1", (shown,))
    verdict = judge(replace(good_inputs(), faults=(fault,)), estimate(good_inputs(), good_memory(), CONFIG),
                    good_memory().aim, good_memory(), CONFIG, None)
    assert not verdict.fire and verdict.reasons == (fault,)
    row = msgspec.json.encode(fault)
    assert msgspec.json.decode(row, type=Reason) == fault
    page = reasons_page(["samplemotor"])
    assert page.count("`samplemotor.wrong_firmware`") == 2 and "`samplemotor" not in reasons_page()


def test_a_reason_that_is_not_named_after_its_driver_is_refused(installed, tmp_path, toml, monkeypatch):
    (tmp_path / "unnamed.py").write_text(
        "from msgspec.structs import replace\nfrom truearc.hw.reason import Code, Message\n"
        "from truearc_samplemotor.family import SAMPLEMOTOR\n"
        "FAMILY = replace(SAMPLEMOTOR, messages=(Message(Code('can_lost', ''), 'fault', ''),))\n")
    with monkeypatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        patch.setattr(registry, "entry_points",
                      lambda **group: [EntryPoint("samplemotor", "unnamed:FAMILY", registry.GROUP)])
        with pytest.raises(InputError, match=r"unnamed:FAMILY: reason 'can_lost' must be named 'samplemotor\.WHAT'"):
            load_config(toml)


@pytest.mark.parametrize(("points", "message"), [
    (("samplemotor = nowhere:MOTOR",), "broken0 1.0: .*samplemotor = nowhere:MOTOR: ModuleNotFoundError: .*fix or"),
    (("samplemotor = math:pi",), "broken0 1.0: .*math:pi: is not a MotorFamily"),
    (("samplemotor = truearc.hw.devices.spark.family:SPARK",),
     "broken0 1.0: .*is not a MotorFamily whose driver and tag are 'samplemotor'"),
    (("samplemotor = math:pi", "samplemotor = math:tau"), "broken. 1.0: .* broken. 1.0: .* has the same name")])
def test_a_broken_distribution_is_named(points, message, toml, tmp_path, monkeypatch):
    for number, point in enumerate(points):
        info = tmp_path / "site" / f"broken{number}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: broken{number}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{point}\n")
    monkeypatch.syspath_prepend(tmp_path / "site")
    with pytest.raises(InputError, match=r"launcher\.toml:\d+: axes\.feeder: " + message):
        load_config(toml)
