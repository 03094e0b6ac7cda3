"""Frames that one device may be sent, and those that it and hosts send: for the allow-list and the bus monitor."""

from collections.abc import Iterable

from msgspec import Struct

from truearc.hw.monitor import Kind
from truearc.hw.protocols import Frame
from truearc.hw.tx_allowlist import Allowed, allow

NS_PER_MS = 1_000_000
SELDOM = 5                            # within WINDOW_NS, of what is asked a few times a second at most


class Rules(Struct, frozen=True):
    """Of one device: what it may be sent, what hosts and it itself send, and one kind of its frames with its period."""

    allowed: tuple[Allowed, ...]      # nothing: the device is another controller's
    by_host: tuple[Kind, ...]
    by_device: tuple[Kind, ...]
    pulse: dict[Kind, int]            # kind -> period in ns


def allow_seldom(frames: Iterable[Frame]) -> tuple[Allowed, ...]:
    """Frames such as these, a few times a second."""
    return tuple(allow(frame, SELDOM) for frame in frames)


def kinds_of(frame_ids: Iterable[int], is_extended: bool) -> tuple[Kind, ...]:
    """Data frames with these arbitration ids."""
    return tuple((frame_id, is_extended, False) for frame_id in frame_ids)
