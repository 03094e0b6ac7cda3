"""Options of `truearc deploy` on the robot's computer, checked against the configuration."""

import re
from collections.abc import Iterator

from msgspec import Struct

from truearc.errors import InputError
from truearc.hw.devices.axis import driver_of
from truearc.hw.plugins import INSTALL_HINTS
from truearc.robot.aim_file import needs_aim
from truearc.robot.config.reading_tables import distribution_of_table
from truearc.robot.config.schema import Config

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
    """`parts`, checked against the configuration; InputError names the option that cannot be."""
    for wrong in (*_missing_plugins(config, parts), *_wrong_names(config, parts), *_wrong_numbers(config, parts)):
        raise InputError(wrong)
    return parts


def _missing_plugins(config: Config, parts: Parts) -> Iterator[str]:
    from truearc.hw.devices.registry import BY_DRIVER  # drivers need cantools, which --help does without
    from truearc.robot.motors import name_axes
    for name, driver in ((name, driver_of(axis)) for name, axis in name_axes(config)):
        if driver not in BY_DRIVER and not parts.has_plugins:
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
