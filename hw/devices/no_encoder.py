"""No hood encoder: the angle is what the hood's motor has counted since homing."""

from msgspec import Struct

from truearc.hw.devices.axis import HoodEncoder
from truearc.hw.devices.hood_encoder import CHECK, Encoder, EncoderFamily
from truearc.hw.finding import ok

# Play of the nut, where the switch closes, and a jump of the count that is too small to show: nothing corrects them
SIGMA_DEG = 0.5


class NoEncoder(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="none"):
    """There is none, so nothing checks the count."""

    @property
    def is_heard(self) -> bool:
        return False


NONE = EncoderFamily(
    driver="none", table=NoEncoder, example=NoEncoder(), least_sigma_deg=SIGMA_DEG,
    make=lambda table, around: Encoder(), make_rules=lambda table, each_tick: (), questions=lambda table: (),
    examine=lambda table, around, heard: (ok(CHECK, "there is none: the screw's count since homing is not checked"),),
    make_node=lambda table, plant, nodes: None)
