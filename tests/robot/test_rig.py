"""HardwareRig on hand-made wires: what it reads, what it sends, what it says of wires that fail."""


import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG
from tests.waiting import SetClock
from truearc.hw import fault_codes as hw
from truearc.hw.devices import button_box as buttons
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.protocols import Frame, LinkLost
from truearc.robot import reasons as because
from truearc.robot.eyes import InlineEyes
from truearc.robot.reasons import IMAGE_DARK
from truearc.robot.rig import HardwareRig
from truearc.robot.types import Command, Sighting

UNPLUGGED = hw.CAN_ADAPTER_ERROR(bus="wire", detail="unplugged")
DARK, BURNT = because.IMAGE_DARK(), because.IMAGE_BURNT()
ASKED = Command(True, True, True, 0.1, -0.02, 0.2)


class Wire:
    """A bus, a stream and a camera over lists."""

    def __init__(self):
        self.frames, self.data, self.image, self.sent, self.lost = [], b"", None, [], False

    def read(self):
        if self.lost:
            raise LinkLost(UNPLUGGED)
        frames, self.frames = self.frames, []
        return frames

    def write(self, frame):
        if self.lost:
            raise LinkLost(UNPLUGGED)
        self.sent.append(frame)
        self.frames += answers_to(frame)
        return True

    def faults(self):
        return []

    def close(self): ...


def answers_to(frame):
    """What an ODrive or a Canandmag answers at once when it is asked how late it comes."""
    if frame.is_remote and not frame.is_extended:
        return [Frame(0, frame.arbitration_id, bytes(8))]
    if frame.arbitration_id & ~0x3F == 0x070E0080:
        return [Frame(0, frame.arbitration_id + 0x80, frame.data[1:2].ljust(8, b"\0"), True)]
    return []


class Stream(Wire):
    def read(self):
        if self.lost:
            raise LinkLost(UNPLUGGED)
        data, self.data = self.data, b""
        return data


class Time(SetClock):
    def __init__(self):
        super().__init__(1_000_000_000)


class Blind:
    def read(self): ...
    def close(self): ...


def rig_on(bus, clock, config=CONFIG, box=None, is_over=lambda: False):
    """The robot's end of these wires; it sees nothing."""
    eyes = InlineEyes(Blind(), lambda frame: Sighting(frame.t_ns, False, IMAGE_DARK()))
    return HardwareRig(config, bus, box or Stream(), eyes, clock, is_over)


@pytest.fixture
def bench():
    bus, box, clock = Wire(), Stream(), Time()
    rig = rig_on(bus, clock, box=box)
    rig.read()
    rig.write(Command())              # every device is asked how late it comes, and answers
    rig.read()
    bus.sent.clear()
    return bus, box, clock, rig


def commands(frames, command):
    return [frame for frame in frames if not frame.is_extended and frame.arbitration_id & 0x1F == command]


def test_ticks_skip_after_a_stall_and_a_silent_box_is_reported(bench):
    _, _, clock, rig = bench
    first = rig.read().t_ns
    clock.t_ns += 1_000_000_000
    late = rig.read().t_ns
    assert late >= first + 1_000_000_000
    assert rig.read().t_ns - late == 5_000_000
    _, _, clock, rig = bench
    clock.t_ns += 3_000_000_000
    assert because.BOX_SILENT() in rig.read().faults


@given(st.lists(st.integers(0, 40_000), max_size=30))
def test_ticks_keep_step_with_the_clock_however_long_they_take(took_us):
    clock = Time()
    rig = rig_on(Wire(), clock)
    first, before = rig.read().t_ns, 0
    for us in took_us:
        clock.t_ns += us * 1000
        step = (rig.read().t_ns - first) // 5_000_000
        assert step > before                              # one tick a period at the most
        before = step
    assert (rig.read().t_ns - first) % 5_000_000 == 0     # after the last stall: as if there had been none


def test_an_unchanged_torque_feeds_the_watchdogs_within_its_limits(bench):
    bus, _, _, rig = bench
    for _ in range(200):
        rig.read()
        rig.write(ASKED)
    for node in (1, 2, 3, 4):
        fed = [frame for frame in commands(bus.sent, 0x0E) if frame.arbitration_id >> 5 == node]
        assert 195 <= len(fed) <= 201                     # 1 s, each tick; the watchdog wants one each 100 ms
    _, _, _, rig = bench
    rig.read()
    sent = rig.write(Command(True, True, True, 99.0, -99.0, 99.0))
    assert (sent.flywheel_torque_nm, sent.hood_torque_nm) == (1.2, -0.3)
    assert sent.feeder_torque_nm == CONFIG.feeder.torque_nm


def test_the_encoder_is_set_up_as_soon_as_there_is_a_bus():
    bus, clock = Wire(), Time()
    rig = rig_on(bus, clock)
    bus.lost = True
    for _ in range(3):
        rig.read()
        rig.write(ASKED)
    bus.lost = False
    for _ in range(3):
        rig.read()
        rig.write(ASKED)
    assert [frame.arbitration_id for frame in bus.sent if frame.is_extended] == [0x070E00C5, 0x070E0085]


def test_no_reading_is_younger_than_its_tick(bench, monkeypatch):
    """On a real clock time passes while the bus is read, and a negative age would be a HOLD."""
    bus, _, clock, rig = bench

    def read():
        clock.t_ns += 40_000
        return [Frame(clock.t_ns, 0x29, bytes(8))]

    monkeypatch.setattr(bus, "read", read)
    inputs = rig.read()
    assert inputs.flywheels[0].t_ns > 0 and inputs.frames == 1
    assert inputs.t_ns >= inputs.flywheels[0].t_ns


def test_why_the_newest_image_shows_no_target_is_told_until_another_shows_one(bench):
    *_, rig = bench
    rig._eyes = Looks([Sighting(1, False, DARK), None, Sighting(2, True), Sighting(3, False, BURNT),
                       LinkLost(UNPLUGGED), None])
    told = [rig.read() for _ in range(6)]
    assert [inputs.unseen for inputs in told] == [DARK, DARK, None, BURNT, None, None]
    assert told[1].sighting is None and told[4].faults[-1] == because.CAMERA_LOST(cause=UNPLUGGED)


class Looks:
    """Eyes that tell of these, one after the other."""

    def __init__(self, news):
        self.news = news

    def read(self):
        one = self.news.pop(0)
        if isinstance(one, LinkLost):
            raise one
        return one


def test_a_press_that_is_told_twice_is_one_press_and_no_restart(bench):
    _, box, _, rig = bench
    box.data = buttons.make_heartbeat(4) + buttons.make_press(5, "arm")
    assert [event.seq for event in rig.read().buttons] == [5]
    box.data = buttons.make_press(5, "arm") + 2 * buttons.make_press(6, "fire") + 2 * buttons.make_heartbeat(6)
    inputs = rig.read()
    assert inputs.faults == (hw.BOX_PRESSES_REPEATED(presses=2),)
    assert [(event.seq, event.button) for event in inputs.buttons] == [(6, "fire")]
    box.data = buttons.make_press(7, "two")
    inputs = rig.read()
    assert inputs.faults == () and len(inputs.buttons) == 1


def test_another_button_under_the_same_number_is_a_press_of_a_box_that_has_restarted(bench):
    _, box, clock, rig = bench
    box.data = buttons.make_press(1, "arm")
    rig.read()
    box.data = buttons.make_press(1, "fire")
    inputs = rig.read()
    assert inputs.faults == (hw.BOX_RESTARTED(),) and [event.button for event in inputs.buttons] == ["fire"]
    clock.t_ns += 600_000_000                             # for longer than a box that has power is ever silent
    box.data = buttons.make_press(1, "fire")
    inputs = rig.read()
    assert hw.BOX_RESTARTED() in inputs.faults and [event.button for event in inputs.buttons] == ["fire"]


def test_ticks_that_stood_still_are_a_fault_until_all_that_waited_has_been_read(bench):
    _, _, clock, rig = bench
    assert because.TICKS_STALLED.name not in codes(rig.read().faults)
    clock.t_ns += 600_000_000
    stood = []
    for _ in range(120):
        inputs = rig.read()
        stood += [inputs.t_ns] if because.TICKS_STALLED.name in codes(inputs.faults) else []
    assert len(stood) == 100 and stood[-1] - stood[0] == 495_000_000


def test_a_tick_that_took_too_long_feeds_no_ball(bench):
    bus, _, clock, rig = bench
    rig.read()
    assert rig.write(ASKED).feeder_torque_nm == 0.2
    rig.read()
    clock.t_ns += 150_000_000                             # a model that thinks for so long
    bus.sent.clear()
    assert rig.write(ASKED).feeder_torque_nm == 0.0
    withheld = because.BALL_WITHHELD(late_s=0.15)
    assert withheld in rig.read().faults
    assert rig.write(ASKED).feeder_torque_nm == 0.0       # the same ball still
    assert withheld in rig.read().faults
    rig.write(Command(True, True, True, 0.1, -0.02, 0.0))
    assert withheld not in rig.read().faults
    assert all(odrive.make_torque(odrive.OdriveAxis(4, 1), 0.2).data != frame.data for frame in commands(bus.sent, 0x0E)
               if frame.arbitration_id >> 5 == 4)
    rig.read()
    assert rig.write(ASKED).feeder_torque_nm == 0.2


def test_frames_that_the_bus_does_not_take_are_a_fault_of_the_next_tick(bench):
    bus, _, _, rig = bench
    rig.read()
    bus.write = lambda frame: False
    refused = rig.write(ASKED).refused
    assert refused > 0 and because.FRAMES_NOT_SENT(frames=refused) in rig.read().faults
    bus.write = lambda frame: True
    rig.write(ASKED)
    assert because.FRAMES_NOT_SENT.name not in codes(rig.read().faults)
