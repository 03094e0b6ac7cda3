"""The text of the files that make a computer start truearc at boot, and the options that determine it.

The files are the systemd unit, the CAN bring-up, the device names and the script that installs them. The longer ones
are in `files/`, with placeholders such as `@USER@`. `truearc/cli/deploy.py` copies the files to the computer, together
with wheels built from clean copies of the sources.
"""

import re
import shutil
from collections.abc import Iterator
from importlib.resources import files as resources
from pathlib import Path
from types import MappingProxyType

from msgspec import Struct

from truearc.errors import INSTALL_HINTS, InputError
from truearc.hw.devices import family, registry
from truearc.robot.aim_file import needs_aim
from truearc.robot.config.named_tables import distribution_of_table
from truearc.robot.config.schema import Config
from truearc.robot.motors import name_axes

HIGHEST_PRIORITY = 60                 # that the service may ask for


class Parts(Struct, frozen=True):
    """Properties of a computer that are not in the configuration; None or "" = leave it as it is."""

    has_gate: bool
    has_endpoints: bool
    has_plugins: bool                 # other distributions are carried along
    core: int | None
    priority: int
    can_serial: str                   # of the CAN adapter: it then has its name whatever port it is plugged into
    box_usb: str                      # vendor:product of the button box, four hexadecimal digits each
    exposure_ms: float | None
    has_aim: bool = False


def make_parts(config: Config, parts: Parts) -> Parts:
    """Return `parts`, checked against the configuration; InputError names an invalid option."""
    for wrong in (*_missing_plugins(config, parts), *_wrong_names(config, parts), *_wrong_numbers(config, parts)):
        raise InputError(wrong)
    return parts


def _missing_plugins(config: Config, parts: Parts) -> Iterator[str]:
    for name, axis in name_axes(config):
        if (driver := family.driver_of(axis)) not in registry.BY_DRIVER and not parts.has_plugins:
            yield f"{name}: driver {driver!r} is of another distribution; --plugin names its wheel or source folder"
    for name in config.readings:
        if distribution_of_table(name) not in INSTALL_HINTS and not parts.has_plugins:
            yield f"[{name}] is of another distribution; --plugin names its wheel or source folder"


def _wrong_names(config: Config, parts: Parts) -> Iterator[str]:
    channel = config.can.channel
    if config.can.interface == "socketcan" and not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,14}", channel):
        yield f"[can] channel {channel!r}: not the name of a network interface"
    if parts.can_serial and not re.fullmatch(r"[A-Za-z0-9._-]+", parts.can_serial):
        yield f"--can-serial {parts.can_serial!r}: not as `udevadm info` prints ID_SERIAL_SHORT"
    if parts.can_serial and re.fullmatch(r"can\d+", channel):
        yield (f"--can-serial: [can] channel {channel!r} is a name that the kernel gives out itself; call it something "
               "else, such as 'canlaunch'")
    if parts.box_usb and not re.fullmatch(r"[0-9a-f]{4}:[0-9a-f]{4}", parts.box_usb):
        yield f"--box-usb {parts.box_usb!r}: vendor:product as `lsusb` prints them, such as 2341:8036"
    if parts.box_usb and not re.fullmatch(r"/dev/[A-Za-z0-9_-]+", config.buttons.port):
        yield f"--box-usb: [buttons] port {config.buttons.port!r} is not a name directly in /dev"
    if parts.exposure_ms is not None and not re.fullmatch(r"/dev/[\w./:+-]+|\d+", config.camera.device):
        yield f"--exposure-ms: [camera] device {config.camera.device!r} is not a V4L2 device"


def _wrong_numbers(config: Config, parts: Parts) -> Iterator[str]:
    longest_ms = 1000.0 / config.camera.fps
    if parts.exposure_ms is not None and not 0.1 <= parts.exposure_ms <= longest_ms:
        yield f"--exposure-ms {parts.exposure_ms:g}: 0.1 to {longest_ms:g}, the time from one image to the next"
    if not 1 <= parts.priority <= HIGHEST_PRIORITY:
        yield f"--priority {parts.priority}: 1 to {HIGHEST_PRIORITY}, which the service is allowed"
    if parts.core is not None and parts.core < 0:
        yield f"--core {parts.core}: cores count from 0"
    if config.gate.policy == "model" and not parts.has_gate:
        yield "gate.policy is 'model', so --gate is needed"
    if needs_aim(config) != parts.has_aim:
        yield f"aim.policy is {config.aim.policy!r}, so --aim is " + ("needed" if needs_aim(config) else "not used")


HOME = "/opt/truearc"                 # the virtual environment
SETTINGS = "/etc/truearc"             # launcher.toml, gate.onnx, aim.json
STATE = "/var/lib/truearc"            # sessions
INBOX = f"{STATE}/aims"               # aim files that are offered to the driver
USER = "truearc"
PROGRAM = f"{HOME}/venv/bin/truearc"
FIXED = {"HOME": HOME, "SETTINGS": SETTINGS, "STATE": STATE, "INBOX": INBOX, "USER": USER, "PROGRAM": PROGRAM,
         "HIGHEST_PRIORITY": HIGHEST_PRIORITY}
# A season from its first practice to the last match; 20 hours of ticks at 0.4 GB/h, which leaves half of the smallest
# card (16 GB) to the system.
RECORDING = """
# Written by `truearc deploy`, which leaves a [recording] of your own as it is; an empty one keeps every session whole.
[recording]
keep_gb = 8.0
keep_days = 120.0
"""
CONFIG = "launcher.toml"
QUEUE_FRAMES = 64                     # longer only makes set points older; the kernel's ten are refused in one tick
RESTART_MS = 100                      # after bus-off
UNIT, LINK, NETWORK, RULES, UNMANAGED, INSTALL = (
    "truearc.service", "60-truearc-can.link", "60-truearc-can.network", "70-truearc.rules", "60-truearc.conf",
    "install.sh")
PLACES = MappingProxyType({
    UNIT: "/etc/systemd/system", LINK: "/etc/systemd/network", NETWORK: "/etc/systemd/network",
    RULES: "/etc/udev/rules.d", UNMANAGED: "/etc/NetworkManager/conf.d"})


def make_config(text: str, config: Config) -> str:
    """Return the robot's launcher.toml, with limits for its recordings if it states none."""
    return text if config.recording is not None else text.rstrip("\n") + "\n" + RECORDING


def make_files(config: Config, parts: Parts) -> dict[str, str]:
    """Return name -> text of every file that is copied, besides the wheel, configuration and model."""
    files = {UNIT: make_unit(config, parts)}
    if config.can.interface == "socketcan":
        files |= {LINK: make_link(config.can.channel, parts.can_serial),
                  NETWORK: make_network(config.can.channel, config.can.bitrate),
                  UNMANAGED: f"[keyfile]\nunmanaged-devices=interface-name:{config.can.channel}\n"}
    if rules := make_rules(config, parts):
        files[RULES] = rules
    return files | {INSTALL: make_install(config, parts, tuple(files))}


def make_unit(config: Config, parts: Parts) -> str:
    """Return the service unit. It waits for the CAN interface but does not stop with it: an unplugged adapter is a
    HOLD."""
    escaped = config.can.channel.replace("-", "\\x2d")         # as systemd-escape does
    device = f"sys-subsystem-net-devices-{escaped}.device"
    waits = f"Wants={device}\nAfter={device}\n" if config.can.interface == "socketcan" else ""
    models = _models(parts) + (f" --aim-inbox {INBOX}" if parts.has_aim else "")
    core = "" if parts.core is None else f" --core {parts.core}"
    options = f"--out {STATE}/sessions --priority {parts.priority}{core}"
    return _filled("truearc.service", WAITS=waits, OPTIONS=f"{models} {options}", PRIORITY=parts.priority)


def make_link(channel: str, serial: str) -> str:
    """Return the interface's queue and, with the adapter's serial number, its name."""
    match, name = (f"Property=ID_SERIAL_SHORT={serial}", f"Name={channel}\n") if serial else (
        f"OriginalName={channel}", "")
    return f"[Match]\n{match}\n\n[Link]\n{name}TransmitQueueLength={QUEUE_FRAMES}\n"


def make_network(channel: str, bitrate: int) -> str:
    """Return the interface's bitrate, and its retry delay after bus-off."""
    return (f"[Match]\nName={channel}\n\n[Link]\nRequiredForOnline=no\n\n[CAN]\nBitRate={bitrate}\n"
            f"RestartSec={RESTART_MS}ms\n")


def make_rules(config: Config, parts: Parts) -> str:
    """Return a persistent name for the button box and a fixed exposure for the camera; "" if neither was requested."""
    rules = ""
    if parts.box_usb:
        vendor, product = parts.box_usb.split(":")
        rules += (f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
                  f'SYMLINK+="{config.buttons.port.removeprefix("/dev/")}", GROUP="dialout", MODE="0660"\n')
    if parts.exposure_ms is not None:
        device = config.camera.device
        name = f"/dev/video{device}" if device.isdecimal() else device
        match = "KERNEL" if re.fullmatch(r"/dev/video\d+", name) else "SYMLINK"
        rules += (f'ACTION=="add", SUBSYSTEM=="video4linux", {match}=="{name.removeprefix("/dev/")}", '
                  'RUN+="/usr/bin/v4l2-ctl --device $devnode --set-ctrl auto_exposure=1 '
                  f'--set-ctrl exposure_time_absolute={round(parts.exposure_ms * 10)}"\n')     # of 0.1 ms
    return rules


def make_install(config: Config, parts: Parts, files: tuple[str, ...]) -> str:
    """Return the script that root runs on the robot's computer in the copied folder; its exit code is the doctor's."""
    networking = ""
    if config.can.interface == "socketcan":
        networking = "\n" + _filled("networking.sh", CHANNEL=config.can.channel)
    endpoints = f" --endpoints {SETTINGS}/flat_endpoints.json" if parts.has_endpoints else ""
    look = (f"{PROGRAM} doctor --config {SETTINGS}/launcher.toml{_models(parts)}{endpoints} --out {STATE}/sessions "
            f"--priority {parts.priority}")
    placed = "\n".join(f"install -D -m 644 {name} {PLACES[name]}/{name}" for name in files)
    return _filled("install.sh", FILES=placed, NETWORKING=networking, DOCTOR=look)


def _filled(name: str, **values: object) -> str:
    """The text of a file of `files/`, with the values in their places."""
    text = (resources("truearc.robot.deploy") / "files" / name).read_text(encoding="utf-8")
    return re.sub("@([A-Z_]+)@", lambda place: str((FIXED | values)[place[1]]), text)


def _models(parts: Parts) -> str:
    return "".join(f" --{option} {SETTINGS}/{file}" for option, file, carried in (
        ("gate", "gate.onnx", parts.has_gate), ("aim", "aim.json", parts.has_aim)) if carried)


PARTS = ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "truearc", "hw", "robot", "sim", "model_export")
IGNORE = shutil.ignore_patterns("__pycache__", "*.pyc", "*.egg-info", "build", "dist", ".*")


def copy_source(checkout: Path, to: Path) -> Path:
    """Copy the sources of a truearc wheel into the new folder `to`; return `to`."""
    def ignore(folder: str, names: list[str]) -> set[str]:
        others = set(names) - set(PARTS) if Path(folder) == checkout else set()
        return others | IGNORE(folder, names)

    return shutil.copytree(checkout, to, ignore=ignore)


def copy_folder(folder: Path, to: Path) -> Path:
    """Copy a folder without its build products; return `to`."""
    return shutil.copytree(folder, to, ignore=IGNORE)
