"""Interface of one motor on the bus, for drivers of every family."""

from typing import NamedTuple, Protocol

from truearc.hw.protocols import Frame
from truearc.hw.readings import MotorReading
from truearc.hw.reason import Reason


class Order(NamedTuple):
    """One tick's frames for a motor, and what is in force once they have arrived."""

    frames: tuple[Frame, ...] = ()
    torque_nm: float = 0.0                        # 0 while the motor is not driven
    duty: float | None = None                     # what stands for the torque on the wire of a driver that takes a duty


class Motor(Protocol):
    """One motor axis. No IO: it is given the frames that came and gives those to send; it reads no clock.

    Torques are at the motor shaft; positive launches a ball or raises the hood. It drives only while all readings that
    it needs are fresh and good.
    """

    reading: MotorReading

    def ids(self) -> tuple[tuple[int, bool], ...]:
        """(arbitration id, is extended) of every frame that `take` understands."""

    def take(self, frame: Frame) -> None:
        """Bring `reading` up to date by one frame that is not remote; BadFrame leaves it as it was."""

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        """Faults that `reading` does not hold and that stand in the way of driving; they name the device."""

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        """Once a tick: drive with this torque; None: leave the motor released."""

    def release(self) -> tuple[Frame, ...]:
        """What leaves the motor idle, now and for good."""
