"""The robot's ports named on the command line, in place of the configuration's."""

import argparse

from msgspec.structs import replace

from truearc.errors import InputError
from truearc.robot.config.schema import Can, Config


def add_port_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--can", metavar="INTERFACE:CHANNEL", help="instead of [can], such as slcan:/dev/ttyACM0")
    parser.add_argument("--buttons", metavar="PORT", help="instead of [buttons] port")
    parser.add_argument("--camera", metavar="DEVICE", help="instead of [camera] device; a URL, too")


def with_ports(config: Config, can: str | None, buttons: str | None, camera: str | None) -> Config:
    """`config` with these ports; InputError names one that is none."""
    if can is not None:
        interface, channel = split_bus(can, "--can")
        config = replace(config, can=Can(interface, channel, config.can.bitrate))
    if buttons is not None:
        config = replace(config, buttons=replace(config.buttons, port=buttons))
    if camera is not None:
        config = replace(config, camera=replace(config.camera, device=camera))
    return config


def split_bus(bus: str, option: str) -> tuple[str, str]:
    """(interface, channel) of `interface:channel`; the channel may have colons of its own."""
    interface, _, channel = bus.partition(":")
    if not interface or not channel:
        raise InputError(f"{option} {bus}: an interface and a channel, such as slcan:/dev/ttyACM0 or socketcan:can0")
    return interface, channel
