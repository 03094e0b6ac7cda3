"""The computer: its time of day, its promises to a process that must be on time, its disk."""

from collections.abc import Sequence
from pathlib import Path

from truearc.hw.finding import Finding, failure, ok, warning

RECORDING_BYTES_S = 100_000           # ticks and CAN frames: 90 kB/s on the emulated robot, and half a MB a shot
FULL_BYTES = 200_000_000              # half an hour
SCARCE_BYTES = 2_000_000_000          # half a day


def check_clock(synchronised: bool | None) -> Finding:
    """The time of day only names recordings, so a wrong one is never a failure."""
    check = "time of day"
    if synchronised:
        return ok(check, "set by a time server")
    says = "not known whether it is right" if synchronised is None else "not set since the computer was started"
    return warning(check, f"{says}: recordings may bear wrong dates",
                   "connect it to a network with a time server once, or give it a battery-backed clock")


def check_real_time(answers: Sequence[tuple[str, str]]) -> list[Finding]:
    """`answers`: (the request to the system, why it was refused, "" = it was granted)."""
    return [warning("real time", f"{asked} is refused ({refused}): ticks may come late",
                    "run it as the service of `truearc deploy`, which is allowed to") if refused
            else ok("real time", f"{asked} is allowed") for asked, refused in answers]


def check_disk(folder: Path, free_bytes: int | None, writable: bool) -> Finding:
    """Room for recordings; `free_bytes` is None when the place cannot be asked."""
    check = "disk"
    if free_bytes is None or not writable:
        return failure(check, f"{folder} cannot be written to", "give --out a folder that this user may write to")
    room = f"{free_bytes / 1e9:.1f} GB are free in {folder}, {free_bytes / RECORDING_BYTES_S / 3600:.1f} h of recording"
    if free_bytes < FULL_BYTES:
        return failure(check, room, "copy recordings elsewhere and delete them here")
    if free_bytes < SCARCE_BYTES:
        return warning(check, room, "make room before a long day")
    return ok(check, room)
