"""The files and commands of deploy: checked by systemd's own verifier, by a shell, and by running them on stand-ins."""

import configparser
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec import Struct
from msgspec.structs import replace

import truearc.cli.deploy
from tests.robot.gate.test_model import build
from tests.robot.good_tick import CONFIG
from truearc import robot
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.devices.family import Axis
from truearc.robot import deploy
from truearc.robot.config.schema import Config, RecordingConfig, load_config, parse_toml
from truearc.robot.sysid import HOME

PARTS = deploy.Parts(True, True, False, 3, 50, "", "2341:8036", 5.0)
PLUGIN = Path(robot.__file__).parents[1] / "examples" / "truearc-samplemotor"
needs_shell = pytest.mark.skipif(sys.platform == "win32", reason="the robot's computer has a POSIX shell")


def with_can(**changes):
    return replace(CONFIG, can=replace(CONFIG.can, **changes))


def sections(text):
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str
    parser.read_string(text)
    return parser


def verify(tmp_path, text):
    path = tmp_path / deploy.UNIT
    said = subprocess.run(["systemd-analyze", "--version"], capture_output=True, text=True, check=True).stdout
    if int(said.split()[1]) < 254:                # as install.sh does
        text = text.replace("RestartSteps=5\nRestartMaxDelaySec=10\n", "")
    path.write_text(text.replace(deploy.PROGRAM, shutil.which("true")))      # the program itself is not installed here
    done = subprocess.run(["systemd-analyze", "verify", str(path)], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("config", [CONFIG, with_can(channel="can-launch"), with_can(interface="slcan")],
                         ids=["can0", "can-launch", "slcan"])
def test_systemd_accepts_the_unit(tmp_path, config):
    assert verify(tmp_path, deploy.make_files(config, PARTS)[deploy.UNIT]) == (0, "")


def test_the_unit_restarts_watches_and_is_real_time():
    service = sections(deploy.make_files(CONFIG, PARTS)[deploy.UNIT])["Service"]
    assert service["ExecStart"] == (f"{deploy.PROGRAM} run --config /etc/truearc/launcher.toml --gate "
                                    "/etc/truearc/gate.onnx --out /var/lib/truearc/sessions --priority 50 --core 3")
    assert sections(deploy.make_files(CONFIG, PARTS)[deploy.UNIT])["Unit"]["StartLimitIntervalSec"] == "0"
    for key, value in {"Type": "notify", "WatchdogSec": "1", "Restart": "always", "CPUSchedulingPolicy": "fifo",
                       "RestartSec": "0.5", "RestartSteps": "5", "RestartMaxDelaySec": "10", "MemoryMax": "700M",
                       "CPUSchedulingPriority": "50", "LimitRTPRIO": "60", "LimitMEMLOCK": "infinity"}.items():
        assert service[key] == value
    assert " --core" not in deploy.make_files(CONFIG, replace(PARTS, core=None))[deploy.UNIT]


def test_can_comes_up_as_configured_by_name_and_serial_number():
    files = deploy.make_files(with_can(bitrate=500_000), PARTS)
    network, link = sections(files[deploy.NETWORK]), sections(files[deploy.LINK])
    assert network["Match"]["Name"] == "can0" and dict(network["CAN"]) == {"BitRate": "500000", "RestartSec": "100ms"}
    assert link["Link"]["TransmitQueueLength"] == "64" and link["Match"]["OriginalName"] == "can0"
    config = with_can(channel="canlaunch")
    parts = deploy.make_parts(config, replace(PARTS, can_serial="00350042"))
    link = sections(deploy.make_files(config, parts)[deploy.LINK])
    assert link["Match"]["Property"] == "ID_SERIAL_SHORT=00350042" and link["Link"]["Name"] == "canlaunch"
    files = deploy.make_files(with_can(interface="slcan", channel="/dev/ttyACM0"), PARTS)
    assert set(files) == {deploy.UNIT, deploy.RULES, deploy.INSTALL} and "networkd" not in files[deploy.INSTALL]


def test_devices_get_lasting_names_and_a_fixed_exposure():
    box, camera = deploy.make_rules(CONFIG, PARTS).splitlines()
    assert 'ATTRS{idVendor}=="2341", ATTRS{idProduct}=="8036", SYMLINK+="buttonbox"' in box
    assert 'KERNEL=="video0"' in camera and "exposure_time_absolute=50" in camera      # 5 ms in 0.1 ms
    by_path = replace(CONFIG, camera=replace(CONFIG.camera, device="/dev/v4l/by-path/usb-0:1:1.0-video-index0"))
    rules = deploy.make_rules(by_path, deploy.make_parts(by_path, PARTS))
    assert 'SYMLINK=="v4l/by-path/usb-0:1:1.0-video-index0"' in rules
    assert deploy.make_rules(CONFIG, replace(PARTS, box_usb="", exposure_ms=None)) == ""


@pytest.mark.parametrize(("config", "changes", "words"), [
    (CONFIG, {"can_serial": "0035"}, "'can0' is a name that the kernel gives out"),
    (CONFIG, {"can_serial": "a b"}, "--can-serial 'a b'"),
    (CONFIG, {"box_usb": "2341"}, "--box-usb"),
    (CONFIG, {"box_usb": '2341:80"6'}, "--box-usb"),
    (replace(CONFIG, buttons=replace(CONFIG.buttons, port="socket://box:1")), {}, "socket://box:1"),
    (CONFIG, {"exposure_ms": 51.0}, "--exposure-ms 51"),
    (CONFIG, {"exposure_ms": float("nan")}, "--exposure-ms nan"),
    (CONFIG, {"priority": 61}, "--priority 61"),
    (CONFIG, {"core": -1}, "--core -1"),
    (with_can(channel="can0; reboot"), {}, "can0; reboot"),
    (replace(CONFIG, gate=replace(CONFIG.gate, policy="model")), {"has_gate": False}, "--gate")])
def test_what_cannot_be_is_named(config, changes, words):
    with pytest.raises(InputError, match=words):
        deploy.make_parts(config, replace(PARTS, **changes))


class Computer:
    """A stand-in for the robot's computer: a folder for its files, and commands that only note that they ran."""

    def __init__(self, folder):
        self.folder, self.log = folder, folder / "log"
        self.bin, stage = folder / "bin", folder / "stage"
        for place in (self.bin, stage / "wheels"):
            place.mkdir(parents=True)
        for name in ("useradd", "install", "udevadm", "rm"):
            self.put(name, "exit 0")
        self.put("systemctl", '[ "$1" != --version ] || echo "systemd ${SYSTEMD-257} (${SYSTEMD-257}.1)"')
        self.put("id", "exit 1")                              # no such user yet
        self.put("systemd-run", "exit ${DOCTOR:-0}")
        self.put("python3", f'mkdir -p "$3/bin" && cp {self.bin}/pip-python "$3/bin/python"')
        self.put("pip-python", "exit ${PIP:-0}")
        for name, text in deploy.make_files(CONFIG, PARTS).items():
            (stage / name).write_text(text.replace(HOME, str(folder / "opt")))
        for name in ("wheels/truearc-0.1.0-py3-none-any.whl", "launcher.toml"):
            (stage / name).touch()
        self.stage = stage

    def put(self, name, does):
        path = self.bin / name
        path.write_text(f'#!/bin/sh\necho "{name} $*" >> {self.log}\n{does}\n')
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def install(self, **settings):
        path = f"{self.bin}{os.pathsep}{os.environ['PATH']}"
        done = subprocess.run(["sh", str(self.stage / deploy.INSTALL)], env={"PATH": path} | settings,
                              capture_output=True, text=True, check=False)
        self.said = done.stdout
        return done.returncode, done.stderr, self.log.read_text().splitlines()


def place(log, start):
    return next(number for number, row in enumerate(log) if row.startswith(start))


@needs_shell
def test_the_script_stops_installs_asks_the_doctor_and_starts(tmp_path):
    code, err, log = Computer(tmp_path).install()
    assert code == 0 and err == ""
    order = ["systemctl stop truearc", "useradd", "python3 -m venv", "pip-python -m pip install",
             "install -m 644 launcher.toml", f"install -D -m 644 {deploy.UNIT}", f"install -D -m 644 {deploy.RULES}",
             "udevadm control --reload", "systemctl restart systemd-networkd", "systemctl daemon-reload",
             "systemctl enable --quiet truearc", "systemd-run", "systemctl restart --no-block truearc"]
    assert [place(log, start) for start in order] == sorted(place(log, start) for start in order)
    assert "--priority 50" in log[place(log, "systemd-run")] and "LimitRTPRIO=60" in log[place(log, "systemd-run")]
    assert not any("--no-index --find-links" in row for row in log)


@needs_shell
def test_a_doctor_that_finds_failures_is_the_exit_code_and_the_robot_starts_all_the_same(tmp_path):
    code, _, log = Computer(tmp_path).install(DOCTOR="1")
    assert code == 1 and log[-1] == "systemctl restart --no-block truearc.service"


@needs_shell
def test_a_step_that_fails_ends_it_and_says_that_the_robot_is_stopped(tmp_path):
    code, err, log = Computer(tmp_path).install(PIP="7")
    assert code == 7 and "NOT FINISHED" in err
    assert not any(row.startswith("systemd-run") or "restart" in row for row in log)


@needs_shell
@pytest.mark.parametrize(("version", "backs_off"), [("252", False), ("253", False), ("254", True), ("260~rc1", True),
                                                    ("unreadable", False)])
def test_a_systemd_without_back_off_is_named_and_not_told_of_it(tmp_path, version, backs_off):
    computer = Computer(tmp_path)
    code, _, _ = computer.install(SYSTEMD=version)
    unit = (computer.stage / deploy.UNIT).read_text()
    assert code == 0 and ("RestartSteps" in unit, "RestartMaxDelaySec" in unit) == (backs_off, backs_off)
    assert "RestartSec=0.5\n" in unit and ("starts again in 0.5 s" in computer.said) != backs_off


@pytest.mark.parametrize("own", ["[recording]\n", "[recording]\nkeep_gb = 2.0\n"])
def test_a_recording_section_of_ones_own_stays_as_it_is(own):
    text = SHIPPED.read_text() + own
    assert deploy.make_config(text, parse_toml(text, Config, "a")) == text


@needs_shell
def test_plugins_come_with_the_program_and_wheels_for_all_need_no_network(tmp_path):
    computer = Computer(tmp_path)
    (computer.stage / "wheels" / "numpy-2.4.6-cp311.whl").touch()
    (computer.stage / "plugins").mkdir()
    for name in ("one", "two"):
        (computer.stage / "plugins" / f"{name}-1-py3-none-any.whl").touch()
    _, _, log = computer.install()
    pips = [row for row in log if "pip install" in row]
    wheels = ("wheels/truearc-0.1.0-py3-none-any.whl", *(f"plugins/{one}-1-py3-none-any.whl" for one in ("one", "two")))
    assert len(pips) == 2 and all("--no-index" in row and row.endswith(" ".join(wheels)) for row in pips)


def test_a_plugin_is_built_without_what_was_built_before_and_a_wheel_taken_as_it_is(tmp_path, monkeypatch):
    source = shutil.copytree(PLUGIN, tmp_path / "plugin")
    (source / "build").mkdir()
    (tmp_path / "other-1-py3-none-any.whl").write_bytes(b"wheel")
    ran = []

    def run(command, check):
        ran.append(command)
        if "wheel" in command and "plugin-0" in command[-1]:
            assert (Path(command[-1]) / "pyproject.toml").exists() and not (Path(command[-1]) / "build").exists()
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(truearc.cli.deploy.subprocess, "run", run)
    assert main(["deploy", "launcher", "--config", str(SHIPPED), "--plugin", str(source),
                 "--plugin", str(tmp_path / "other-1-py3-none-any.whl")]) == 0
    wheels = [command for command in ran if "wheel" in command]
    assert [Path(command[-1]).name for command in wheels] == ["source", "plugin-0", "other-1-py3-none-any.whl"]
    assert [Path(command[-2]).name for command in wheels] == ["wheels", "plugins", "plugins"]


def test_a_driver_of_another_distribution_needs_a_plugin():
    class Foreign(Axis, Struct, frozen=True, tag_field="driver", tag="foreign"):
        pass

    config = replace(CONFIG, axes=replace(CONFIG.axes, feeder=Foreign()))
    with pytest.raises(InputError, match="feeder motor: driver 'foreign' is of another distribution; --plugin"):
        deploy.make_parts(config, PARTS)
    assert deploy.make_parts(config, replace(PARTS, has_plugins=True)).has_plugins


def test_a_dry_run_prints_every_command_and_file_and_does_nothing(tmp_path, monkeypatch, capsys):
    # its own alone: the gate is tried in another process
    monkeypatch.setattr(truearc.cli.deploy, "subprocess", None)
    (tmp_path / "gate.onnx").write_bytes(build())
    assert main(["deploy", "pi@launcher.local", "--config", str(SHIPPED), "--gate", str(tmp_path / "gate.onnx"),
                 "--dry-run"]) == 0
    out = capsys.readouterr().out
    for words in ("pip wheel", "$ scp ", "'sudo sh truearc-deploy/install.sh'", "gate.onnx: a copy of", "[Service]",
                  "BitRate=1000000", "#!/bin/sh"):
        assert words in out
    assert [path.name for path in tmp_path.iterdir()] == ["gate.onnx"]


def test_the_staged_folder_is_carried_over_and_a_failing_command_ends_it(tmp_path, monkeypatch, capsys):
    ran = []

    def run(command, check):
        ran.append(command)
        if command[0] == "scp":
            stage = Path(command[3])
            text = SHIPPED.read_text().rstrip() + "\n" + deploy.RECORDING
            assert (stage / "launcher.toml").read_bytes() == text.encode()
            assert load_config(stage / "launcher.toml").recording == RecordingConfig(8.0, 120.0)
            assert (stage / "wheels" / "numpy-1.whl").read_bytes() == b"wheel" and (stage / deploy.UNIT).exists()
            assert b"\r" not in (stage / deploy.INSTALL).read_bytes()
        return subprocess.CompletedProcess(command, 1 if command[0] == "ssh" and "sudo" in command[-1] else 0)

    monkeypatch.setattr(truearc.cli.deploy.subprocess, "run", run)
    (tmp_path / "numpy-1.whl").write_bytes(b"wheel")
    assert main(["deploy", "launcher", "--config", str(SHIPPED), "--wheels", str(tmp_path)]) == 1
    assert [command[0] for command in ran] == [sys.executable, "ssh", "scp", "ssh"]
    assert all(isinstance(word, str) for command in ran for word in command) and ran[2][-1] == "launcher:truearc-deploy"
    assert "exit code 1 from: ssh -t launcher" in capsys.readouterr().err
    assert not Path(ran[2][3]).exists()                       # nothing stays behind


@pytest.mark.parametrize("words", [
    ["-oProxyCommand=x"], ["pi@"], ["pi@host;reboot"], ["pi@launcher", "--gate", "nowhere.onnx"],
    ["pi@launcher", "--endpoints", "nowhere.json"], ["pi@launcher", "--wheels", "nowhere"],
    ["pi@launcher", "--plugin", "nowhere.whl"], ["pi@launcher", "--priority", "99"]])
def test_bad_input_ends_with_2_and_runs_nothing(words, monkeypatch, capsys):
    monkeypatch.setattr(truearc.cli.deploy.subprocess, "run", lambda *_, **__: pytest.fail("ran something"))
    if words[0].startswith("-"):
        words = ["--", *words]
    assert main(["deploy", "--config", str(SHIPPED), *words]) == 2
    assert words[-1].removeprefix("pi@") in capsys.readouterr().err
