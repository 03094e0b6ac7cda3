"""Questions that every family of motor controllers must have an answer to, built in or of another distribution."""

import math
from typing import Any

import msgspec
import pytest

from tests.hw.dbc_facts import limits, messages
from tests.hw.spinning_plant import SpinningPlant
from truearc.hw import fault_codes
from truearc.hw.bus_rules import AllowList, kind_of
from truearc.hw.codec import Codec, read_codec
from truearc.hw.devices import family as devices
from truearc.hw.protocols import BadFrame, Frame, MotorReading
from truearc.hw.reason import render
from truearc.robot.config.schema import read_axis

MS = 1_000_000
START_NS = 1000 * MS
TICK_MS, EACH_TICK = 5, 31            # a tick at 200 Hz, and what truearc.robot.motors makes of that
CHECK = devices.AxisCheck("hood motor", 200, None)
Family = devices.MotorFamily[Any]


class Loop:
    """A driver and its emulated device on one wire, in steps of a millisecond."""

    def __init__(self, family: Family) -> None:
        self.plant = SpinningPlant()
        self.motor, = family.make_motors([family.example], [devices.Bounds()])
        attached = devices.AttachedMotor("hood", self.plant, 0.02, 0.1, 100, self.plant.hood_at_limit)
        self.node = family.make_node(family.example, attached)
        self.rules = family.make_rules(family.example, EACH_TICK)
        self.allow_list = AllowList(self.rules.allowed)
        self.sent: list[Frame] = []
        self.heard: list[Frame] = []
        self.t_ns = START_NS

    def run(self, ms: int, torque_nm: float | None, silent: bool = False) -> None:
        for _ in range(ms):
            self.t_ns += MS
            self.plant.advance(self.t_ns, {"hood": self.node.torque_nm()})
            if self.node.due_ns() <= self.t_ns:
                self._hear(self.node.step(self.t_ns))
            if self.t_ns // MS % TICK_MS == 0 and not silent:
                self.motor.faults(self.t_ns)
                for frame in self.motor.order(torque_nm, self.t_ns).frames:
                    self.send(frame)

    def send(self, frame: Frame) -> None:
        assert self.allow_list.refuse(frame, self.t_ns) is None, frame
        self.sent.append(frame)
        if (frame.arbitration_id, frame.is_extended) in self.node.ids():
            self._hear(self.node.receive(frame, self.t_ns))

    def _hear(self, frames: list[Frame]) -> None:
        stamped = [frame._replace(t_ns=self.t_ns) for frame in frames]
        self.heard += stamped
        for frame in stamped:
            if (frame.arbitration_id, frame.is_extended) in self.motor.ids():
                self.motor.take(frame)


def check_table(family: Family) -> None:
    """Its table in launcher.toml: the driver is the tag, the example is read as it is written, and typos are none."""
    table = msgspec.to_builtins(family.example)
    config = family.axis.__struct_config__
    assert family.driver == devices.driver_of(family.example) == table["driver"]
    assert (config.tag_field, config.frozen, config.forbid_unknown_fields) == ("driver", True, True)
    assert read_axis(devices.Axis, table) == family.example and isinstance(family.example, family.axis)
    for wrong in ({**table, "typo": 1}, *({key: table[key] for key in table if key != gone} for gone in table)):
        with pytest.raises((ValueError, msgspec.ValidationError)):
            read_axis(devices.Axis, wrong)


def check_frames(codec: Codec) -> None:
    """Each message comes back as it went out; one too short, or with a value beyond its range, is refused."""
    assert codec.sent_by("Host") and set(codec.sent_by("Host")) < set(messages(codec))
    for message in messages(codec):
        bounds = limits(codec, message)
        values = {name: 0.0 if low <= 0.0 <= high else low for name, (low, high) in bounds.items()}
        data = codec.make(message, values)
        assert codec.parse(message, data) == pytest.approx(values)
        with pytest.raises(BadFrame):
            codec.parse(message, data + b"\0")
        for name, (_, high) in bounds.items():
            for wrong in (math.nan, 2.0 * high + 1.0):
                with pytest.raises(BadFrame):
                    codec.make(message, {**values, name: wrong})


def check_bad_frames(family: Family) -> None:
    """The driver refuses a frame that is too short or another's; the device ignores one of a wrong length."""
    loop = Loop(family)
    loop.run(300, 0.01)
    for frame_id, is_extended in loop.motor.ids():
        before = loop.motor.reading
        with pytest.raises(BadFrame):
            loop.motor.take(Frame(loop.t_ns, frame_id, b"\xff", is_extended))
        assert loop.motor.reading == before
    with pytest.raises(BadFrame):
        loop.motor.take(Frame(loop.t_ns, 0x7EF, bytes(8)))
    torque_nm = loop.node.torque_nm()
    for frame_id, is_extended, _ in set(loop.rules.by_host) & {(*key, False) for key in loop.node.ids()}:
        loop.node.receive(Frame(0, frame_id, b"\xff\xff\xff", is_extended), loop.t_ns)
    assert loop.node.torque_nm() == torque_nm


def check_driving(family: Family) -> None:
    """It drives as asked, reports that it does, lets go when released, and by itself when the robot falls silent."""
    loop = Loop(family)
    loop.run(1500, 0.02)
    commanded = family.is_commanded
    assert loop.motor.reading.heartbeat_t_ns > START_NS and not loop.motor.faults(loop.t_ns)
    assert (loop.node.torque_nm() > 0.0) == commanded and bool(loop.sent) == commanded
    assert family.is_driven(family.example, loop.motor.reading)
    loop.run(300, None)
    assert loop.node.torque_nm() == 0.0
    assert not commanded or not family.is_driven(family.example, loop.motor.reading)
    loop.run(1000, 0.02)
    assert (loop.node.torque_nm() > 0.0) == commanded
    loop.run(200, 0.02, silent=True)
    assert loop.node.torque_nm() == 0.0


def check_bus_rules(family: Family) -> None:
    """All that is ever sent is allowed, all that is allowed is a host's by its DBC, and its pulse comes as declared."""
    loop = Loop(family)
    for torque_nm in (None, 0.02, None, -0.02):
        loop.run(1000, torque_nm)         # Loop.send asserts that each frame is allowed
    for frame in (*loop.motor.release(), *family.questions(family.example, None)):
        loop.run(200, None)
        loop.send(frame)
    rules, sent = loop.rules, {kind_of(frame) for frame in loop.sent}
    allowed = {(one.arbitration_id, one.is_extended, one.is_remote) for one in rules.allowed}
    assert sent <= allowed and bool(allowed) == family.is_commanded
    assert {kind for kind in allowed if not kind[2]} <= set(rules.by_host)
    assert {kind_of(frame) for frame in loop.heard} <= set(rules.by_device)
    assert not set(rules.by_host) & set(rules.by_device)
    for kind in {*rules.by_host, *rules.by_device} - allowed:
        assert loop.allow_list.refuse(Frame(0, kind[0], bytes(8), kind[1], kind[2]), loop.t_ns) is not None
    (pulse, period_ns), = rules.pulse.items()
    seconds = (loop.t_ns - START_NS) * 1e-9
    assert sum(kind_of(frame) == pulse for frame in loop.heard) == pytest.approx(seconds * 1e9 / period_ns, rel=0.1)


def check_errors(family: Family) -> None:
    """Bits of its errors have codes, truearc's or its own, and these have text; a healthy device has none."""
    errors = [family.errors(family.example, MotorReading(axis_error=1 << bit)) for bit in range(32)]
    codes = fault_codes.BY_NAME | {message.code.name: message.code for message in family.messages}
    assert any(errors) and all(render(error, codes) not in ("", error.code) for some in errors for error in some)
    assert family.errors(family.example, MotorReading()) == ()


def check_doctor(family: Family) -> None:
    """A device that speaks has no failure, one that is silent has one; what is not well comes with what to do."""
    loop = Loop(family)
    for frame in family.questions(family.example, None):
        loop.send(frame)
    assert bool(loop.heard) == family.is_commanded             # they are answered at once
    loop.run(1000, None, silent=True)                          # the doctor listens alone
    well = list(family.examine(family.example, CHECK, devices.Heard(tuple(loop.heard), 1.0)))
    silent = list(family.examine(family.example, CHECK, devices.Heard((), 1.0)))
    assert well and not [finding for finding in well if finding.level == devices.FAILURE]
    assert [finding for finding in silent if finding.level == devices.FAILURE]
    for finding in (*well, *silent):
        assert finding.check.startswith(CHECK.name) and finding.says
        assert finding.level in (devices.OK, devices.WARNING, devices.FAILURE)
        assert bool(finding.do) == (finding.level != devices.OK)


def check_restart(family: Family) -> None:
    """A device whose power comes back drives nothing."""
    loop = Loop(family)
    loop.run(1500, 0.02)
    loop.node.restart(loop.t_ns)
    assert loop.node.torque_nm() == 0.0


CHECKS = (check_table, check_bad_frames, check_driving, check_bus_rules, check_errors, check_doctor, check_restart)


def codec_of(family: Family) -> Codec:
    assert family.dbc is not None
    return read_codec(family.dbc)
