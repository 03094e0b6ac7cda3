"""Implementation of `truearc doctor`.

The command opens each connection in turn and collects findings. With --move, it also moves the robot; with --set, it
writes the rig's watchdogs and limits into the ODrive axes.
"""

import argparse
import os
import shutil
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import msgspec

from truearc.cli import common, run_robot
from truearc.errors import InputError
from truearc.hw.devices.family import FAILURE, WARNING, Endpoints, Finding, Heard, failure, line, listen, warning
from truearc.hw.protocols import Bus, Clock, Frame, LinkLost, Stream
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.system import CanLink, is_clock_synchronised, read_exposure, read_link, rehearse
from truearc.hw.real.wires import open_camera, open_serial
from truearc.robot import doctor, eyes, motors
from truearc.robot.config.schema import Config, load_config
from truearc.robot.doctor_motion import SmallMotion, check_motion, describe, plan
from truearc.robot.recording.files import TappedBus
from truearc.robot.rig import HardwareRig
from truearc.robot.runtime import run

CHECK = "motion"
LOOK_S = 0.5                          # at where the hood is, before anything is asked
WARNING_TEXT = "Take all balls out and keep hands away. Ctrl-C stops it, and so does any button of the button box."


def check_robot(args: argparse.Namespace) -> int:
    """Print the findings; return 1 if any is a failure. args: those of `truearc doctor`."""
    check_move(args)
    config = load_config(args.config)
    endpoints = doctor.load_endpoints(args.endpoints) if args.endpoints else None
    clock = MonotonicClock()
    findings = [*_look_at_can(config, clock, endpoints, args.seconds)]
    if args.move:
        findings += move_robot(config, clock, findings, args.yes)
    findings += [*_look_at_senses(config, clock), *look_at_readings(config),
                *doctor.check_real_time(rehearse(args.priority)), doctor.check_clock(is_clock_synchronised()),
                doctor.check_model(config, args.gate), *doctor.check_aim(config, args.aim),
                _look_at_disk(args.out)]
    return report(findings, args.json)


def set_devices(args: argparse.Namespace) -> int:
    """Write what the axes should store; return 0 if they store it. args: those of `truearc doctor`."""
    if args.endpoints is None:
        raise InputError("--set needs --endpoints: the flat_endpoints.json of the axes' firmware")
    config, endpoints, clock = load_config(args.config), doctor.load_endpoints(args.endpoints), MonotonicClock()
    try:
        bus = open_can(config.can.interface, config.can.channel, config.can.bitrate, clock)
    except LinkLost as error:
        raise InputError(f"{args.config}: can: {error}") from error
    try:
        return doctor.set_stored(bus, clock, config, endpoints, args.yes)
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
            yield doctor.check_box(box, clock)
        except LinkLost as error:
            yield failure("button box", str(error), "plug it in; stop a running robot; see [buttons] port")
        if config.is_seen_elsewhere:
            return
        yield doctor.check_exposure(config.camera, read_exposure(config.camera.device))
        try:
            camera = open_camera(config.camera.device, config.camera.width_px, config.camera.height_px,
                                 config.camera.fps, clock, config.camera.exposure_s)
            wires.callback(camera.close)
            yield doctor.check_camera(camera, clock)
        except LinkLost as error:
            yield failure("camera", str(error), "plug it in; stop a running robot; see [camera] in the configuration")


def _look_at_can(config: Config, clock: Clock, endpoints: Endpoints | None, seconds: float) -> Iterator[Finding]:
    link = read_link(config.can.channel) if config.can.interface == "socketcan" else None
    adapter = doctor.check_adapter(config.can, link)
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
    """Return everything received on the CAN bus in one period of listening; raises LinkLost."""
    heard = listen(bus, clock, doctor.questions(config, endpoints), seconds)
    yield doctor.check_bitrate(config.can, link, heard)
    yield doctor.check_heartbeat_lock((axis for _, axis in motors.name_axes(config)), heard)
    yield from doctor.check_devices(config, endpoints, heard)


def _look_at_disk(folder: Path) -> Finding:
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        free_bytes = shutil.disk_usage(there).free
    except OSError:
        return doctor.check_disk(folder, None, False)
    return doctor.check_disk(folder, free_bytes, there.is_dir() and os.access(there, os.W_OK))


def look_at_readings(config: Config) -> Iterator[Finding]:
    """Return the findings of other distributions on their tables, and on [camera] if it sees tags itself."""
    if not config.is_seen_elsewhere and config.camera.target == "apriltag":
        yield doctor.check_calibration(config.camera)
    for source in eyes.sources_of(config):
        yield from source.findings()


class NoBox:
    """An absent button box."""

    def read(self) -> bytes:
        return b""

    def close(self) -> None: ...


def check_move(args: argparse.Namespace) -> None:
    """Raise InputError for incompatible options, before anything is opened."""
    if not args.move:
        common.refuse(args, ("--yes",), "applies with --move or --set only")
    elif not args.yes and not sys.stdin.isatty():
        raise InputError("--move: asks before it moves anything, and there is no terminal to answer; give --yes where "
                         "all balls are out and hands away")


def move_robot(config: Config, clock: Clock, found: Sequence[Finding], is_allowed: bool) -> list[Finding]:
    """Return the findings of the motion. found: those at rest, without a failure; is_allowed: without confirmation."""
    if any(finding.level == FAILURE for finding in found):
        return [warning(CHECK, "not tried: something on the bus has failed at rest", "repair that first")]
    with ExitStack() as wires:
        try:
            bus = run_robot.open_bus(config, clock, wires, Counter())
        except LinkLost as error:
            return [failure(CHECK, f"not tried: {error}", "plug the adapter in; see [can]")]
        try:
            box: Stream | None = open_serial(config.buttons.port, config.buttons.baud)
        except LinkLost:
            box = None                            # a check of its own says so
        if box is not None:
            wires.callback(box.close)
        try:
            hood_deg = doctor.find_hood(config, listen(bus, clock, (), LOOK_S))[1]
        except LinkLost as error:
            return [failure(CHECK, f"not tried: {error}", "repair the adapter first")]
        program = plan(config, hood_deg)
        if not is_allowed and not _ask(describe(config, program)):
            return [warning(CHECK, "not tried: it was not allowed", "type yes when asked")]
        motion, ending = SmallMotion(config, program, box is not None), run_robot.Ending()
        return move(config, motion, bus, box, clock, ending, wires)


def move(config: Config, motion: SmallMotion, bus: Bus, box: Stream | None, clock: Clock, ending: run_robot.Ending,
         wires: ExitStack) -> list[Finding]:
    """Move on open wires until the motion is over, and release; return the findings."""
    heard: list[Frame] = []

    def tap(frame: Frame, sent: bool) -> None:
        if not sent:
            heard.append(frame)

    began_ns = clock.now_ns()
    rig = HardwareRig(config, TappedBus(bus, tap), box or NoBox(), eyes.NoEyes(), clock,
                      lambda: ending.asked or motion.is_finished)
    wires.callback(rig.release)                   # first of all to be done on the way out, whatever happened
    run(rig, config, None, motion, motion)
    return [*check_motion(config, motion, Heard(tuple(heard), max((clock.now_ns() - began_ns) * 1e-9, 1e-3)))]


def _ask(what: str) -> bool:
    print(f"truearc doctor --move will move\n{what}\n{WARNING_TEXT}\nType yes to go on: ", end="", file=sys.stderr,
          flush=True)
    try:
        return input().strip() == "yes"
    except (EOFError, KeyboardInterrupt):
        return False
