"""The files themselves: systemd unit, CAN bring-up, device names, and the script that installs them.

`files/` has the longer ones, with places such as `@USER@` to fill in.
"""

import re
from importlib.resources import files as resources
from types import MappingProxyType

from truearc.robot.config.schema import Config
from truearc.robot.deploy.install import HIGHEST_PRIORITY, Parts

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
    """The robot's launcher.toml: that one, with limits for its recordings where it has no word on them."""
    return text if config.recording is not None else text.rstrip("\n") + "\n" + RECORDING


def make_files(config: Config, parts: Parts) -> dict[str, str]:
    """Name -> text of every file that is carried over, beside the wheel, configuration and model."""
    files = {UNIT: make_unit(config, parts)}
    if config.can.interface == "socketcan":
        files |= {LINK: make_link(config.can.channel, parts.can_serial),
                  NETWORK: make_network(config.can.channel, config.can.bitrate),
                  UNMANAGED: f"[keyfile]\nunmanaged-devices=interface-name:{config.can.channel}\n"}
    if rules := make_rules(config, parts):
        files[RULES] = rules
    return files | {INSTALL: make_install(config, parts, tuple(files))}


def make_unit(config: Config, parts: Parts) -> str:
    """The service. It waits for the CAN interface, but does not fall with it: an unplugged adapter is a HOLD."""
    escaped = config.can.channel.replace("-", "\\x2d")         # as systemd-escape does
    device = f"sys-subsystem-net-devices-{escaped}.device"
    waits = f"Wants={device}\nAfter={device}\n" if config.can.interface == "socketcan" else ""
    models = _models(parts) + (f" --aim-inbox {INBOX}" if parts.has_aim else "")
    core = "" if parts.core is None else f" --core {parts.core}"
    options = f"--out {STATE}/sessions --priority {parts.priority}{core}"
    return _filled("truearc.service", WAITS=waits, OPTIONS=f"{models} {options}", PRIORITY=parts.priority)


def make_link(channel: str, serial: str) -> str:
    """The interface's queue and, with the adapter's serial number, its name."""
    match, name = (f"Property=ID_SERIAL_SHORT={serial}", f"Name={channel}\n") if serial else (
        f"OriginalName={channel}", "")
    return f"[Match]\n{match}\n\n[Link]\n{name}TransmitQueueLength={QUEUE_FRAMES}\n"


def make_network(channel: str, bitrate: int) -> str:
    """The interface's bitrate, and when it tries again after bus-off."""
    return (f"[Match]\nName={channel}\n\n[Link]\nRequiredForOnline=no\n\n[CAN]\nBitRate={bitrate}\n"
            f"RestartSec={RESTART_MS}ms\n")


def make_rules(config: Config, parts: Parts) -> str:
    """A lasting name for the button box and a fixed exposure for the camera; "" when neither was asked for."""
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
    """What root does on the robot's computer, in the folder that was copied there; exit code: the doctor's."""
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
