"""Redux Canandmag as an EncoderFamily: its table, its bus rules and its doctor."""

from functools import partial
from typing import Annotated

from msgspec import Meta, Struct

from truearc.hw.bus_rules import SHARE, Rules, allow_seldom, kinds_of
from truearc.hw.devices import family
from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.canandmag.emulator import CanandmagNode
from truearc.hw.devices.drivers import RoundTrip, older
from truearc.hw.devices.family import CanNode, Direction, Encoder, EncoderFamily, Finding, Finite, failure, ok, warning
from truearc.hw.fault_codes import ERROR_ID_CONFLICT
from truearc.hw.protocols import NS_PER_MS, AngleReading, Frame
from truearc.hw.reason import Reason

STATUS_NS = 100 * NS_PER_MS           # between status frames, in a device as it comes


def make_rules(device: int, period_ms: int) -> Rules:
    """`period_ms`: between angles, as the device is set at start; 0: nothing is sent, its cadence is another's."""
    by_host, by_device = (kinds_of(canandmag.ids_sent_by(device, node), True) for node in ("Host", "Encoder"))
    if not period_ms:
        return Rules((), by_host, by_device, {(canandmag.frame_id(device, "STATUS"), True, False): STATUS_NS})
    sent = [canandmag.make_position_period(device, period_ms), canandmag.make_period_query(device)]
    return Rules(allow_seldom(sent), by_host, by_device,
                 {(canandmag.frame_ids(device)[0], True, False): period_ms * NS_PER_MS})


CHECK = "hood encoder"
STATUS_S = 0.1                        # between its status frames
ENOUGH = 3                            # angles within the age that may still fire


def check_encoder(device: int, period_ms: int, longest_age_s: float, heard: family.Heard) -> Finding:
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
    if reading.faults & canandmag.ID_CONFLICT or statuses > SHARE * heard.seconds / STATUS_S + 1:
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


class CanandmagConfig(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
                      tag="canandmag"):
    """A Canandmag whose magnet turns with the hood."""

    device: CanNode
    period_ms: Annotated[int, Meta(ge=0, le=65535)]    # set in the device at start; 0: no frame is sent to it
    zero_deg: Finite                  # encoder reading when the launch elevation is 0
    direction: Direction              # +1 if the reading grows with elevation


class CanandmagEncoder(Encoder):
    """The device, whose period is set once there is a bus, and which is asked for it once a second.

    Its readings are older by the time that an answer takes; of one that is not to be sent anything that is not known.
    """

    def __init__(self, table: CanandmagConfig) -> None:
        self._device = table.device
        self._parse = partial(canandmag.parse, table.device)
        self._unsent = (canandmag.make_position_period(table.device, table.period_ms),) if table.period_ms else ()
        self._answer_id = canandmag.frame_id(table.device, "REPORT_SETTING")
        self._question = canandmag.make_period_query(table.device)
        self._trip = RoundTrip(canandmag.name_of(table.device)) if table.period_ms else None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        answers = () if self._trip is None else ((self._answer_id, True),)
        return (*((frame_id, True) for frame_id in canandmag.frame_ids(self._device)), *answers)

    def take(self, frame: Frame) -> None:
        if self._trip is None:
            self.reading = self._parse(frame, self.reading)
        elif frame.arbitration_id == self._answer_id:
            canandmag.check_answer(self._device, frame)
            self.reading = family.aged(self.reading, self._trip.answered(frame.t_ns))
        else:
            self.reading = self._parse(older(frame, self._trip.late_ns), self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        return () if self._trip is None else family.trip_faults(self._trip, t_ns)

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        frames, self._unsent = self._unsent, ()
        if self._trip is None or not self._trip.is_due:
            return frames
        self._trip.asked()
        return (*frames, self._question)


def errors(table: CanandmagConfig, faults: int) -> tuple[Reason, ...]:
    """Another with its number: the angle may be the other's."""
    return (ERROR_ID_CONFLICT(),) if faults & canandmag.ID_CONFLICT else ()


CANANDMAG = EncoderFamily(
    driver="canandmag", table=CanandmagConfig, example=CanandmagConfig(5, 10, 40.0, 1), least_sigma_deg=0.0,
    make=lambda table, around: CanandmagEncoder(table),
    make_rules=lambda table, each_tick: (make_rules(table.device, table.period_ms),), questions=lambda table: (),
    errors=errors,
    examine=lambda table, around, heard: (check_encoder(table.device, table.period_ms, around.longest_age_s, heard),),
    make_node=lambda table, plant, nodes: CanandmagNode(table.device, plant, table.zero_deg, table.direction))
