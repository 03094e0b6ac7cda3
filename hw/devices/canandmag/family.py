"""Redux Canandmag as an EncoderFamily."""

from functools import partial
from typing import Annotated

from msgspec import Meta, Struct

from truearc.hw.devices.axis import CanNode, Direction, Finite, HoodEncoder
from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.canandmag.bus_rules import make_rules
from truearc.hw.devices.canandmag.doctor import check_encoder
from truearc.hw.devices.canandmag.emulator import CanandmagNode
from truearc.hw.devices.heard_motor import older
from truearc.hw.devices.hood_encoder import Encoder, EncoderFamily, aged, trip_faults
from truearc.hw.devices.round_trip import RoundTrip
from truearc.hw.fault_codes import ERROR_ID_CONFLICT
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason


class CanandmagConfig(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
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
        self._trip = RoundTrip(f"canandmag device {table.device}") if table.period_ms else None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        answers = () if self._trip is None else ((self._answer_id, True),)
        return (*((frame_id, True) for frame_id in canandmag.frame_ids(self._device)), *answers)

    def take(self, frame: Frame) -> None:
        if self._trip is None:
            self.reading = self._parse(frame, self.reading)
        elif frame.arbitration_id == self._answer_id:
            canandmag.check_answer(self._device, frame)
            self.reading = aged(self.reading, self._trip.answered(frame.t_ns))
        else:
            self.reading = self._parse(older(frame, self._trip.late_ns), self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        return () if self._trip is None else trip_faults(self._trip, t_ns)

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
