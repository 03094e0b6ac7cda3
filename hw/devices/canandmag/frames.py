"""Redux Canandmag absolute encoder: frames to send, and what the frames that come back say. No IO.

An arbitration id is 29 bits: that of device 0 plus the device's number.
"""

import math

from msgspec.structs import replace

from truearc.hw.codec import Values, load_codec
from truearc.hw.fault_codes import FRAME_UNEXPECTED, PERIOD_RANGE
from truearc.hw.protocols import AngleReading, BadFrame, Frame

MESSAGES = ("POSITION_OUTPUT", "STATUS")          # what becomes part of an AngleReading

POSITION_PERIOD_SETTING = 253                     # ms
FETCH_ONE = 2                                     # command: one setting is asked for
ID_CONFLICT = 0x02                                # the device has heard another with its number
FAULT_WORDS = (
    (0x01, "power cycle"), (0x02, "id conflict"), (0x04, "CAN error"), (0x08, "temperature"), (0x10, "hardware"),
    (0x20, "magnet out of range"), (0x40, "supply low"),
)
NO_ANGLE = 0x10 | 0x20                            # with one of these the angle means nothing


def fault_words(faults: int) -> tuple[str, ...]:
    """Return the names of the faults in a STATUS bit field."""
    return tuple(word for bit, word in FAULT_WORDS if faults & bit)


def name_of(device: int) -> str:
    """The device as messages name it."""
    return f"canandmag device {device}"


def frame_id(device: int, message: str) -> int:
    """Arbitration id (29 bits) of one of the encoder's messages."""
    return load_codec("canandmag").base_id(message) + device


def frame_ids(device: int) -> tuple[int, ...]:
    """Arbitration ids of the frames that `parse` understands; the angle's comes first."""
    return tuple(frame_id(device, message) for message in MESSAGES)


def ids_sent_by(device: int, node: str) -> tuple[int, ...]:
    """Arbitration ids (29 bits) of all frames about it that the "Encoder" or a "Host" sends, by the DBC file."""
    return tuple(frame_id(device, message) for message in load_codec("canandmag").sent_by(node))


def make_position_period(device: int, period_ms: int) -> Frame:
    """Ask for an angle every `period_ms` (1-65535) until the next power-down."""
    if not 1 <= period_ms <= 65535:
        raise BadFrame(PERIOD_RANGE(device=name_of(device), period_ms=period_ms))
    return make(device, "SET_SETTING", {"setting": POSITION_PERIOD_SETTING, "value": period_ms, "ephemeral": 1})


def make_period_query(device: int) -> Frame:
    """Ask for that period; the answer is a REPORT_SETTING frame, which `check_answer` knows."""
    return make(device, "SETTING_COMMAND", {"command": FETCH_ONE, "setting": POSITION_PERIOD_SETTING})


def check_answer(device: int, frame: Frame) -> None:
    """BadFrame for anything but a REPORT_SETTING frame."""
    load_codec("canandmag").parse_frame("REPORT_SETTING", frame, name_of(device))


def parse(device: int, frame: Frame, previous: AngleReading | None) -> AngleReading | None:
    """`previous` brought up to date by one frame; None until the first angle. Angle in [0, 2 pi), the device's sign.

    BadFrame: wrong length, or an id that is not among `frame_ids(device)`.
    """
    if frame.is_remote:
        return previous
    codec = load_codec("canandmag")
    message = next((name for name in MESSAGES if codec.base_id(name) == frame.arbitration_id - device), None)
    if message is None:
        raise BadFrame(FRAME_UNEXPECTED(device=name_of(device), frame=frame.name, wanted=MESSAGES))
    values = codec.parse_frame(message, frame, name_of(device))
    if message == "POSITION_OUTPUT":
        return _with_angle(values, frame.t_ns, previous)
    return _with_faults(int(values["faults"]), frame.t_ns, previous)


def _with_angle(values: Values, t_ns: int, previous: AngleReading | None) -> AngleReading:
    faults, faults_t_ns = (previous.faults, previous.faults_t_ns or 0) if previous is not None else (0, 0)
    return AngleReading(t_ns, values["absolute_rev"] * math.tau,
                        values["magnet_status"] == 0 and not faults & NO_ANGLE, faults, faults_t_ns)


def _with_faults(faults: int, t_ns: int, previous: AngleReading | None) -> AngleReading | None:
    if previous is None:
        return None
    # A device that recovers is believed again with its next angle, which brings the magnet's own bits.
    return replace(previous, faults=faults, faults_t_ns=t_ns, magnet_ok=previous.magnet_ok and not faults & NO_ANGLE)


def make(device: int, message: str, values: Values) -> Frame:
    """One of the messages about this encoder, whichever node of the DBC file sends it."""
    return Frame(0, frame_id(device, message), load_codec("canandmag").make(message, values), is_extended=True)
