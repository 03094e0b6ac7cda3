"""What the configuration says of the CAN bus: what may be sent and how often, what is heard, and in what cadence."""

import math
from collections import Counter

from hw import canandmag, odrive
from hw.allow import WINDOW_NS, Allowed, AllowedBus, allow
from hw.link import Bus, Clock
from hw.monitor import Kind, MonitoredBus
from robot.config import Config
from robot.rig import make_axis

NS_PER_MS = 1_000_000
SPARE = 1.5                           # a set point is sent once a tick at most, but after a late tick the next is early
SELDOM = 5                            # within WINDOW_NS, of what is asked a few times a second at most
HEARTBEAT_NS = 100 * NS_PER_MS        # how often an axis says how it is; its maker's own setting


def guard(bus: Bus, config: Config, clock: Clock, tally: Counter[str]) -> Bus:
    """`bus` with these rules on it: what breaks them is counted in `tally` and is a fault."""
    allowed = make_allowed(config)
    ours = {(kind.arbitration_id, kind.is_extended, kind.is_remote) for kind in allowed}
    ours |= set(make_sent_by(config, "Host", "Host"))           # what we could send to them but never do, too
    return MonitoredBus(AllowedBus(bus, allowed, clock, tally), make_sent_by(config, "Axis", "Encoder"), ours,
                        make_pulses(config), clock, tally)


def make_allowed(config: Config) -> tuple[Allowed, ...]:
    """Every kind of frame that the launcher's devices may be sent."""
    each_tick = math.ceil(SPARE * config.tick_hz * WINDOW_NS * 1e-9) + 1
    allowed = [allow(canandmag.make_position_period(_encoder(config), config.hood_encoder.period_ms), SELDOM)]
    for axis in _axes(config):
        allowed.append(allow(odrive.make_torque(axis, 0.0), each_tick))
        seldom = [odrive.make_state(axis, odrive.IDLE), odrive.make_clear_errors(axis),
                  odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH), odrive.make_estop(axis),
                  odrive.make_version_query(axis)]
        if axis.endstop_endpoint:
            seldom.append(odrive.make_endstop_query(axis))
        allowed += [allow(frame, SELDOM) for frame in seldom]
    return tuple(allowed)


def make_sent_by(config: Config, odrive_node: str, encoder_node: str) -> tuple[Kind, ...]:
    """Every kind of frame about the launcher's devices that these nodes of the DBC files send."""
    kinds = [(frame_id, True, False) for frame_id in canandmag.ids_sent_by(_encoder(config), encoder_node)]
    for axis in _axes(config):
        kinds += [(frame_id, False, False) for frame_id in odrive.ids_sent_by(axis, odrive_node)]
    return tuple(kinds)


def make_pulses(config: Config) -> dict[Kind, int]:
    """Of each device one kind of frame and its period (ns)."""
    pulses = {(odrive.heartbeat_id(axis), False, False): HEARTBEAT_NS for axis in _axes(config)}
    angle_id = canandmag.frame_ids(_encoder(config))[0]
    return pulses | {(angle_id, True, False): config.hood_encoder.period_ms * NS_PER_MS}


def _axes(config: Config) -> list[odrive.Axis]:
    return [make_axis(axis) for axis in (*config.axes.flywheels, config.axes.hood, config.axes.feeder)]


def _encoder(config: Config) -> canandmag.Encoder:
    return canandmag.Encoder(config.hood_encoder.device)
