"""The Redux Canandmag absolute encoder: frames, emulator, and EncoderFamily with table, bus rules and doctor checks.

Its arbitration ids have 29 bits; each is the id for device 0 plus the device number.
"""

import math
from functools import partial
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import replace

from truearc.hw import bus_rules, fault_codes, reason
from truearc.hw.codec import Values, load_codec
from truearc.hw.devices import drivers, family
from truearc.hw.devices.family import CHECK, CanNode, Direction, Encoder, EncoderFamily, Finding, failure, ok, warning
from truearc.hw.emulated.nodes import Plant, Report, ReportingNode, take_reports
from truearc.hw.protocols import NS_PER_MS, NS_PER_S, AngleReading, BadFrame, Frame

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
    """Return the device's name as used in messages."""
    return f"canandmag device {device}"


def frame_id(device: int, message: str) -> int:
    """Return the arbitration id (29 bits) of one of the encoder's messages."""
    return load_codec("canandmag").base_id(message) + device


def frame_ids(device: int) -> tuple[int, ...]:
    """Return the arbitration ids of the frames that `parse` understands; the angle's comes first."""
    return tuple(frame_id(device, message) for message in MESSAGES)


def ids_sent_by(device: int, node: str) -> tuple[int, ...]:
    """Return the arbitration ids (29 bits) of all frames that the "Encoder" or a "Host" sends, from the DBC file."""
    return tuple(frame_id(device, message) for message in load_codec("canandmag").sent_by(node))


def make_position_period(device: int, period_ms: int) -> Frame:
    """Request an angle every `period_ms` (1-65535) until the next power-down."""
    if not 1 <= period_ms <= 65535:
        raise BadFrame(fault_codes.PERIOD_RANGE(device=name_of(device), period_ms=period_ms))
    return make(device, "SET_SETTING", {"setting": POSITION_PERIOD_SETTING, "value": period_ms, "ephemeral": 1})


def make_period_query(device: int) -> Frame:
    """Query that period; the answer is a REPORT_SETTING frame."""
    return make(device, "SETTING_COMMAND", {"command": FETCH_ONE, "setting": POSITION_PERIOD_SETTING})


def parse(device: int, frame: Frame, previous: AngleReading | None) -> AngleReading | None:
    """Return `previous` updated by one frame; None until the first angle. Angle in [0, 2 pi), with the device's sign.

    BadFrame: wrong length, or an id that is not in `frame_ids(device)`.
    """
    if frame.is_remote:
        return previous
    codec = load_codec("canandmag")
    message = next((name for name in MESSAGES if codec.base_id(name) == frame.arbitration_id - device), None)
    if message is None:
        raise BadFrame(fault_codes.FRAME_UNEXPECTED(device=name_of(device), frame=frame.name, wanted=MESSAGES))
    values = codec.parse_frame(message, frame, name_of(device))
    if message == "POSITION_OUTPUT":
        faults, faults_t_ns = (previous.faults, previous.faults_t_ns or 0) if previous is not None else (0, 0)
        return AngleReading(frame.t_ns, values["absolute_rev"] * math.tau,
                            values["magnet_status"] == 0 and not faults & NO_ANGLE, faults, faults_t_ns)
    faults = int(values["faults"])
    # A device that recovers is believed again with its next angle, which brings the magnet's own bits.
    return previous and replace(previous, faults=faults, faults_t_ns=frame.t_ns,
                                magnet_ok=previous.magnet_ok and not faults & NO_ANGLE)


def make(device: int, message: str, values: Values) -> Frame:
    """Return one of the messages about this encoder, whichever node of the DBC file sends it."""
    return Frame(0, frame_id(device, message), load_codec("canandmag").make(message, values), is_extended=True)


COUNTS = 16384                                    # per turn
POSITION_PERIOD_NS = 20 * NS_PER_MS                      # of a new device
STATUS_PERIOD_NS = 100 * NS_PER_MS
POWER_CYCLE = 0x01
MAGNET_OUT_OF_RANGE = 0x20
MAGNET_LOST_STATUS = 3
TEMPERATURE_DEGC = 25
RELATIVE_COUNTS = 1 << 31                         # the count is 32 bits, signed, and wraps


class CanandmagNode(ReportingNode):
    """The emulated encoder on the hood's pivot.

    `zero_deg`: its reading at launch elevation 0; `direction`: +1 if the reading grows with elevation. Set `magnet_ok`
    to False to emulate a magnet that has fallen off.
    """

    def __init__(self, device: int, plant: Plant, zero_deg: float, direction: int) -> None:
        self.magnet_ok = True
        self._device, self._plant = device, plant
        self._zero_rad, self._direction = math.radians(zero_deg), direction
        self._codec = load_codec("canandmag")
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Restore power: a temporary period is forgotten, and the count of turns restarts at 0."""
        self._sticky = POWER_CYCLE
        self._start_counts = self._counts()
        self._position = Report(POSITION_PERIOD_NS, t_ns, self._make_position)
        self._reports = (self._position, Report(STATUS_PERIOD_NS, t_ns, self._make_status))
        self._due_ns = t_ns

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frame_id(self._device, name), True)
                     for name in ("SETTING_COMMAND", "SET_SETTING", "CLEAR_STICKY_FAULTS"))

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Apply a setting or clear sticky faults; a malformed frame is ignored and counted."""
        if frame.is_remote:
            return []
        if frame.arbitration_id == frame_id(self._device, "CLEAR_STICKY_FAULTS"):
            self._sticky = 0
            return []
        if frame.arbitration_id == frame_id(self._device, "SETTING_COMMAND"):
            return self._answer(self._parse(self._codec, "SETTING_COMMAND", frame))
        values = self._parse(self._codec, "SET_SETTING", frame)
        return [] if values is None else [self._take_setting(int(values["setting"]), int(values["value"]), t_ns)]

    def step(self, t_ns: int) -> list[Frame]:
        if t_ns < self._due_ns:
            return []
        frames = take_reports(self._reports, t_ns)
        self._plan()
        return frames

    def _take_setting(self, setting: int, value: int, t_ns: int) -> Frame:
        accepted = setting == POSITION_PERIOD_SETTING and value <= 0xFFFF
        if accepted:
            self._position.set_period(value * NS_PER_MS, t_ns)
            self._plan()
        return make(self._device, "REPORT_SETTING", {"setting": setting, "value": value, "accepted": int(accepted),
                                                      "committed": 0})

    def _answer(self, values: Values | None) -> list[Frame]:
        """The one setting that is emulated, where it is asked for."""
        if values is None or (values["command"], values["setting"]) != (FETCH_ONE, POSITION_PERIOD_SETTING):
            return []
        return [make(self._device, "REPORT_SETTING", {
            "setting": POSITION_PERIOD_SETTING, "value": self._position.period_ns // NS_PER_MS, "accepted": 1,
            "committed": 0})]

    def _counts(self) -> int:
        angle_rad = self._zero_rad + self._direction * self._plant.hood_encoder_rad()
        return round(angle_rad / math.tau * COUNTS)

    def _make_position(self) -> Frame:
        counts = self._counts()
        relative = (counts - self._start_counts + RELATIVE_COUNTS) % (2 * RELATIVE_COUNTS) - RELATIVE_COUNTS
        return make(self._device, "POSITION_OUTPUT", {
            "relative_rev": relative / COUNTS, "absolute_rev": counts % COUNTS / COUNTS,
            "magnet_status": 0 if self.magnet_ok else MAGNET_LOST_STATUS})

    def _make_status(self) -> Frame:
        faults = 0 if self.magnet_ok else MAGNET_OUT_OF_RANGE
        self._sticky |= faults
        return make(self._device, "STATUS", {"faults": faults, "sticky_faults": self._sticky,
                                              "temperature_degc": TEMPERATURE_DEGC})




def make_rules(device: int, period_ms: int) -> bus_rules.Rules:
    """Return the rules. `period_ms`: between angles, as set at start; 0: nothing is sent, another host sets the
    rate."""
    by_host, by_device = (bus_rules.kinds_of(ids_sent_by(device, node), True) for node in ("Host", "Encoder"))
    if not period_ms:
        return bus_rules.Rules((), by_host, by_device, {(frame_id(device, "STATUS"), True, False): STATUS_PERIOD_NS})
    sent = [make_position_period(device, period_ms), make_period_query(device)]
    return bus_rules.Rules(bus_rules.allow_seldom(sent), by_host, by_device,
                 {(frame_ids(device)[0], True, False): period_ms * NS_PER_MS})


ENOUGH = 3                            # angles within the age that may still fire


def check_encoder(device: int, period_ms: int, longest_age_s: float, heard: family.Heard) -> Finding:
    """Check that a healthy device sends the angle often enough. The device does not filter its position.

    period_ms: between angles, as configured. longest_age_s: of an angle that still permits firing.
    """
    ids = frame_ids(device)
    start: AngleReading | None = None
    reading, refused = heard.read([(frame_id, True) for frame_id in ids], partial(parse, device), start)
    if refused:
        return failure(CHECK, f"sends impossible values ({refused[0]})",
                       "look at the wiring, and for another such device")
    if reading is None:
        return failure(CHECK, f"device {device} is silent", "look at its power and plug, and at its device number")
    statuses = len(heard.of(ids[1], extended=True))
    if reading.faults & ID_CONFLICT or statuses > bus_rules.SHARE * heard.seconds * NS_PER_S / STATUS_PERIOD_NS + 1:
        return failure(CHECK, f"two devices have number {device}", "give each a number of its own")
    if not reading.magnet_ok:
        return failure(CHECK, "cannot see its magnet", "look at the magnet on the hood's pivot and its distance")
    angles_s = len(heard.of(ids[0], extended=True)) / heard.seconds
    if angles_s < ENOUGH / longest_age_s:
        return failure(CHECK, f"{angles_s:.0f} angles/s; firing needs {ENOUGH / longest_age_s:.0f}",
                       f"set its position period to {period_ms} ms")
    if reading.faults:
        return warning(CHECK, ", ".join(fault_words(reading.faults)), "look into it before a match")
    return ok(CHECK, f"{angles_s:.0f} angles/s, magnet in sight; positions are not filtered")


class CanandmagConfig(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
                      tag="canandmag"):
    """A Canandmag whose magnet turns with the hood."""

    device: CanNode
    period_ms: Annotated[int, Meta(ge=0, le=65535)]    # set in the device at start; 0: no frame is sent to it
    zero_deg: family.Finite                  # encoder reading when the launch elevation is 0
    direction: Direction              # +1 if the reading grows with elevation


class CanandmagEncoder(Encoder):
    """The encoder, whose period is set once the bus is available and queried once a second.

    Its readings are older by the device's answer time; if nothing may be sent to it, that time is unknown.
    """

    def __init__(self, table: CanandmagConfig) -> None:
        self._device = table.device
        self._parse = partial(parse, table.device)
        self._unsent = (make_position_period(table.device, table.period_ms),) if table.period_ms else ()
        self._answer_id = frame_id(table.device, "REPORT_SETTING")
        self._question = make_period_query(table.device)
        self._trip = drivers.RoundTrip(name_of(table.device)) if table.period_ms else None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        answers = () if self._trip is None else ((self._answer_id, True),)
        return (*((frame_id, True) for frame_id in frame_ids(self._device)), *answers)

    def take(self, frame: Frame) -> None:
        if self._trip is None:
            self.reading = self._parse(frame, self.reading)
        elif frame.arbitration_id == self._answer_id:
            load_codec("canandmag").parse_frame("REPORT_SETTING", frame, name_of(self._device))
            self.reading = family.aged(self.reading, self._trip.answered(frame.t_ns))
        else:
            self.reading = self._parse(drivers.older(frame, self._trip.late_ns), self.reading)

    def faults(self, t_ns: int) -> tuple[reason.Reason, ...]:
        return () if self._trip is None else family.trip_faults(self._trip, t_ns)

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        frames, self._unsent = self._unsent, ()
        if self._trip is None or not self._trip.is_due:
            return frames
        self._trip.asked()
        return (*frames, self._question)


def errors(table: CanandmagConfig, faults: int) -> tuple[reason.Reason, ...]:
    """Report another device with the same number: the angle may be the other's."""
    return (fault_codes.ERROR_ID_CONFLICT(),) if faults & ID_CONFLICT else ()


CANANDMAG = EncoderFamily(
    driver="canandmag", table=CanandmagConfig, example=CanandmagConfig(5, 10, 40.0, 1), least_sigma_deg=0.0,
    make=lambda table, around: CanandmagEncoder(table),
    make_rules=lambda table, each_tick: (make_rules(table.device, table.period_ms),),
    questions=lambda table: (make_period_query(table.device),) if table.period_ms else (),
    answer_id=lambda table: frame_id(table.device, "REPORT_SETTING"), errors=errors,
    examine=lambda table, around, heard: (check_encoder(table.device, table.period_ms, around.longest_age_s, heard),),
    make_node=lambda table, plant, nodes: CanandmagNode(table.device, plant, table.zero_deg, table.direction))
