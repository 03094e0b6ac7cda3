r"""The operator's button box, which uses a line protocol over a serial port.

    $B,<seq>,<button>*<crc>\r\n         one press
    $H,<seq>*<crc>\r\n                  every 0.5 s: heartbeat; <seq> is that of the newest press

`<seq>` counts presses in decimal without leading zeros, from 0 to 65535 and then from 0 again. A gap means lost
presses, which the heartbeat reveals even when no further press follows. `<crc>` is the CRC-8 (polynomial 0x07, start 0,
as in SMBus) of the characters between `$` and `*`, as two upper-case hexadecimal digits. A line that does not match
exactly is refused. `docs/how-to/button-box.md` describes the protocol for people who build a box.
"""

import re
from collections.abc import Sequence

from msgspec import Struct

from truearc.hw.emulated.serial_link import Cable, open_cable
from truearc.hw.fault_codes import BOX_LINES_REFUSED, BOX_PRESSES_LOST, BOX_PRESSES_REPEATED, BOX_RESTARTED
from truearc.hw.protocols import ButtonEvent
from truearc.hw.reason import Reason

BUTTONS = ("arm", "fire", "miss-low", "miss-high", "two", "two-low", "two-high", "three", "reject", "accept",
           "miss-left", "miss-right")
HEARTBEAT_NS = 500_000_000
SEQ_COUNT = 65536
LONGEST = 64                                      # bytes; no line is longer
END = b"\r\n"

_LINE = re.compile(rb"(?:B,(0|[1-9]\d{0,4}),([a-z-]+)|H,(0|[1-9]\d{0,4}))\*([0-9A-F]{2})\r")


class BoxHeartbeat(Struct, frozen=True):
    """A heartbeat of the box; `seq` is the number of its newest press."""

    t_ns: int
    seq: int


BoxEvent = ButtonEvent | BoxHeartbeat


def make_press(seq: int, button: str) -> bytes:
    """Return the line for one press; ValueError for an unknown button."""
    if button not in BUTTONS:
        raise ValueError(f"no button {button!r}; there are {', '.join(BUTTONS)}")
    return _make(f"B,{seq % SEQ_COUNT},{button}")


def make_heartbeat(seq: int) -> bytes:
    """Return the line for one heartbeat; `seq` is the number of the newest press."""
    return _make(f"H,{seq % SEQ_COUNT}")


def lost_presses(previous_seq: int, seq: int) -> int:
    """Return how many presses are missing between two sequence numbers; `seq` belongs to a press."""
    return (seq - previous_seq - 1) % SEQ_COUNT


def parse_lines(pending: bytes, data: bytes, t_ns: int) -> tuple[list[BoxEvent], bytes, list[Reason]]:
    """Return the events in `pending + data`, the remainder to pass next time, and at most one fault.

    `pending` is the remainder of the previous call (initially empty); `t_ns` stamps every event. Garbage gives faults,
    never an exception or an event, and the remainder is never longer than a line.
    """
    *lines, rest = (pending + data).split(b"\n")
    events: list[BoxEvent] = []
    refused: list[bytes] = []
    for line in lines:
        before, start, body = line.rpartition(b"$")
        event = _parse(body, t_ns) if start else None
        if event is not None:
            events.append(event)
        if event is None or before:
            refused.append(line)
    if len(rest) > LONGEST:
        refused.append(rest)
        rest = rest[-LONGEST:]
    if not refused:
        return events, rest, []
    return events, rest, [BOX_LINES_REFUSED(lines=len(refused), first=refused[0][:LONGEST].decode("latin-1"))]


def _parse(body: bytes, t_ns: int) -> BoxEvent | None:
    match = _LINE.fullmatch(body)
    if match is None or match[4] != b"%02X" % _crc(body[:-4]):
        return None
    seq = int(match[1] or match[3])
    if seq >= SEQ_COUNT:
        return None
    if match[2] is None:
        return BoxHeartbeat(t_ns, seq)
    button = match[2].decode("ascii")
    return ButtonEvent(t_ns, seq, button) if button in BUTTONS else None


def _make(body: str) -> bytes:
    text = body.encode("ascii")
    return b"$%b*%02X" % (text, _crc(text)) + END


def _crc(text: bytes) -> int:
    crc = 0
    for byte in text:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x07 if crc & 0x80 else crc << 1) & 0xFF
    return crc


class PressCount:
    """Tracks the number of the newest press received.

    The same button with the same number is the same press, but only within the longest silence of a live box: after
    that it could be the first press of a box that lost power.
    """

    def __init__(self) -> None:
        self._seq: int | None = None
        self._press: ButtonEvent | None = None

    def take(self, events: Sequence[BoxEvent]) -> tuple[list[ButtonEvent], list[Reason], Reason | None]:
        """Return the new presses, what is wrong with their numbers, and the newest fault that suggests lost presses (or
        None)."""
        presses: list[ButtonEvent] = []
        faults: list[Reason] = []
        twice = 0
        for event in events:
            if isinstance(event, ButtonEvent):
                if self._is_known(event):
                    twice += 1
                    continue
                self._press = event
                presses.append(event)
            # A press counts itself; a heartbeat repeats the number of the newest press.
            expected = event.seq if isinstance(event, ButtonEvent) else event.seq + 1
            lost = 0 if self._seq is None else lost_presses(self._seq, expected)
            self._seq = event.seq
            if lost:
                # Half the count ahead is behind: a box that was without power counts from the start again.
                faults.append(BOX_RESTARTED() if lost >= SEQ_COUNT // 2 else BOX_PRESSES_LOST(presses=lost))
        missed = faults[-1] if faults else None
        return presses, faults + ([BOX_PRESSES_REPEATED(presses=twice)] if twice else []), missed

    def _is_known(self, event: ButtonEvent) -> bool:
        last = self._press
        return (last is not None and event.seq == last.seq == self._seq and event.button == last.button
                and event.t_ns - last.t_ns < HEARTBEAT_NS)


# --- the emulated box

class ButtonBox:
    """The emulated box: it counts presses and sends a heartbeat every half second."""

    def __init__(self, cable: Cable, start_ns: int = 0) -> None:
        self.port = cable.port
        self._cable: Cable | None = cable
        self._seq = 0
        self._due_ns = start_ns

    def press(self, button: str) -> None:
        """Press a button at once; ValueError for an unknown one. Nothing is sent once unplugged."""
        self._seq = (self._seq + 1) % SEQ_COUNT
        self._say(make_press(self._seq, button))

    def step(self, t_ns: int) -> None:
        """Send the heartbeat that is due by `t_ns`; missed ones are skipped."""
        if t_ns >= self._due_ns:
            self._due_ns += HEARTBEAT_NS * (1 + (t_ns - self._due_ns) // HEARTBEAT_NS)
            self._say(make_heartbeat(self._seq))

    def unplug(self) -> None:
        """Unplug the cable for good; the robot's next read reports it."""
        if self._cable is not None:
            self._cable.close()
            self._cable = None

    def _say(self, line: bytes) -> None:
        if self._cable is not None:
            self._cable.write(line)


def open_button_box(prompt: bool = True) -> ButtonBox:
    """Open a box on a cable; `prompt` as in truearc.hw.emulated.serial_link.open_cable."""
    return ButtonBox(open_cable(prompt))
