"""The CAN adapter and every device on the bus: what to ask, and what to make of it; the gate's model, the aim file."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from msgspec.structs import replace

from truearc.errors import InputError, about, load_text
from truearc.hw.bus_rules import SHARE
from truearc.hw.devices.family import WARNING, Axis, AxisCheck, Encoder, Endpoints, Finding, Heard, failure, ok, warning
from truearc.hw.devices.odrive.doctor import parse_endpoints
from truearc.hw.devices.registry import family_of
from truearc.hw.devices.spark.frames import is_controller_heartbeat, locked_spark
from truearc.hw.protocols import BadFrame, Frame, Motor, MotorReading
from truearc.hw.real.system import CanLink
from truearc.robot.aim_file import load_aim_for, needs_aim
from truearc.robot.config.can_policy import NS_PER_S, make_rules
from truearc.robot.config.schema import Can, Config, GateConfig
from truearc.robot.doctor.stored import check_stored, stored_of
from truearc.robot.gate.contract import FEATURES
from truearc.robot.gate.model import load_gate
from truearc.robot.geometry import elevation_from_encoder_deg
from truearc.robot.hood_encoders import encoder_family_of
from truearc.robot.motors import around_encoder, make_motors, name_axes

SHORT_QUEUE = 64                      # frames; the kernel's own ten are full within one tick of four axes
BRING_UP = "bring it up with the files of `truearc deploy`, or `ip link set {} up type can bitrate {} restart-ms 100`"


def load_endpoints(path: Path) -> Endpoints:
    """Read flat_endpoints.json; InputError names the file and what is missing."""
    with about(str(path), ValueError):
        return parse_endpoints(load_text(path))


def questions(config: Config, endpoints: Endpoints | None) -> list[Frame]:
    """Reads only: each axis's version, and its parameters when their numbers are known; nothing of advisory ones. The
    hood's encoder may be on a motor's controller, which is asked once."""
    encoder = config.hood_encoder
    asked = [frame for _, axis in name_axes(config) for frame in family_of(axis).questions(axis, endpoints)]
    asked += (frame for one in stored_of(config, endpoints).values() for frame in one.questions())
    return list(dict.fromkeys([*asked, *encoder_family_of(encoder).questions(encoder)]))


def check_devices(config: Config, endpoints: Endpoints | None, heard: Heard) -> Iterator[Finding]:
    """Axes in the configuration's order, then the hood's encoder, then all of them together; a warning about several
    devices alike is one."""
    found = [finding for name, axis in name_axes(config)
             for finding in family_of(axis).examine(axis, AxisCheck(name, config.tick_hz, endpoints), heard)]
    found += check_stored(stored_of(config, endpoints), heard)
    encoder = config.hood_encoder
    found += encoder_family_of(encoder).examine(encoder, around_encoder(config), heard)
    yield from _fold([*found, *_check_together(config, heard)])


def _fold(findings: list[Finding]) -> Iterator[Finding]:
    alike: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in findings:
        who, _, what = finding.check.partition(", ")
        alike.setdefault((what, finding.says, finding.do if finding.level == WARNING else who), []).append(finding)
    for (what, _, _), group in alike.items():
        names = ", ".join(finding.check.partition(", ")[0] for finding in group)
        yield group[0] if len(group) == 1 else replace(group[0], check=f"{what} of {names}")


def _check_together(config: Config, heard: Heard) -> Iterator[Finding]:
    if heard.asked:
        yield check_answer_times(config, heard)
    yield check_pulses(config, heard)
    yield from check_hood(config, heard)


def check_answer_times(config: Config, heard: Heard) -> Finding:
    """How long a question and its answer take: frames are stamped as they arrive, so all readings are as late."""
    check, limit_s = "feedback", config.gate.reading_age_s / 2      # the rest is for a device's own period and a tick
    times = {name: took_s for name, axis in name_axes(config) for question in family_of(axis).questions(axis, None)
             if question.is_remote and (took_s := heard.answer_s(question)) is not None}
    if not times:
        return warning(check, "no device can be asked how late its readings come", "see with --move")
    if late := [f"{name} {took_s * 1e3:.0f} ms" for name, took_s in times.items() if took_s > limit_s]:
        return failure(check, f"comes late, by question and answer: {', '.join(late)}; firing needs "
                       f"{limit_s * 1e3:.0f} ms", "look for what holds frames back: the adapter, its driver, a hub")
    return ok(check, f"answers take {max(times.values()) * 1e3:.0f} ms at most")


def check_pulses(config: Config, heard: Heard) -> Finding:
    """Whether a device says how it is twice as often as one does; a run would hold its fire for it."""
    check = "device numbers"
    pulses = {kind: period_ns for rules in make_rules(config) for kind, period_ns in rules.pulse.items()}
    twice = {f"{frames[0].name} {len(frames) / heard.seconds:.0f}/s instead of {NS_PER_S / period_ns:.0f}/s"
             for (frame_id, is_extended, _), period_ns in pulses.items()
             if len(frames := heard.of(frame_id, is_extended)) > SHARE * heard.seconds * NS_PER_S / period_ns + 1}
    if twice:
        return failure(check, f"two devices with one? {', '.join(sorted(twice))}",
                       "give each a number of its own; or set that rate back, by which two would give themselves away")
    return ok(check, "none speaks for two")


def find_hood(config: Config, heard: Heard) -> tuple[MotorReading, float | None]:
    """The hood motor's reading, and the elevation by the hood's encoder; None without one that knows its zero."""
    table, family = config.hood_encoder, encoder_family_of(config.hood_encoder)
    motor = make_motors(config)[len(config.axes.flywheels)]
    _take_in(motor, heard)
    if table.zero_deg is None or not table.is_heard or family.make_off_bus is not None:
        return motor.reading, None
    encoder = family.make(table, around_encoder(config))
    _take_in(encoder, heard)
    angle = encoder.reading or encoder.read(0)
    at_deg = None if angle is None else elevation_from_encoder_deg(angle.angle_rad, table, table.zero_deg)
    return motor.reading, at_deg


def _take_in(device: Motor | Encoder, heard: Heard) -> None:
    keys = set(device.ids())
    for frame in heard.frames:
        if (frame.arbitration_id, frame.is_extended) in keys and not frame.is_remote:
            with contextlib.suppress(BadFrame):
                device.take(frame)


def check_hood(config: Config, heard: Heard) -> Iterator[Finding]:
    """Whether limit switch and encoder say the same of where the hood is; nothing where either does not tell."""
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


def check_model(gate: GateConfig, path: Path | None) -> Finding:
    """Whether the model that the policy asks for is there, whole, and made for this robot's contract."""
    check = "gate model"
    if path is None:
        if gate.policy == "model":
            return failure(check, "gate.policy is 'model' and no model was given", "give --gate, as to `truearc run`")
        return ok(check, f"none is needed: gate.policy is {gate.policy!r}")
    try:
        model = load_gate(path)
    except InputError as error:
        return failure(check, str(error), "export it again with this version of truearc, and copy it whole")
    domain = ", ".join(f"{feature.name} {low:g} to {high:g}"
                       for feature, (low, high) in zip(FEATURES, model.domain, strict=True))
    return ok(check, f"sha256 {model.sha256[:12]}, this robot's contract; speaks of {domain}")


def check_aim(config: Config, path: Path | None) -> Iterator[Finding]:
    """Whether the aim file that the policy asks for is there, whole, and for this launcher; nothing without one."""
    check = "aim file"
    if not needs_aim(config):
        if path is not None:
            yield failure(check, f"aim.policy is {config.aim.policy!r}", "leave --aim out, or set it to 'belief'")
    elif path is None:
        yield failure(check, "aim.policy is 'belief' and no aim file was given", "give --aim, as to `truearc run`")
    else:
        try:
            aim = load_aim_for(path, config)
        except InputError as error:
            yield failure(check, str(error), "make it again with `truearc aim --robot` and this launcher.toml")
            return
        spans = ", ".join(f"{one.distance_m[0]:g} to {one.distance_m[-1]:g} m" for one in aim.content.segments)
        yield ok(check, f"sha256 {aim.sha256[:12]}, set points for {spans}")


def check_adapter(can: Can, link: CanLink | None) -> Finding:
    """The interface itself; `link` is None when the system has none of that name."""
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
    """The bitrate that the interface reports; where it reports none, whether any frame is received."""
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


def check_heartbeat_lock(axes: Iterable[Axis], heard: Heard) -> Finding:
    """Whether a competition's robot controller has the say here, now or before: over motors that are not ours to drive
    it may."""
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
