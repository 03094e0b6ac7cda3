"""The absolute encoder on the hood's pivot."""

from functools import partial

from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.family import Heard
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.monitor import SHARE
from truearc.hw.protocols import AngleReading

CHECK = "hood encoder"
ID_CONFLICT = 0x02                    # it says so itself
STATUS_S = 0.1                        # between its status frames
ENOUGH = 3                            # angles within the age that may still fire


def check_encoder(device: int, period_ms: int, longest_age_s: float, heard: Heard) -> Finding:
    """Whether the angle comes, often enough, from a healthy device. Its position is not filtered in the device.

    period_ms: between angles, as configured. longest_age_s: of an angle that may still fire.
    """
    ids = canandmag.frame_ids(device)
    start: AngleReading | None = None
    reading, refused = heard.read([(frame_id, True) for frame_id in ids], partial(canandmag.parse, device), start)
    if refused:
        return failure(CHECK, f"sends what cannot be ({refused[0]})", "look at the wiring, and for another such device")
    if reading is None:
        return failure(CHECK, f"device {device} is silent", "look at its power and plug, and at its device number")
    statuses = len(heard.of(ids[1], extended=True))
    if reading.faults & ID_CONFLICT or statuses > SHARE * heard.seconds / STATUS_S + 1:
        return failure(CHECK, f"two devices have number {device}", "give each a number of its own")
    if not reading.magnet_ok:
        return failure(CHECK, "cannot see its magnet", "look at the magnet on the hood's pivot and its distance")
    angles_s = len(heard.of(ids[0], extended=True)) / heard.seconds
    if angles_s < ENOUGH / longest_age_s:
        return failure(CHECK, f"{angles_s:.0f} angles/s; firing needs {ENOUGH / longest_age_s:.0f}",
                       f"set its position period to {period_ms} ms")
    if reading.faults:
        return warning(CHECK, ", ".join(canandmag.fault_words(reading.faults)), "look into it before a match")
    return ok(CHECK, f"{angles_s:.0f} angles/s, magnet in sight; positions are not filtered")
