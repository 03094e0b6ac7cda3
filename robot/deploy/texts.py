"""The files themselves: systemd unit, CAN bring-up, device names, and the script that installs them."""

import re
from types import MappingProxyType

from truearc.robot.config.schema import Config
from truearc.robot.deploy.install import HIGHEST_PRIORITY, Parts

HOME = "/opt/truearc"                 # the virtual environment
SETTINGS = "/etc/truearc"             # launcher.toml, gate.onnx, aim.json
STATE = "/var/lib/truearc"            # sessions
INBOX = f"{STATE}/aims"               # aim files that are offered to the driver
USER = "truearc"
PROGRAM = f"{HOME}/venv/bin/truearc"
QUEUE_FRAMES = 64                     # longer only makes set points older; the kernel's ten are refused in one tick
RESTART_MS = 100                      # after bus-off
UNIT, LINK, NETWORK, RULES, UNMANAGED, INSTALL = (
    "truearc.service", "60-truearc-can.link", "60-truearc-can.network", "70-truearc.rules", "60-truearc.conf",
    "install.sh")
PLACES = MappingProxyType({
    UNIT: "/etc/systemd/system", LINK: "/etc/systemd/network", NETWORK: "/etc/systemd/network",
    RULES: "/etc/udev/rules.d", UNMANAGED: "/etc/NetworkManager/conf.d"})


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
    device = f"sys-subsystem-net-devices-{_escape(config.can.channel)}.device"
    waits = f"Wants={device}\nAfter={device}\n" if config.can.interface == "socketcan" else ""
    models = _models(parts) + (f" --aim-inbox {INBOX}" if parts.has_aim else "")
    core = "" if parts.core is None else f" --core {parts.core}"
    options = f"--out {STATE}/sessions --priority {parts.priority}{core}"
    return f"""[Unit]
Description=truearc, the launcher's controller
{waits}StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
ExecStart={PROGRAM} run --config {SETTINGS}/launcher.toml{models} {options}
# READY comes with the first full set of fresh readings; motors may be switched on long after the computer.
TimeoutStartSec=infinity
# Fed by the control tick alone.
WatchdogSec=1
Restart=always
RestartSec=0.5
TimeoutStopSec=90
User={USER}
SupplementaryGroups=dialout video
StateDirectory={USER}
# The control process is real-time; the processes that it starts (vision, recorder) are not.
CPUSchedulingPolicy=fifo
CPUSchedulingPriority={parts.priority}
CPUSchedulingResetOnFork=yes
LimitRTPRIO={HIGHEST_PRIORITY}
LimitMEMLOCK=infinity
OOMScoreAdjust=-900
ProtectSystem=strict
ProtectHome=yes
PrivateTmp=yes
NoNewPrivileges=yes

[Install]
WantedBy=multi-user.target
"""


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
    steps = [HEAD, *(f"install -D -m 644 {name} {PLACES[name]}/{name}" for name in files), DEVICES]
    if config.can.interface == "socketcan":
        steps.append(NETWORKING.replace("CHANNEL", config.can.channel))
    endpoints = f" --endpoints {SETTINGS}/flat_endpoints.json" if parts.has_endpoints else ""
    look = (f"{PROGRAM} doctor --config {SETTINGS}/launcher.toml{_models(parts)}{endpoints} --out {STATE}/sessions "
            f"--priority {parts.priority}")
    return "\n".join([*steps, TAIL.replace("DOCTOR", look)])


def _models(parts: Parts) -> str:
    return "".join(f" --{option} {SETTINGS}/{file}" for option, file, carried in (
        ("gate", "gate.onnx", parts.has_gate), ("aim", "aim.json", parts.has_aim)) if carried)


HEAD = f"""#!/bin/sh
# Written by `truearc deploy`. Run as root in this folder; running it again does no harm.
set -eu
cd "$(dirname "$0")"
finished=no
trap 'test $finished = yes || echo "NOT FINISHED, and the robot is stopped: fix that and run it again" >&2' EXIT
systemctl stop truearc.service 2>/dev/null || true
id {USER} >/dev/null 2>&1 || useradd --system --user-group --home-dir {STATE} --shell /usr/sbin/nologin {USER}
install -d -m 755 {HOME} {SETTINGS}
install -d -m 755 -o {USER} -g {USER} {STATE} {STATE}/sessions {INBOX}

# The program, and the motor drivers of other distributions in plugins/. With wheels for all they need in wheels/ no
# network is asked.
python3 -m venv {HOME}/venv
offline=""
if ls wheels/numpy-*.whl >/dev/null 2>&1; then offline="--no-index"; fi
plugins=$(ls plugins/*.whl 2>/dev/null || true)
{HOME}/venv/bin/python -m pip install --quiet --no-deps --no-index --force-reinstall wheels/truearc-*.whl $plugins
{HOME}/venv/bin/python -m pip install --quiet $offline --find-links wheels --constraint constraints.txt \\
    wheels/truearc-*.whl $plugins

# What it runs with, and what starts it.
for name in launcher.toml gate.onnx aim.json flat_endpoints.json; do
    if [ -e "$name" ]; then install -m 644 "$name" {SETTINGS}/"$name"; else rm -f {SETTINGS}/"$name"; fi
done"""

DEVICES = """
udevadm control --reload
udevadm trigger --action=add --subsystem-match=tty --subsystem-match=video4linux"""

NETWORKING = """
# CAN is systemd-networkd's, whatever else looks after the network. A new name comes with the next plugging in.
if [ -d /etc/NetworkManager ]; then systemctl try-reload-or-restart NetworkManager.service; fi
if ! systemctl is-enabled --quiet systemd-networkd.service; then
    systemctl enable systemd-networkd.service
    # nothing but CAN is networkd's here: a start that waits for "online" would wait in vain
    systemctl disable systemd-networkd-wait-online.service
fi
if [ -e /sys/class/net/CHANNEL ]; then udevadm trigger --action=add /sys/class/net/CHANNEL; fi
systemctl restart systemd-networkd.service"""

TAIL = f"""
systemctl daemon-reload
systemctl enable --quiet truearc.service

# Everything is looked at while nothing else holds camera and button box, and with the service's own permissions.
verdict=0
systemd-run --quiet --pipe --wait --collect --property=User={USER} --property="SupplementaryGroups=dialout video" \\
    --property=LimitRTPRIO={HIGHEST_PRIORITY} --property=LimitMEMLOCK=infinity \\
    DOCTOR || verdict=$?
systemctl restart --no-block truearc.service
echo "truearc.service is started, and ready once every device has been heard: systemctl status truearc"
finished=yes
exit $verdict
"""


def _escape(name: str) -> str:
    """As systemd-escape does, of an interface's name."""
    return name.replace("-", "\\x2d")
