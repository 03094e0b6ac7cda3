"""Hood encoders without a device of their own: a motor controller's encoder, and none at all."""

import math
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from truearc.hw import fault_codes as codes
from truearc.hw.devices import family
from truearc.hw.devices.family import CHECK, Around, AttachedMotor, Encoder, EncoderFamily, Finding, HoodEncoder, ok
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.hw.devices.registry import family_of
from truearc.hw.emulated.nodes import MotorTruth, Node, Plant
from truearc.hw.protocols import AngleReading, Frame, Motor, MotorReading
from truearc.hw.reason import Reason

TICK_HZ = 200                         # the doctor's measure of a lagging speed, which is not used here
SIGMA_DEG = 0.2                       # an encoder that homing zeroes is as exact as the switch
# It is not driven. A SPARK's reset stays until it is driven; a count that it has lost differs from the screw's
DRIVING = (codes.ERROR_HAS_RESET.name, codes.ERROR_LOCKED.name)


class MotorEncoderConfig(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                         tag_field="driver", tag="motor"):
    """A controller whose encoder turns with the hood; its own direction makes a rising hood positive."""

    controller: family.Axis
    gear: family.Positive                    # turns of the encoder per turn of the hood
    zero_deg: family.Finite | None = None     # reading at a launch elevation of 0; absent: it counts, the switch tells


class MotorEncoder(Encoder):
    """A motor of which only the position is used."""

    def __init__(self, table: MotorEncoderConfig) -> None:
        motors: Sequence[Motor] = family_of(table.controller).make_motors([table.controller], [family.Bounds()])
        self._motor, self._table = motors[0], table

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._motor.ids()

    def take(self, frame: Frame) -> None:
        self._motor.take(frame)

    def read(self, t_ns: int) -> AngleReading | None:
        said = self._motor.reading
        if not said.t_ns:
            return None
        errors = errors_of(self._table, said.axis_error)
        return AngleReading(said.t_ns, said.position_rad / self._table.gear % math.tau, not errors, said.axis_error,
                            said.heartbeat_t_ns)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        return tuple(fault.about(motor=CHECK) for fault in self._motor.faults(t_ns))

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        return self._motor.order(None, t_ns).frames


def errors_of(table: MotorEncoderConfig, axis_error: int) -> tuple[Reason, ...]:
    """The controller's errors that are in the way of believing its position; those of DRIVING are not."""
    errors: Sequence[Reason] = family_of(table.controller).errors(table.controller, MotorReading(axis_error=axis_error))
    return tuple(error for error in errors if error.code not in DRIVING)


def examine(table: MotorEncoderConfig, around: Around, heard: family.Heard) -> Iterator[Finding]:
    """Its controller's findings."""
    yield from family_of(table.controller).examine(table.controller, family.AxisCheck(CHECK, TICK_HZ, None), heard)


class _Pivot:
    """A plant whose only motor is the encoder, which turns with the hood and is not driven. It tells no speed."""

    motors: tuple[str, ...] = ("hood_encoder",)

    def __init__(self, plant: Plant, table: MotorEncoderConfig) -> None:
        self._gear, self._zero_rad = table.gear, math.radians(table.zero_deg or 0.0)
        self.bus_v, self.hood_encoder_rad, self.view = plant.bus_v, plant.hood_encoder_rad, plant.view
        self.hood_at_limit = plant.hood_at_limit

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        """It is the world's that advances."""

    def motor(self, name: str) -> MotorTruth:
        return MotorTruth(self._gear * (self._zero_rad + self.hood_encoder_rad()), 0.0, 0.0, 0.0)


def make_node(table: MotorEncoderConfig, plant: Plant, nodes: Mapping[str, Node]) -> Node:
    attached = AttachedMotor(_Pivot.motors[0], _Pivot(plant, table), 1.0, 1.0, 0, None, table.zero_deg is not None)
    node: Node = family_of(table.controller).make_node(table.controller, attached)
    node.motor = None                 # none is attached: the world has no such motor
    return node


MOTOR = EncoderFamily(
    driver="motor", table=MotorEncoderConfig, example=MotorEncoderConfig(OdriveConfig(6, 1, 0), 1.0),
    least_sigma_deg=SIGMA_DEG, make=lambda table, around: MotorEncoder(table),
    make_rules=lambda table, each_tick: (family_of(table.controller).make_rules(table.controller, each_tick),),
    questions=lambda table: family_of(table.controller).questions(table.controller, None),
    errors=errors_of, examine=examine, make_node=make_node)


# Play of the nut, where the switch closes, and a jump of the count that is too small to show: nothing corrects them
COUNT_SIGMA_DEG = 0.5


class NoEncoder(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="none"):
    """There is none, so nothing checks the count."""

    @property
    def is_heard(self) -> bool:
        return False


NONE = EncoderFamily(
    driver="none", table=NoEncoder, example=NoEncoder(), least_sigma_deg=COUNT_SIGMA_DEG,
    make=lambda table, around: Encoder(), make_rules=lambda table, each_tick: (), questions=lambda table: (),
    examine=lambda table, around, heard: (ok(CHECK, "there is none: the screw's count since homing is not checked"),),
    make_node=lambda table, plant, nodes: None)
