"""The registry of all motor controller families, and the devices without frames of their own.

These devices are motors driven by another controller (driver "advisory"; they are read but never commanded), a motor
controller's encoder that serves as the hood encoder, and a hood encoder that is absent.

A family is loaded before the first tick, when a configuration first names its driver. A distribution registers its
MotorFamily under the driver's name:

    [project.entry-points."truearc.motors"]
    samplemotor = "truearc_samplemotor:SAMPLEMOTOR"
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from msgspec import Struct
from msgspec.structs import replace

from truearc.errors import PluginError, load_plugin, only_point, place_of
from truearc.hw import fault_codes as codes
from truearc.hw.bus_rules import Rules
from truearc.hw.devices import family
from truearc.hw.devices.drivers import HeardMotor
from truearc.hw.devices.family import Axis, Finding, Heard, failure, ok
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import ODRIVE, OdriveConfig
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.family import SPARK
from truearc.hw.emulated.nodes import MotorTruth, Node, Plant
from truearc.hw.protocols import AngleReading, Frame, Motor, MotorReading
from truearc.hw.reason import Message, Reason

# --- motors of another controller

class AdvisoryConfig(Struct, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="advisory"):
    """A motor of another controller: its frames are received, and nothing is ever sent to it."""

    listens_to: Literal["odrive", "spark"]    # whose frames they are
    device: family.CanNode
    direction: family.Direction
    has_endstop: bool                 # its frames tell of a limit switch at the negative end; only a SPARK's do


def make_rules(axis: AdvisoryConfig, each_tick: int) -> Rules:
    kind, theirs = _theirs(axis)
    return replace(kind.make_rules(theirs, each_tick), allowed=())


def errors(axis: AdvisoryConfig, motor: MotorReading) -> tuple[Reason, ...]:
    if axis.listens_to == "odrive":
        return odrive.errors_of(motor.axis_error)
    return spark.errors_of(motor.axis_error & spark.FAULTS)     # it obeys another, and was switched on: no errors


def is_driven(axis: AdvisoryConfig, motor: MotorReading) -> bool:
    """Return whether the device is driven; a SPARK of another controller does not report it, and counts as driven."""
    return axis.listens_to == "spark" or motor.axis_state == odrive.CLOSED_LOOP


def examine(axis: AdvisoryConfig, check: family.AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Check whether the device sends anything."""
    status = f"{check.name}, status"
    if any(heard.of(*key) for key in _make_motor(axis).ids()):
        yield ok(status, "is heard; it belongs to another controller")
    else:
        yield failure(status, "is silent", "look at whether its controller is on, and on this bus")


def make_node(axis: AdvisoryConfig, motor: family.AttachedMotor) -> Node:
    kind, theirs = _theirs(axis)
    return kind.make_node(theirs, motor)


def _theirs(axis: AdvisoryConfig) -> tuple[family.MotorFamily[Any], Any]:
    """The family of the device, and the device as one of that family."""
    if axis.listens_to == "odrive":
        return ODRIVE, odrive.OdriveAxis(axis.device, axis.direction)
    return SPARK, spark.SparkAxis(axis.device, axis.direction, axis.has_endstop)


def _make_motor(axis: AdvisoryConfig) -> HeardMotor:
    kind, theirs = _theirs(axis)
    frames = odrive if kind is ODRIVE else spark
    return HeardMotor("its controller", frames.frame_ids(theirs), kind is SPARK, partial(frames.parse, theirs))


ADVISORY = family.MotorFamily(
    driver="advisory", axis=AdvisoryConfig, example=AdvisoryConfig("spark", 11, 1, False), dbc=None,
    is_commanded=False, make_motors=lambda axes, bounds: tuple(map(_make_motor, axes)), make_rules=make_rules,
    errors=errors, is_driven=is_driven, questions=lambda axis, endpoints: (), examine=examine,
    make_node=make_node)


# --- all families

GROUP = "truearc.motors"
FAMILIES: tuple[family.MotorFamily[Any], ...] = (ODRIVE, SPARK, ADVISORY)
BY_DRIVER = MappingProxyType({one.driver: one for one in FAMILIES})
_BY_TABLE: dict[type[Axis], family.MotorFamily[Any]] = {}


def family_of(axis: Axis) -> family.MotorFamily[Any]:
    """Return the family of this table; raises as find_family does."""
    found = _BY_TABLE.get(axis.__class__)         # called in the tick
    if found is None:
        found = _BY_TABLE[axis.__class__] = find_family(family.driver_of(axis))
    return found


def find_family(driver: str) -> family.MotorFamily[Any]:
    """Return the family with this name.

    Raises:
        LookupError: there is none.
        PluginError: its distribution is broken, or is not the only one of that name.
    """
    return BY_DRIVER[driver] if driver in BY_DRIVER else _load(driver)


def drivers() -> tuple[str, ...]:
    """Return the names of all families, without loading those of distributions."""
    return tuple(dict.fromkeys((*BY_DRIVER, *sorted(point.name for point in entry_points(group=GROUP)))))


@cache
def find_messages(code: str) -> tuple[Message, ...]:
    """Return messages for a code "DRIVER.WHAT" of a distribution's family; () for any other, or if it cannot be
    loaded."""
    driver, dot, _ = code.partition(".")
    try:
        return tuple(message for message in _load(driver).messages if message.code.name == code) if dot else ()
    except (LookupError, PluginError):
        return ()


@cache
def _load(driver: str) -> family.MotorFamily[Any]:
    point = only_point(tuple(entry_points(group=GROUP, name=driver)), driver)
    found = load_plugin(point)
    if not (isinstance(found, family.MotorFamily) and issubclass(found.axis, Axis)
            and found.driver == family.driver_of(found.example) == driver):
        raise PluginError(f"{place_of(point)}: is not a MotorFamily whose driver and tag are {driver!r}")
    for message in found.messages:
        if not message.code.name.startswith(f"{driver}."):
            raise PluginError(f"{place_of(point)}: reason {message.code.name!r} must be named '{driver}.WHAT'")
    return found


# --- hood encoders without a device of their own

TICK_HZ = 200                         # the doctor's measure of a lagging speed, which is not used here
SIGMA_DEG = 0.2                       # an encoder that homing zeroes is as exact as the switch
# It is not driven. A SPARK's reset stays until it is driven; a count that it has lost differs from the screw's
DRIVING = (codes.ERROR_HAS_RESET.name, codes.ERROR_LOCKED.name)


class MotorEncoderConfig(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                         tag_field="driver", tag="motor"):
    """A controller whose encoder turns with the hood; its own direction makes a rising hood positive."""

    controller: family.Axis
    gear: family.Positive                    # turns of the encoder per turn of the hood
    zero_deg: family.Finite | None = None     # reading at a launch elevation of 0; absent: it counts, the switch tells


class MotorEncoder(family.Encoder):
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
        return tuple(fault.about(motor=family.CHECK) for fault in self._motor.faults(t_ns))

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        return self._motor.order(None, t_ns).frames


def errors_of(table: MotorEncoderConfig, axis_error: int) -> tuple[Reason, ...]:
    """Return the controller's errors that make its position untrustworthy; those of DRIVING do not."""
    errors: Sequence[Reason] = family_of(table.controller).errors(table.controller, MotorReading(axis_error=axis_error))
    return tuple(error for error in errors if error.code not in DRIVING)


def examine_encoder(table: MotorEncoderConfig, around: family.Around, heard: family.Heard) -> Iterator[Finding]:
    """Return its controller's findings."""
    yield from family_of(table.controller).examine(
        table.controller, family.AxisCheck(family.CHECK, TICK_HZ, None), heard)


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


def make_encoder_node(table: MotorEncoderConfig, plant: Plant, nodes: Mapping[str, Node]) -> Node:
    attached = family.AttachedMotor(_Pivot.motors[0], _Pivot(plant, table), 1.0, 1.0, 0, None,
                                    table.zero_deg is not None)
    node: Node = family_of(table.controller).make_node(table.controller, attached)
    node.motor = None                 # none is attached: the world has no such motor
    return node


MOTOR = family.EncoderFamily(
    driver="motor", table=MotorEncoderConfig, example=MotorEncoderConfig(OdriveConfig(6, 1, 0), 1.0),
    least_sigma_deg=SIGMA_DEG, make=lambda table, around: MotorEncoder(table),
    make_rules=lambda table, each_tick: (family_of(table.controller).make_rules(table.controller, each_tick),),
    questions=lambda table: family_of(table.controller).questions(table.controller, None),
    errors=errors_of, examine=examine_encoder, make_node=make_encoder_node)


# Play of the nut, where the switch closes, and a jump of the count that is too small to show: nothing corrects them
COUNT_SIGMA_DEG = 0.5


class NoEncoder(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="none"):
    """No encoder, so nothing checks the count."""

    is_heard: ClassVar[bool] = False


NONE = family.EncoderFamily(
    driver="none", table=NoEncoder, example=NoEncoder(), least_sigma_deg=COUNT_SIGMA_DEG,
    make=lambda table, around: family.Encoder(), make_rules=lambda table, each_tick: (), questions=lambda table: (),
    examine=lambda table, around, heard: (
        ok(family.CHECK, "there is none: the screw's count since homing is not checked"),),
    make_node=lambda table, plant, nodes: None)
