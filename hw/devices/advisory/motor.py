"""Another controller's motor: truearc reads its frames and never commands it."""

from collections.abc import Iterable

from truearc.hw.devices.heard_motor import HeardMotor, Parse
from truearc.hw.motor import Order
from truearc.hw.protocols import Frame


class AdvisoryMotor(HeardMotor):
    """A Motor that sends no frame, whatever torque it is given.

    `parse` is that of the family of the device that is listened to, `frame_ids` what it understands.
    """

    def __init__(self, frame_ids: Iterable[int], is_extended: bool, parse: Parse) -> None:
        super().__init__("its controller", frame_ids, is_extended, parse)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        return Order()

    def release(self) -> tuple[Frame, ...]:
        return ()
