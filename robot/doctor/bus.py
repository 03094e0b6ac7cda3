"""The CAN adapter, its bitrate, and whose bus it is."""

from collections.abc import Iterable

from truearc.hw.devices.axis import Axis
from truearc.hw.devices.listening import Heard
from truearc.hw.devices.registry import family_of
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.frc import is_controller_heartbeat, locked_spark
from truearc.hw.machine import CanLink
from truearc.robot.config.schema import Can

SHORT_QUEUE = 64                      # frames; the kernel's own ten are full within one tick of four axes
BRING_UP = "bring it up with the files of `truearc deploy`, or `ip link set {} up type can bitrate {} restart-ms 100`"


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
