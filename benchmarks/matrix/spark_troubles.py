"""What goes wrong inside an emulated SPARK and how it is put right, and what strangers say to SPARKs."""

from collections.abc import Callable

from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.frames import CONTROLLER_HEARTBEAT
from truearc.hw.protocols import Frame

FAULTS = {"sensor": 0x04, "too hot": 0x10, "gate driver": 0x20}
TWIN = spark.SparkAxis(11, 1)             # of flywheel motor 1
FIRMWARE = {"old firmware": (24, 0, 1), "new firmware": (27, 0, 0)}


def begin_trouble(node: SparkNode, what: str, t_ns: int) -> None:
    """One of FAULTS or FIRMWARE, or "came and went", "settings lost", "locked", "switch closed", "switch open"."""
    if what in FAULTS:
        node.fail(FAULTS[what])
    elif what in FIRMWARE:
        node.settings = SparkSettings(node.settings.kt_nm_a, node.settings.resistance_ohm, FIRMWARE[what])
        node.restart(t_ns)
    elif what == "came and went":
        node.fail(FAULTS["gate driver"])
        node.fail(0)
    elif what == "settings lost":
        node.restart(t_ns)
    elif what == "locked":
        node.receive(Frame(0, CONTROLLER_HEARTBEAT, bytes(8), is_extended=True), t_ns)
    elif what in ("switch closed", "switch open"):
        _stick(node, what == "switch closed")


def end_trouble(node: SparkNode, what: str, t_ns: int) -> None:
    """A lock wants its power cycled, other firmware is exchanged; what was lost in a reset is the robot's to set."""
    if what in FAULTS:
        node.fail(0)
    elif what in FIRMWARE:
        node.settings = SparkSettings(node.settings.kt_nm_a, node.settings.resistance_ohm)
        node.restart(t_ns)
    elif what == "locked":
        node.restart(t_ns)
    elif what in ("switch closed", "switch open"):
        _let_go(node)


def stray_frames(what: str) -> list[Frame]:
    """What others send on a bus with SPARKs every 20 ms, of which each sends a STATUS_0 every 10."""
    match what:
        case "two sparks with one id":
            return [Frame(0, spark.frame_id(TWIN, message), bytes(8), is_extended=True)
                    for message in ("STATUS_0", "STATUS_0", "STATUS_2")]
        case "another host's heartbeat":
            return [spark.make_heartbeat(())]
        case "competition controller":
            return [Frame(0, CONTROLLER_HEARTBEAT, bytes(8), is_extended=True)]
    return []


def _stick(node: SparkNode, closed: bool) -> None:
    assert node.endstop is not None
    node.endstop = Stuck(node.endstop, closed)


def _let_go(node: SparkNode) -> None:
    assert isinstance(node.endstop, Stuck)
    node.endstop = node.endstop.switch


class Stuck:
    """A limit switch that says the same for ever."""

    def __init__(self, switch: Callable[[], bool], closed: bool) -> None:
        self.switch, self._closed = switch, closed

    def __call__(self) -> bool:
        return self._closed
