"""The work of `truearc doctor`: opens each wire in turn and collects the findings."""

import argparse
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import cv2
import msgspec

from truearc.cli.robot.doctor_move import check_move, move_robot
from truearc.errors import InputError
from truearc.hw.devices.family import Endpoints, listen
from truearc.hw.finding import FAILURE, WARNING, Finding, failure, line
from truearc.hw.machine import CanLink
from truearc.hw.protocols import Bus, Clock, LinkLost
from truearc.hw.real.camera import open_camera
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.machine import is_clock_synchronised, read_exposure, read_link
from truearc.hw.real.realtime import rehearse
from truearc.hw.real.serial_port import open_serial
from truearc.robot.config.schema import Config, load_config
from truearc.robot.doctor import devices, senses
from truearc.robot.doctor.stored import set_stored
from truearc.robot.motors import name_axes
from truearc.robot.readings import sources_of


def check_robot(args: argparse.Namespace) -> int:
    """Print the findings; 1 if any is a failure. args: those of `truearc doctor`."""
    check_move(args)
    config = load_config(args.config)
    endpoints = devices.load_endpoints(args.endpoints) if args.endpoints else None
    clock = MonotonicClock()
    findings = [*_look_at_can(config, clock, endpoints, args.seconds)]
    if args.move:
        findings += move_robot(config, clock, findings, args.yes)
    findings += [*_look_at_senses(config, clock), *look_at_readings(config),
                *senses.check_real_time(rehearse(args.priority)), senses.check_clock(is_clock_synchronised()),
                devices.check_model(config.gate, args.gate), *devices.check_aim(config, args.aim),
                _look_at_disk(args.out)]
    return report(findings, args.json)


def set_devices(args: argparse.Namespace) -> int:
    """Write what the axes should keep; 0 when they keep it. args: those of `truearc doctor`."""
    if args.endpoints is None:
        raise InputError("--set needs --endpoints: the flat_endpoints.json of the axes' firmware")
    config, endpoints, clock = load_config(args.config), devices.load_endpoints(args.endpoints), MonotonicClock()
    try:
        bus = open_can(config.can.interface, config.can.channel, config.can.bitrate, clock)
    except LinkLost as error:
        raise InputError(f"{args.config}: can: {error}") from error
    try:
        return set_stored(bus, clock, config, endpoints, args.yes)
    except LinkLost as error:
        raise InputError(f"{args.config}: can: {error}; some settings may have been written") from error
    finally:
        bus.close()


def report(findings: list[Finding], as_json: bool) -> int:
    """Print findings; return 1 if any is a failure."""
    levels = [finding.level for finding in findings]
    failures, warnings = levels.count(FAILURE), levels.count(WARNING)
    if as_json:
        print(msgspec.json.encode({"failures": failures, "warnings": warnings, "findings": findings}).decode())
    else:
        print(*map(line, findings), sep="\n")
        print(f"{len(findings)} checks: {failures} failed, {warnings} with a warning")
    return 1 if failures else 0


def _look_at_senses(config: Config, clock: Clock) -> Iterator[Finding]:
    cv2.setNumThreads(1)
    with ExitStack() as wires:
        try:
            box = open_serial(config.buttons.port, config.buttons.baud)
            wires.callback(box.close)
            yield senses.check_box(box, clock)
        except LinkLost as error:
            yield failure("button box", str(error), "plug it in; stop a running robot; see [buttons] port")
        if config.is_seen_elsewhere:
            return
        yield senses.check_exposure(config.camera, read_exposure(config.camera.device))
        try:
            camera = open_camera(config.camera.device, config.camera.width_px, config.camera.height_px,
                                 config.camera.fps, clock, config.camera.exposure_s)
            wires.callback(camera.close)
            yield senses.check_camera(camera, clock)
        except LinkLost as error:
            yield failure("camera", str(error), "plug it in; stop a running robot; see [camera] in the configuration")


def _look_at_can(config: Config, clock: Clock, endpoints: Endpoints | None, seconds: float) -> Iterator[Finding]:
    link = read_link(config.can.channel) if config.can.interface == "socketcan" else None
    adapter = devices.check_adapter(config.can, link)
    try:
        bus = open_can(config.can.interface, config.can.channel, config.can.bitrate, clock)
    except LinkLost as error:
        yield adapter if adapter.level == FAILURE else failure(adapter.check, str(error), "plug it in; see [can]")
        return
    yield adapter
    try:
        yield from look_at_bus(config, bus, clock, link, endpoints, seconds)
    except LinkLost as error:
        yield failure("devices", f"not asked: {error}", "repair the adapter first")
    finally:
        bus.close()


def look_at_bus(config: Config, bus: Bus, clock: Clock, link: CanLink | None, endpoints: Endpoints | None,
                seconds: float) -> Iterator[Finding]:
    """Everything that can be heard on the CAN bus in one stretch of listening; raises LinkLost."""
    heard = listen(bus, clock, devices.questions(config, endpoints), seconds)
    yield devices.check_bitrate(config.can, link, heard)
    yield devices.check_heartbeat_lock((axis for _, axis in name_axes(config)), heard)
    yield from devices.check_devices(config, endpoints, heard)


def _look_at_disk(folder: Path) -> Finding:
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        free_bytes = shutil.disk_usage(there).free
    except OSError:
        return senses.check_disk(folder, None, False)
    return senses.check_disk(folder, free_bytes, there.is_dir() and os.access(there, os.W_OK))


def look_at_readings(config: Config) -> Iterator[Finding]:
    """What other distributions say of their tables; of [camera] where it sees tags itself."""
    if not config.is_seen_elsewhere and config.camera.target == "apriltag":
        yield senses.check_calibration(config.camera)
    for source in sources_of(config):
        yield from source.findings()
