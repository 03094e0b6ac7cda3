"""Everything that a kind of hood encoder declares about itself, one EncoderFamily value."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.devices.axis import HoodEncoder
from truearc.hw.devices.bus_rules import Rules
from truearc.hw.devices.family import Heard
from truearc.hw.devices.round_trip import RoundTrip
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.finding import Finding
from truearc.hw.protocols import AngleReading, Frame
from truearc.hw.reason import Reason

CHECK = "hood encoder"                # as the doctor and reasons name it


Table = TypeVar("Table", bound=HoodEncoder)


class Encoder:
    """A hood encoder at work, here one that is not there. It never waits: `take` is given the frames that came."""

    reading: AngleReading | None = None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        """(arbitration id, is extended) of every frame that `take` understands."""
        return ()

    def take(self, frame: Frame) -> None:
        """Bring `reading` up to date by one frame that is not remote; BadFrame leaves it as it was."""

    def read(self, t_ns: int) -> AngleReading | None:
        """Once a tick: the newest angle; None before the first."""
        return self.reading

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        """Faults that the reading does not hold and that stand in the way of firing; of its device, about a "motor"."""
        return ()

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        """Once a tick, while there is a bus: frames to send."""
        return ()


def aged(reading: AngleReading | None, by_ns: int) -> AngleReading | None:
    """A reading whose device has been found to be later by so much than it was known to be."""
    if reading is None or not by_ns:
        return reading
    faults_t_ns = reading.faults_t_ns and reading.faults_t_ns - by_ns       # 0 and absent stay so
    return replace(reading, t_ns=reading.t_ns - by_ns, faults_t_ns=faults_t_ns)


def trip_faults(trip: RoundTrip, t_ns: int) -> tuple[Reason, ...]:
    """Once a tick: why the encoder may not be believed, as far as how late it comes tells."""
    trip.tick(t_ns)
    fault = trip.fault()
    return () if fault is None else (fault.about(motor=CHECK),)


class Around(NamedTuple):
    """The part of the rest of the configuration that an encoder may need."""

    longest_age_s: float              # of an angle that may still fire
    readings: Mapping[str, Mapping[str, Any]]     # tables of other distributions, by name


class EncoderFamily(Struct, Generic[Table], frozen=True, kw_only=True, eq=False):
    """One kind of hood encoder.

    driver: its name, `driver` in launcher.toml.
    table: struct of [hood_encoder].
    example: such a table, for tests.
    least_sigma_deg: [rig.noise] hood_deg may not be smaller, which is how well a dataset says the angle is known.
    make: what reads it on the robot.
    make_rules: frames of it, and how often within WINDOW_NS one may be sent that each tick sends once.
    questions: what the doctor asks; no answer may need a change of the device.
    errors: why a reading with these `faults` (of AngleReading) is not to be believed, about a "motor".
    examine: the doctor's findings from what was heard.
    make_node: the emulated device, given those of the motors by name; None where one of them has it on board.
    make_off_bus: for one that is not on the bus, what reads it on the emulated robot. It is not replayed from frames.
    """

    driver: str
    table: type[Table]
    example: Table
    least_sigma_deg: float
    make: Callable[[Table, Around], Encoder]
    make_rules: Callable[[Table, int], Sequence[Rules]]
    questions: Callable[[Table], Sequence[Frame]]
    examine: Callable[[Table, Around, Heard], Iterable[Finding]]
    make_node: Callable[[Table, Plant, Mapping[str, Node]], Node | None]
    errors: Callable[[Table, int], Sequence[Reason]] = lambda table, faults: ()
    make_off_bus: Callable[[Table, Plant], Encoder] | None = None
