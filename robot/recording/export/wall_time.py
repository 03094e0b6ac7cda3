"""What dates a recording: the wall clock less the robot's own clock.

The robot's clock is monotonic, and begins anywhere. A session says in its header how far the wall clock was ahead of it
at the start; if the wall clock was set later, times go on as if it had not been.
"""

from typing import NamedTuple

from msgspec import UNSET

from truearc.errors import InputError
from truearc.hw.real.clock import unix_s
from truearc.robot.recording.session import Header

BY_HEADER = "wall clock, as at the start of the session"
BY_START = ("wall clock to a few seconds: the session is from before its header said more than `started`, which is "
            "taken as the time of the first tick")
EMULATED = "an emulated robot's clock, which begins at zero (1970)"


class WallTime(NamedTuple):
    """Wall clock (Unix) less the robot's clock in ns, and how that is known."""

    offset_ns: int
    how: str


def wall_time(header: Header, first_t_ns: int) -> WallTime:
    """How to date a session whose first tick is at `first_t_ns`; InputError where `started` is not a time."""
    if header.wall_offset_ns is not UNSET:
        return WallTime(header.wall_offset_ns, BY_HEADER)
    if header.started is None:
        return WallTime(0, EMULATED)
    try:
        started_ns = unix_s(header.started) * 1_000_000_000
    except ValueError as error:
        raise InputError(f"session.json: started: {header.started!r} is not a time (ISO 8601)") from error
    return WallTime(started_ns - first_t_ns, BY_START)
