"""The table of one motor axis in launcher.toml: what every device family's struct of it has in common."""

from typing import Annotated, Any, ClassVar, Literal

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0, lt=1e9)]
CanNode = Annotated[int, msgspec.Meta(ge=0, le=62)]     # 63 addresses every ODrive, and every device of the FRC
Direction = Literal[-1, 1]            # sign that makes positive launch a ball or raise the hood


class Axis:
    """Base of the structs that a family declares for its table, beside msgspec.Struct.

    Such a struct has no defaults, `forbid_unknown_fields=True`, `tag_field="driver"` and its family's name as `tag`.
    """

    __slots__ = ()
    __struct_config__: ClassVar[Any]


def driver_of(axis: Axis) -> str:
    """The `driver` of the table."""
    return str(axis.__struct_config__.tag)
