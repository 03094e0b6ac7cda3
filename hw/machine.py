"""Facts about parts of a machine, parsed from the output of its tools. No IO."""

from typing import Any

import msgspec
from msgspec import Struct


class CanLink(Struct, frozen=True):
    """A CAN network interface; None = the system does not say (a virtual one has no bitrate)."""

    is_up: bool
    queue: int | None                 # frames that may wait to be sent
    state: str | None                 # "ERROR-ACTIVE" (healthy), "ERROR-WARNING", "ERROR-PASSIVE", "BUS-OFF", ...
    bitrate: int | None
    restart_ms: int | None            # how long after bus-off the kernel tries again; 0 = never


class Exposure(Struct, frozen=True):
    """How a camera exposes; None = it does not say."""

    automatic: bool | None
    length_s: float | None


def parse_link(text: str) -> CanLink | None:
    """One interface out of `ip -json -details link show NAME`; None when there is none in it."""
    try:
        links = msgspec.json.decode(text)
    except msgspec.DecodeError:
        return None
    if not isinstance(links, list) or not links or not isinstance(links[0], dict):
        return None
    link = links[0]
    data = _table(_table(link, "linkinfo"), "info_data")
    flags = link.get("flags")
    return CanLink(isinstance(flags, list) and "UP" in flags, _whole(link, "txqlen"),
                   state if isinstance(state := data.get("state"), str) else None,
                   _whole(_table(data, "bittiming"), "bitrate"), _whole(data, "restart_ms"))


def _table(table: dict[str, Any], key: str) -> dict[str, Any]:
    value = table.get(key)
    return value if isinstance(value, dict) else {}


def _whole(table: dict[str, Any], key: str) -> int | None:
    value = table.get(key)
    return value if isinstance(value, int) and not isinstance(value, bool) else None
