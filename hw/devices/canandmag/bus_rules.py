"""Frames that a Canandmag may be sent, and those that it and hosts send."""

from truearc.hw.devices.bus_rules import NS_PER_MS, Rules, allow_seldom, kinds_of
from truearc.hw.devices.canandmag import frames as canandmag

STATUS_NS = 100 * NS_PER_MS           # between status frames, in a device as it comes


def make_rules(device: int, period_ms: int) -> Rules:
    """`period_ms`: between angles, as the device is set at start; 0: nothing is sent, its cadence is another's."""
    by_host, by_device = (kinds_of(canandmag.ids_sent_by(device, node), True) for node in ("Host", "Encoder"))
    if not period_ms:
        return Rules((), by_host, by_device, {(canandmag.frame_id(device, "STATUS"), True, False): STATUS_NS})
    sent = [canandmag.make_position_period(device, period_ms), canandmag.make_period_query(device)]
    return Rules(allow_seldom(sent), by_host, by_device,
                 {(canandmag.frame_ids(device)[0], True, False): period_ms * NS_PER_MS})
