"""Frames that an ODrive axis may be sent, and those that it and hosts send."""

from truearc.hw.devices.bus_rules import NS_PER_MS, Rules, allow_seldom, kinds_of
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.tx_allowlist import allow

PULSE_NS = 100 * NS_PER_MS            # heartbeat: how often an axis says how it is; its maker's own setting


def make_rules(axis: odrive.OdriveAxis, each_tick: int) -> Rules:
    """`each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    seldom = [odrive.make_clear_errors(axis), odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH),
              odrive.make_estop(axis), odrive.make_version_query(axis)]
    if axis.torque_nm_a:
        seldom.append(odrive.make_limits(axis, 0.0, 0.0))
    if axis.endstop_endpoint:
        seldom.append(odrive.make_endstop_query(axis))
    seldom.append(odrive.make_address_query(axis))
    by_host, by_device = (kinds_of(odrive.ids_sent_by(axis, node), False) for node in ("Host", "Axis"))
    always = [odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE)]      # to let go is never refused
    return Rules((*(allow(frame, each_tick) for frame in always), *allow_seldom(seldom)), by_host, by_device,
                 {(odrive.frame_id(axis, "Heartbeat"), False, False): PULSE_NS})
