"""Tables of one motor axis and of the hood's encoder in launcher.toml: what every family's struct has in common."""

from typing import Annotated, Any, ClassVar, Literal

import msgspec

Finite = Annotated[float, msgspec.Meta(gt=-1e9, lt=1e9)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, lt=1e9)]
CanNode = Annotated[int, msgspec.Meta(ge=0, le=62)]     # 63 addresses every ODrive, and every device of the FRC
TorquePerAmp = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]      # Nm/A: a motor of 10 kW has 1
Direction = Literal[-1, 1]            # sign that makes positive launch a ball or raise the hood


class Axis:
    """Base of the structs that a family declares for its table, beside msgspec.Struct.

    Such a struct has `forbid_unknown_fields=True`, `tag_field="driver"` and its family's name as `tag`. No key has a
    default but one that earlier files lack, and then `omit_defaults=True`: their recordings keep their hash.
    """

    __slots__ = ()
    __struct_config__: ClassVar[Any]


class HoodEncoder:
    """Base of the structs that a family declares for [hood_encoder], beside msgspec.Struct; tagged as an Axis's are."""

    __slots__ = ()
    __struct_config__: ClassVar[Any]

    @property
    def is_heard(self) -> bool:
        """Whether there is one. If not, the hood's angle is the count of its screw since homing."""
        return True

    @property
    def zero_deg(self) -> float | None:
        """Its reading where the launch elevation is 0; None: it counts from 0, and homing tells."""
        return 0.0

    @property
    def direction(self) -> int:
        """+1 if its reading grows with the elevation, else -1."""
        return 1


def driver_of(axis: Axis | HoodEncoder) -> str:
    """The `driver` of the table."""
    return str(axis.__struct_config__.tag)
