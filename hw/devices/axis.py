"""Tables of one motor axis and of the hood's encoder in launcher.toml: what every family's struct has in common.

Bounds that an axis keeps while all is well, and its controller's own limits, which stand behind the robot's.
"""

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import msgspec

Finite = Annotated[float, msgspec.Meta(gt=-1e9, lt=1e9)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, lt=1e9)]
CanNode = Annotated[int, msgspec.Meta(ge=0, le=62)]     # 63 addresses every ODrive, and every device of the FRC
TorquePerAmp = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]      # Nm/A: a motor of 10 kW has 1
Direction = Literal[-1, 1]            # sign that makes positive launch a ball or raise the hood

SPEED_SPARE = 1.15                    # times the top speed: an ODrive's torque fades as its speed nears the limit
CURRENT_SPARE = 1.1                   # times the current of the top torque, so that no rounding cuts it


class Axis:
    """Base of the structs that a family declares for its table, beside msgspec.Struct.

    Such a struct has `forbid_unknown_fields=True`, `tag_field="driver"` and its family's name as `tag`. No key has a
    default but one that earlier files lack, and then `omit_defaults=True`: their recordings keep their hash.
    """

    __slots__ = ()
    __struct_config__: ClassVar[Any]


class HoodEncoder:
    """Base of the structs that a family declares for [hood_encoder], beside msgspec.Struct; tagged as an Axis's are, or
    with a key `driver`."""

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
    return str(axis.__struct_config__.tag or getattr(axis, "driver"))  # noqa: B009


class Bounds(NamedTuple):
    """Of one axis, at the motor's shaft, from the rest of the configuration; None: nothing is known of it.

    top_rad_s, top_nm: speed and torque that it never passes while all is well.
    brakes: whether it is to brake when it is let go, rather than coast.
    """

    top_rad_s: float | None = None
    top_nm: float | None = None
    brakes: bool | None = None


def speed_limit_rad_s(bounds: Bounds) -> float | None:
    """The controller's own limit; None where the axis has none."""
    return None if bounds.top_rad_s is None else SPEED_SPARE * bounds.top_rad_s


def current_limit_a(bounds: Bounds, torque_nm_a: float) -> float | None:
    """The controller's own limit, of a motor that gives so much torque per A; None where that is 0, for unknown."""
    if bounds.top_nm is None or not torque_nm_a:
        return None
    asked_a = CURRENT_SPARE * bounds.top_nm / torque_nm_a
    return float(math.ceil(asked_a)) if math.isfinite(asked_a) else asked_a
