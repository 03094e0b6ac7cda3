"""The doctor's checks of whether the robot is fit to run. A check changes nothing and yields one line.

The checks cover the button box, the camera, the computer, the CAN adapter, every device on the bus, the gate's model
and the aim file. Only `set_stored` writes to devices: after confirmation, it sets the watchdogs and limits that the
axes store.
"""

import contextlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from msgspec.structs import replace

from truearc.errors import InputError, about, load_text
from truearc.hw import protocols
from truearc.hw.bus_rules import SHARE
from truearc.hw.devices import button_box, family
from truearc.hw.devices.family import WARNING, Endpoints, Finding, Heard, StoredSettings, failure, listen, ok, warning
from truearc.hw.devices.odrive.family import parse_endpoints
from truearc.hw.devices.registry import family_of
from truearc.hw.devices.spark.frames import is_controller_heartbeat, locked_spark
from truearc.hw.protocols import NS_PER_S, BadFrame, Bus, Camera, CameraFrame, Clock, Frame, LinkLost, Motor, Stream
from truearc.hw.real.system import CanLink, Exposure
from truearc.robot import aim_file, motors, reasons
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import CameraConfig, Can, Config
from truearc.robot.gate import FEATURES, load_gate_for
from truearc.robot.motors import around_encoder, bound_axes, elevation_from_encoder_deg, make_motors, name_axes

# --- box, camera and computer

LOOK_NS = 20_000_000
BOX_S, CAMERA_S = 1.6, 3.0            # three heartbeats of the box; a camera that starts slowly
GLARE = 0.25                          # of the image at full brightness: no target can be measured in it
# A covered lens gives black, and the sensor's noise on it. Means of blocks of 32 pixels then differ by 2.3 of 255 at
# most (noise of 20, JPEG of quality 50), in emulated pictures with and without the target by 40 at least.
BLOCK_PX, FLAT, DARK = 32, 4.0, 32.0
EXPOSURE_DO = "set it: `v4l2-ctl -d {} -c auto_exposure=1 -c exposure_time_absolute=50` (5 ms), or deploy --exposure-ms"
RECORDING_BYTES_S = 100_000           # ticks and CAN frames: 90 kB/s on the emulated robot, and half a MB a shot
FULL_BYTES = 200_000_000              # half an hour
SCARCE_BYTES = 2_000_000_000          # half a day


def check_box(box: Stream, clock: Clock) -> Finding:
    """Check whether the button box sends heartbeats."""
    check, pending, wrong = "button box", b"", None
    began_ns = clock.now_ns()
    while clock.now_ns() - began_ns < BOX_S * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
        try:
            events, pending, faults = button_box.parse_lines(pending, box.read(), clock.now_ns())
        except LinkLost as error:
            return failure(check, str(error), "look at its plug")
        if events:
            return ok(check, "it says that it is there")
        wrong = faults[0] if faults else wrong
    if wrong is not None:
        return failure(check, f"its lines cannot be read ({reasons.text(wrong)})",
                       "compare its program with docs/how-to/button-box.md")
    return failure(check, f"silent for {BOX_S:g} s", "look at its power and at [buttons] port and baud")


def check_calibration(camera: CameraConfig) -> Finding:
    """Check whether a camera that sees tags has a calibration with stated uncertainties."""
    check = "camera for tags"
    if camera.focal_sigma > 0.0 or any(camera.distortion):
        return ok(check, "[camera] has a calibration with its uncertainty")
    return warning(check, "[camera] states neither distortion nor how well its focal length is known",
                   "`truearc vision-calibrate` finds both")


def check_exposure(camera: CameraConfig, exposure: Exposure | None) -> Finding:
    """Check whether images are taken with a fixed exposure that ends before the next begins."""
    check, do = "camera exposure", EXPOSURE_DO.format(camera.device)
    if "://" in camera.device:
        return warning(check, "a network camera: nothing here fixes its exposure or reads it back" +
                       (", [camera] exposure_s only stamps its images" if camera.exposure_s > 0.0 else ""),
                       "fix it in the camera's own settings: a few ms, not automatic")
    if camera.exposure_s > 0.0:
        return ok(check, f"the configuration fixes it at {camera.exposure_s * 1e3:g} ms; a camera that will not have "
                  "it does not open")
    if exposure is None or exposure.automatic is None:
        return warning(check, "the camera does not say how it exposes", do)
    if exposure.automatic:
        return failure(check, "automatic: a bright tape in a dark hall will be blurred and washed out", do)
    if exposure.length_s is None:
        return ok(check, "fixed")
    if exposure.length_s * camera.fps > 1.0:
        return failure(check, f"{exposure.length_s * 1e3:g} ms are longer than from one image to the next "
                       f"({1e3 / camera.fps:g} ms)", do)
    return ok(check, f"fixed at {exposure.length_s * 1e3:g} ms")


def check_camera(camera: Camera, clock: Clock) -> Finding:
    """Check whether images arrive, and whether anything can be seen in them."""
    check = "camera"
    began_ns = clock.now_ns()
    try:
        while (picture := camera.read()) is None and clock.now_ns() - began_ns < CAMERA_S * NS_PER_S:
            clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
    except LinkLost as error:
        return failure(check, str(error), "look at its plug")
    if picture is None:
        return failure(check, f"no image within {CAMERA_S:g} s", "look at its plug; does another program use it?")
    return _judge(check, picture)


def _judge(check: str, picture: CameraFrame) -> Finding:
    height, width = picture.image.shape[:2]
    glare = float(np.mean(picture.image.max(axis=2) >= 255))
    if glare > GLARE:
        return warning(check, f"{glare:.0%} of its image are at full brightness", "shorten the exposure")
    blocks = cv2.resize(picture.image, (max(width // BLOCK_PX, 1), max(height // BLOCK_PX, 1)),
                        interpolation=cv2.INTER_AREA).astype(np.float32)      # their means, without the sensor's noise
    if picture.image.mean() < DARK and np.abs(blocks - np.median(blocks, axis=(0, 1))).max() < FLAT:
        return warning(check, "its image is black all over, but for noise", "take the cap off, switch the ring light "
                       "on, point it at something bright")
    return ok(check, f"images of {width} x {height} pixels come")


def check_clock(synchronised: bool | None) -> Finding:
    """Check the time of day, which only names recordings, so a wrong one is never a failure."""
    check = "time of day"
    if synchronised:
        return ok(check, "set by a time server")
    says = "not known whether it is right" if synchronised is None else "not set since the computer was started"
    return warning(check, f"{says}: recordings may bear wrong dates",
                   "connect it to a network with a time server once, or give it a battery-backed clock")


def check_real_time(answers: Sequence[tuple[str, str]]) -> list[Finding]:
    """Check real-time permissions; `answers`: (request to the system, reason for refusal, "" if granted)."""
    return [warning("real time", f"{asked} is refused ({refused}): ticks may come late",
                    "run it as the service of `truearc deploy`, which is allowed to") if refused
            else ok("real time", f"{asked} is allowed") for asked, refused in answers]


def check_disk(folder: Path, free_bytes: int | None, writable: bool) -> Finding:
    """Check the room for recordings; `free_bytes` is None if it cannot be queried."""
    check = "disk"
    if free_bytes is None or not writable:
        return failure(check, f"{folder} cannot be written to", "give --out a folder that this user may write to")
    room = f"{free_bytes / 1e9:.1f} GB are free in {folder}, {free_bytes / RECORDING_BYTES_S / 3600:.1f} h of recording"
    if free_bytes < FULL_BYTES:
        return failure(check, room, "copy recordings elsewhere and delete them here")
    if free_bytes < SCARCE_BYTES:
        return warning(check, room, "make room before a long day")
    return ok(check, room)


# --- stored settings

LISTEN_S = 0.5                        # answers come at once; a heartbeat every 0.1 s
DO = "let `truearc doctor --set` write them, or set them with the maker's tool"


def stored_of(config: Config, endpoints: Endpoints | None, must: bool = False) -> dict[str, StoredSettings]:
    """Return stored settings by axis, for axes whose family has them and whose numbers the table has.

    InputError for an axis without numbers if all `must` be present.
    """
    found: dict[str, StoredSettings] = {}
    for (name, axis), bounds in zip(name_axes(config), bound_axes(config), strict=True):
        make = family_of(axis).stored_settings
        if make is not None and endpoints is not None:
            try:
                found[name] = make(axis, bounds, endpoints)
            except KeyError as error:
                if not must:
                    continue
                raise InputError(f"--endpoints: has no endpoint {error}") from error
    return found


def check_stored(known: Mapping[str, StoredSettings], heard: Heard) -> Iterator[Finding]:
    """Check whether each axis stores what the rig needs; one finding per axis."""
    for name, stored in known.items():
        check, values = f"{name}, stored settings", [(one, one.read(heard)) for one in stored.settings]
        differ = [f"{one.name} {'is not reported' if has is None else f'{has:g}'}, the rig needs {one.wanted:g}"
                  for one, has in values if not one.is_well(has)]
        if differ:
            yield warning(check, "; ".join(differ), DO)
        else:
            yield ok(check, ", ".join(f"{one.name} {has:g}" for one, has in values))


class Wrong(NamedTuple):
    """A setting of an axis that differs from what the rig needs; `has`: None without an answer."""

    axis: str
    setting: family.Stored
    has: float | None


def set_stored(bus: Bus, clock: Clock, config: Config, endpoints: Endpoints, yes: bool) -> int:
    """Print the differences, confirm, write, save and read back; return 0 if everything is right at the end, else 1.

    yes: write without confirmation. LinkLost: some settings may have been written.
    """
    known = stored_of(config, endpoints, must=True)
    if not known:
        raise InputError("axes: none keeps settings that can be written; a run sets what its axes need")
    wrong = list(_compare(bus, clock, known))
    if not wrong:
        print(f"watchdogs and limits of {len(known)} axes are as this rig needs them")
        return 0
    for one in wrong:
        print(f"{one.axis}: {one.setting.name} is {_shown(one.has)}, the rig needs {one.setting.wanted:g}")
    axes = list(dict.fromkeys(one.axis for one in wrong))
    if not yes and not _confirmed(f"write and save {len(wrong)} settings? {len(axes)} axes restart"):
        print("nothing was written")
        return 1
    for one in wrong:
        bus.write(one.setting.write)
    for axis in axes:
        heard = listen(bus, clock, known[axis].questions(), LISTEN_S)
        if unwritten := [setting.name for setting in known[axis].settings if setting.read(heard) is None]:
            raise InputError(f"{axis}: {', '.join(unwritten)}: no answer after writing; nothing was saved")
        for frame in known[axis].save:
            bus.write(frame)
    listen(bus, clock, (), max(known[axis].restart_s for axis in axes))
    left = list(_compare(bus, clock, {axis: known[axis] for axis in axes}))
    for one in left:
        print(f"error: {one.axis}: {one.setting.name} is {_shown(one.has)} after writing; expected "
              f"{one.setting.wanted:g}", file=sys.stderr)
    print(f"{len(wrong) - len(left)} of {len(wrong)} settings are written, saved and read back")
    return 1 if left else 0


def _compare(bus: Bus, clock: Clock, known: dict[str, StoredSettings]) -> Iterator[Wrong]:
    """Settings that are not well; InputError names an axis that may not be written to."""
    for axis, stored in known.items():
        heard = listen(bus, clock, stored.questions(), LISTEN_S)
        if why := stored.refuse(heard):
            raise InputError(f"{axis}: {why}")
        for setting in stored.settings:
            if not setting.is_well(has := setting.read(heard)):
                yield Wrong(axis, setting, has)


def _shown(value: float | None) -> str:
    return "unknown (no answer)" if value is None else f"{value:g}"


def _confirmed(question: str) -> bool:
    """Ask at the terminal; InputError where the input is not a terminal."""
    if not sys.stdin.isatty():
        raise InputError("--set: cannot ask, got an input that is not a terminal; expected --yes")
    return input(f"{question} (yes/no): ").strip().lower() == "yes"


# --- the bus and its devices

SHORT_QUEUE = 64                      # frames; the kernel's own ten are full within one tick of four axes
BRING_UP = "bring it up with the files of `truearc deploy`, or `ip link set {} up type can bitrate {} restart-ms 100`"


def load_endpoints(path: Path) -> Endpoints:
    """Read flat_endpoints.json; InputError names the file and what is missing."""
    with about(str(path), ValueError):
        return parse_endpoints(load_text(path))


def questions(config: Config, endpoints: Endpoints | None) -> list[Frame]:
    """Return the queries, all read-only: each axis's version, and its parameters if their numbers are known; none for
    advisory axes. A motor controller that also has the hood's encoder is queried once."""
    encoder = config.hood_encoder
    asked = [frame for _, axis in name_axes(config) for frame in family_of(axis).questions(axis, endpoints)]
    asked += (frame for one in stored_of(config, endpoints).values() for frame in one.questions())
    return list(dict.fromkeys([*asked, *encoder_family_of(encoder).questions(encoder)]))


def check_devices(config: Config, endpoints: Endpoints | None, heard: Heard) -> Iterator[Finding]:
    """Check the axes in the configuration's order, the hood's encoder, then all of them; equal warnings become one."""
    found = [finding for name, axis in name_axes(config)
             for finding in family_of(axis).examine(axis, family.AxisCheck(name, config.tick_hz, endpoints), heard)]
    found += check_stored(stored_of(config, endpoints), heard)
    encoder = config.hood_encoder
    found += encoder_family_of(encoder).examine(encoder, around_encoder(config), heard)
    if heard.asked:
        found.append(check_answer_times(config, heard))
    yield from _fold([*found, check_pulses(config, heard), *check_hood(config, heard)])


def _fold(findings: list[Finding]) -> Iterator[Finding]:
    alike: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in findings:
        who, _, what = finding.check.partition(", ")
        alike.setdefault((what, finding.says, finding.do if finding.level == WARNING else who), []).append(finding)
    for (what, _, _), group in alike.items():
        names = ", ".join(finding.check.partition(", ")[0] for finding in group)
        yield group[0] if len(group) == 1 else replace(group[0], check=f"{what} of {names}")


def check_answer_times(config: Config, heard: Heard) -> Finding:
    """Check how long answers take: frames are stamped on arrival, so all readings are late by as much."""
    check, limit_s = "feedback", config.gate.reading_age_s / 2      # the rest is for a device's own period and a tick
    times = {name: took_s for name, axis in name_axes(config) for question in family_of(axis).questions(axis, None)
             if question.is_remote and (took_s := heard.answer_s(question)) is not None}
    encoder = encoder_family_of(config.hood_encoder)
    for question in encoder.questions(config.hood_encoder)[:1]:
        answer_id = encoder.answer_id(config.hood_encoder)
        if answer_id is not None and (took_s := heard.answer_s(question, answer_id)) is not None:
            times["hood encoder"] = took_s
    if not times:
        return warning(check, "no device can be asked how late its readings come", "see with --move")
    if late := [f"{name} {took_s * 1e3:.0f} ms" for name, took_s in times.items() if took_s > limit_s]:
        return failure(check, f"comes late, by question and answer: {', '.join(late)}; firing needs "
                       f"{limit_s * 1e3:.0f} ms", "look for what holds frames back: the adapter, its driver, a hub")
    return ok(check, f"answers take {max(times.values()) * 1e3:.0f} ms at most")


def check_pulses(config: Config, heard: Heard) -> Finding:
    """Check whether a device reports twice as often as it should, for which a run would hold its fire."""
    check = "device numbers"
    pulses = {kind: period_ns for rules in motors.make_rules(config) for kind, period_ns in rules.pulse.items()}
    twice = {f"{frames[0].name} {len(frames) / heard.seconds:.0f}/s instead of {NS_PER_S / period_ns:.0f}/s"
             for (frame_id, is_extended, _), period_ns in pulses.items()
             if len(frames := heard.of(frame_id, is_extended)) > SHARE * heard.seconds * NS_PER_S / period_ns + 1}
    if twice:
        return failure(check, f"two devices with one? {', '.join(sorted(twice))}",
                       "give each a number of its own; or set that rate back, by which two would give themselves away")
    return ok(check, "none speaks for two")


def find_hood(config: Config, heard: Heard) -> tuple[protocols.MotorReading, float | None]:
    """Return the hood motor's reading, and the elevation from the hood's encoder; None without one that knows its
    zero."""
    table, kind = config.hood_encoder, encoder_family_of(config.hood_encoder)
    motor = make_motors(config)[len(config.axes.flywheels)]
    _take_in(motor, heard)
    if table.zero_deg is None or not table.is_heard or kind.make_off_bus is not None:
        return motor.reading, None
    encoder = kind.make(table, around_encoder(config))
    _take_in(encoder, heard)
    angle = encoder.reading or encoder.read(0)
    at_deg = None if angle is None else elevation_from_encoder_deg(angle.angle_rad, table, table.zero_deg)
    return motor.reading, at_deg


def _take_in(device: Motor | family.Encoder, heard: Heard) -> None:
    keys = set(device.ids())
    for frame in heard.frames:
        if (frame.arbitration_id, frame.is_extended) in keys and not frame.is_remote:
            with contextlib.suppress(BadFrame):
                device.take(frame)


def check_hood(config: Config, heard: Heard) -> Iterator[Finding]:
    """Check whether limit switch and encoder agree on the hood's position; no finding if either reports none."""
    check, hood = "hood, switch and encoder", config.hood
    motor, at_deg = find_hood(config, heard)
    if at_deg is None or motor.endstop_t_ns == 0:
        return
    told = (f"the encoder reads {at_deg:.1f} deg, the limit switch at {hood.low_deg:g} deg is "
            f"{'closed' if motor.endstop else 'open'}")
    do = "look at the switch, its plug and polarity; at zero_deg and direction in [hood_encoder]"
    if motor.endstop and at_deg > hood.low_deg + hood.crosscheck_deg:
        yield failure(check, told, do)
    elif not hood.low_deg - hood.crosscheck_deg <= at_deg <= hood.high_deg + hood.crosscheck_deg:
        yield failure(check, f"{told}: the hood's travel is {hood.low_deg:g} to {hood.high_deg:g} deg", do)
    else:
        yield ok(check, told)


def check_model(config: Config, path: Path | None) -> Finding:
    """Check whether the model that the policy requires is present, intact, and made for this robot's contract."""
    check, gate = "gate model", config.gate
    if path is None:
        if gate.policy == "model":
            return failure(check, "gate.policy is 'model' and no model was given", "give --gate, as to `truearc run`")
        return ok(check, f"none is needed: gate.policy is {gate.policy!r}")
    try:
        model = load_gate_for(path, config.rig)
    except InputError as error:
        return failure(check, str(error), "export it again with this version of truearc, and copy it whole")
    domain = ", ".join(f"{feature.name} {low:g} to {high:g}"
                       for feature, (low, high) in zip(FEATURES, model.domain, strict=True))
    return ok(check, f"sha256 {model.sha256[:12]}, this robot's contract; speaks of {domain}")


def check_aim(config: Config, path: Path | None) -> Iterator[Finding]:
    """Check whether the aim file that the policy requires is present, intact, and for this launcher; no finding without
    one."""
    check = "aim file"
    if not aim_file.needs_aim(config):
        if path is not None:
            yield failure(check, f"aim.policy is {config.aim.policy!r}", "leave --aim out, or set it to 'belief'")
    elif path is None:
        yield failure(check, "aim.policy is 'belief' and no aim file was given", "give --aim, as to `truearc run`")
    else:
        try:
            aim = aim_file.load_aim_for(path, config)
        except InputError as error:
            yield failure(check, str(error), "make it again with `truearc aim --robot` and this launcher.toml")
            return
        spans = ", ".join(f"{one.distance_m[0]:g} to {one.distance_m[-1]:g} m" for one in aim.content.segments)
        yield ok(check, f"sha256 {aim.sha256[:12]}, set points for {spans}")


def check_adapter(can: Can, link: CanLink | None) -> Finding:
    """Check the interface itself; `link` is None if the system has none of that name."""
    check = "CAN adapter"
    if can.interface != "socketcan":
        return ok(check, f"{can.interface} {can.channel} is open")
    if link is None:
        return failure(check, f"there is no network interface {can.channel}",
                       "plug the adapter in; `ip link` lists what there is")
    if not link.is_up:
        return failure(check, f"{can.channel} is down", BRING_UP.format(can.channel, can.bitrate))
    if link.state is not None and link.state not in ("ERROR-ACTIVE", "ERROR-WARNING"):
        return failure(check, f"{can.channel} is {link.state.lower()}",
                       "look at the plugs, at the two 120 ohm terminators and at every device's bitrate")
    if link.restart_ms == 0:
        return warning(check, f"{can.channel} stays off the bus after one bad plug (restart-ms 0)",
                       "set restart-ms 100, as the files of `truearc deploy` do")
    if link.queue is not None and link.queue < SHORT_QUEUE:
        return warning(check, f"{can.channel} queues only {link.queue} frames",
                       f"`ip link set {can.channel} txqueuelen {SHORT_QUEUE}`, or the files of `truearc deploy`")
    return ok(check, f"{can.channel} is up")


def check_bitrate(can: Can, link: CanLink | None, heard: Heard) -> Finding:
    """Check the interface's bitrate; if it reports none, whether any frame is received."""
    check = "bitrate"
    if link is not None and link.bitrate is not None and link.bitrate != can.bitrate:
        return failure(check, f"{can.channel} runs at {link.bitrate} bit/s, the configuration says {can.bitrate}",
                       "make them one: [can] bitrate, or " + BRING_UP.format(can.channel, can.bitrate))
    if not heard.frames:
        return failure(check, f"nothing at all was heard in {heard.seconds:.1f} s",
                       f"power the devices, look at the plugs, and see that all of them speak at {can.bitrate} bit/s")
    frames_s = len(heard.frames) / heard.seconds
    if link is not None and link.bitrate is not None:
        return ok(check, f"{link.bitrate} bit/s; {frames_s:.0f} frames/s are heard")
    return ok(check, f"{frames_s:.0f} frames/s are understood, so it fits ({can.bitrate} bit/s are configured)")


def check_heartbeat_lock(axes: Iterable[family.Axis], heard: Heard) -> Finding:
    """Check whether a competition's robot controller controls the motors, now or before; for advisory motors it may."""
    check = "heartbeat lock"
    if not any(family_of(axis).is_commanded for axis in axes):
        return ok(check, "every motor is another controller's, and nothing is sent to them")
    locked = sorted({number for frame in heard.frames if (number := locked_spark(frame)) is not None})
    if locked:
        return failure(check, f"SPARK {', '.join(map(str, locked))} will obey only the robot controller it has heard",
                       "take the controller off the bus, then the power off the motors and on again")
    if any(is_controller_heartbeat(frame) for frame in heard.frames):
        return failure(check, "a competition's robot controller is on this bus and commands its motors",
                       "take it off the bus: there truearc may advise, not drive")
    return ok(check, "no robot controller claims the motors")
