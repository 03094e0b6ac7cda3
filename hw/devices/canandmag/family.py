"""Redux Canandmag as an EncoderFamily."""

from functools import partial
from typing import Annotated

from msgspec import Meta, Struct

from truearc.hw.devices.axis import CanNode, Direction, Finite, HoodEncoder
from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.canandmag.bus_rules import make_rules
from truearc.hw.devices.canandmag.doctor import check_encoder
from truearc.hw.devices.canandmag.emulator import CanandmagNode
from truearc.hw.devices.hood_encoder import Encoder, EncoderFamily
from truearc.hw.protocols import Frame


class CanandmagConfig(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
                      tag="canandmag"):
    """A Canandmag whose magnet turns with the hood."""

    device: CanNode
    period_ms: Annotated[int, Meta(ge=0, le=65535)]    # set in the device at start; 0: no frame is sent to it
    zero_deg: Finite                  # encoder reading when the launch elevation is 0
    direction: Direction              # +1 if the reading grows with elevation


class CanandmagEncoder(Encoder):
    """The device, whose period is set once there is a bus."""

    def __init__(self, table: CanandmagConfig) -> None:
        self._device = table.device
        self._parse = partial(canandmag.parse, table.device)
        self._unsent = (canandmag.make_position_period(table.device, table.period_ms),) if table.period_ms else ()

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frame_id, True) for frame_id in canandmag.frame_ids(self._device))

    def take(self, frame: Frame) -> None:
        self.reading = self._parse(frame, self.reading)

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        frames, self._unsent = self._unsent, ()
        return frames


CANANDMAG = EncoderFamily(
    driver="canandmag", table=CanandmagConfig, example=CanandmagConfig(5, 10, 40.0, 1), least_sigma_deg=0.0,
    make=lambda table, around: CanandmagEncoder(table),
    make_rules=lambda table, each_tick: (make_rules(table.device, table.period_ms),), questions=lambda table: (),
    examine=lambda table, around, heard: (check_encoder(table.device, table.period_ms, around.longest_age_s, heard),),
    make_node=lambda table, plant, nodes: CanandmagNode(table.device, plant, table.zero_deg, table.direction))
