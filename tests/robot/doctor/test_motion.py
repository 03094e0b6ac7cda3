"""The doctor's small motion on the emulated robot: well, and with what it is to find; judged on the plant, too."""

import argparse
import math
import multiprocessing
import os
import signal
import struct
import time
from multiprocessing.connection import Connection

import pytest
from msgspec.structs import replace

from tests.faulty_robot import nodes_with
from tests.hw.host_speed import excuse_stalls
from tests.robot.doctor.test_devices import Spoilt, swap
from tests.robot.good_tick import CONFIG
from tests.robot.sparks import ALL_SPARK, only_advice
from truearc.cli import doctor_checks
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.codec import load_codec
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.devices.canandmag import frame_id
from truearc.hw.devices.family import FAILURE, OK, WARNING, Finding, Heard, failure
from truearc.hw.devices.registry import NONE
from truearc.hw.emulated.nodes import Node, Twin
from truearc.hw.emulated.serial_link import PtyCable, SlcanAdapter
from truearc.hw.protocols import MotorReading
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import load_config
from truearc.robot.doctor_motion import COAST_S, CREEP, FLYWHEEL, SmallMotion, _runaway, check_motion, plan, rad_per_deg
from truearc.robot.eyes import NoEyes
from truearc.robot.rig import HardwareRig
from truearc.robot.runtime import run
from truearc.sim.world.drive import LOW_DEG, Hood
from truearc.sim.world.emulated_robot import WATCHDOG_MS, emulated_rig, keep_time, make_nodes
from truearc.sim.world.options import Options
from truearc.sim.world.world import World
from truearc_proof.world.faults import SILENT, Fault

MS, SECOND = 1_000_000, 1_000_000_000
WHEELS = ("flywheel_a", "flywheel_b")
ANGLE_ID = frame_id(CONFIG.hood_encoder.device, "POSITION_OUTPUT")
TOP_RAD_S = 0.05 * 594.0


class Watched:
    """The world's truth while something moves it."""

    def __init__(self, world: World) -> None:
        self._world, self.wheel_rad_s, self.start_deg = world, 0.0, world.hood.elevation_deg
        self.low_deg = self.high_deg = self.start_deg

    def step(self, t_ns: int) -> None:
        self.wheel_rad_s = max(self.wheel_rad_s, abs(self._world.belt.speed_rad_s))
        self.low_deg = min(self.low_deg, self._world.hood.elevation_deg)
        self.high_deg = max(self.high_deg, self._world.hood.elevation_deg)


def move(config=CONFIG, wrap=lambda name, node: node, nodes_of=make_nodes, hood_deg: float | None = 40.0,
         button_ns: int | None = None,
         start_deg: float | None = None) -> tuple[dict[str, Finding], Watched, SmallMotion]:
    """Findings, what the world saw, and the motion; one more button is pressed at `button_ns`."""
    world, frames = World(1), []
    world.hood = world.hood if start_deg is None else Hood(start_deg, Options())
    watched, box = Watched(world), open_button_box()
    nodes = {name: wrap(name, node) for name, node in nodes_of(config, world).items()}
    motion = SmallMotion(config, plan(config, hood_deg), True)

    def press(t_ns: int) -> None:
        watched.step(t_ns)
        if t_ns == button_ns:
            box.press("fire")

    with emulated_rig(config, world, nodes, box, NoEyes(), (press,), lambda frame, sent: sent or frames.append(frame),
                      lambda now_ns: motion.is_finished or now_ns > 60 * SECOND) as (rig, _):
        run(rig, config, None, motion, motion)
    last = motion.rows[-1]
    assert not last[2].enable_hood and last[2].flywheel_torque_nm == last[2].hood_torque_nm == 0.0
    assert all(sent.feeder_torque_nm == 0.0 for _, _, sent in motion.rows)
    over_ns = last[1].inputs.t_ns - COAST_S * SECOND
    assert all(not (sent.enable_hood or sent.enable_flywheel) for _, tick, sent in motion.rows
               if tick.inputs.t_ns > over_ns)
    findings = check_motion(config, motion, Heard(tuple(frames), 1.0))
    return {finding.check: finding for finding in findings}, watched, motion


def floats(change):
    """Its position and speed as `change` makes them."""
    def spoil(frame):
        if frame.is_extended or frame.arbitration_id & 0x1F != 0x09:
            return frame
        return frame._replace(data=struct.pack("<ff", *change(*struct.unpack("<ff", frame.data))))
    return spoil


def angles(change):
    """The hood encoder's turns as `change` makes them."""
    codec = load_codec("canandmag")

    def spoil(frame):
        if not frame.is_extended or frame.arbitration_id != ANGLE_ID:
            return frame
        values = codec.parse("POSITION_OUTPUT", frame.data)
        turns = change(values["absolute_rev"]) % 1.0
        return frame._replace(data=codec.make("POSITION_OUTPUT", {**values, "absolute_rev": turns}))
    return spoil


def switch(closed):
    """A limit switch that is told so for ever."""
    return lambda frame: frame._replace(data=frame.data[:4] + bytes([closed, 0, 0, 0])) if (
        frame.arbitration_id == 0x65) else frame


def is_reading(frame):
    """Of a position; what else comes late, answers tell at rest."""
    return frame.arbitration_id == ANGLE_ID if frame.is_extended else frame.arbitration_id & 0x1F == 0x09


def on(names, spoil=lambda frame: frame, late_ms=0, is_late=is_reading):
    return lambda name, node: Spoilt(node, spoil, late_ms * MS, is_late) if name in names else node


def frozen():
    first = {}
    return lambda frame: first.setdefault(frame.arbitration_id, frame) if frame.arbitration_id == ANGLE_ID else frame


def failures(findings):
    return {check for check, finding in findings.items() if finding.level == FAILURE}


def test_a_well_robot_moves_a_little_and_passes():
    findings, watched, motion = move()
    assert motion.over == "" and {finding.level for finding in findings.values()} == {OK}
    assert {"motion", "hood motor, limit switch", "hood encoder, motion", "flywheel motor 2, motion"} < set(findings)
    assert TOP_RAD_S <= watched.wheel_rad_s <= 1.1 * TOP_RAD_S
    assert watched.high_deg <= watched.start_deg + 5.0 and watched.low_deg < LOW_DEG + 0.1
    assert "within 0 ms" in findings["flywheel motor 1, motion"].says


@pytest.mark.parametrize(("config", "hood_deg"), [
    (ALL_SPARK, 40.0), (replace(CONFIG, hood_encoder=NONE.example), None), (CONFIG, 74.0)])
def test_other_devices_pass_too(config, hood_deg):
    findings, watched, motion = move(config, hood_deg=hood_deg)
    assert motion.over == "" and not failures(findings), findings
    assert watched.wheel_rad_s <= 1.1 * TOP_RAD_S


@pytest.mark.parametrize(("wrap", "check", "words", "most_rad_s"), [
    (on(WHEELS, floats(lambda turns, speed: (0.0, 0.0))), "motion", "flywheel does not turn", 5.0),
    (on(WHEELS[:1], floats(lambda turns, speed: (0.0, 0.0))), "flywheel motor 1, motion", "neither", 8.0),
    (on(WHEELS, swap), "flywheel motor 1, estimates", "big-endian", 5.0),
    (on(WHEELS[1:], swap), "flywheel motor 2, estimates", "big-endian", 5.0),
    (on(WHEELS, floats(lambda turns, speed: (turns, speed / 2.0))), "flywheel motor 2, motion", "add up", 60.0),
    (on(WHEELS, floats(lambda turns, speed: (turns, speed * 60.0))), "flywheel motor 1, motion", "add up", 5.0),
    (on(WHEELS[:1], floats(lambda turns, speed: (turns / 2.0, speed))), "flywheel motor 1, motion", "add up", 33.0),
    (on(WHEELS[:1], floats(lambda turns, speed: (turns / 2.0, speed / 2.0))), "flywheels, motion", "turn alike", 15.0),
    (on(WHEELS, floats(lambda turns, speed: (-turns, -speed))), "motion", "direction", 5.0),
    (on(WHEELS, late_ms=70), "flywheel motor 1, motion", "torque 65 ms late", 38.0),      # less 10 ms of an answer
    (on(WHEELS, late_ms=200), "flywheel motor 2, motion", "torque 195 ms late", 45.0),
], ids=["dead", "one dead", "swapped", "one swapped", "slow", "rpm", "turns", "scaled", "backwards", "late", "later"])
def test_what_is_wrong_with_wheels_is_found(wrap, check, words, most_rad_s):
    findings, watched, _ = move(wrap=wrap)
    assert check in failures(findings) and words in findings[check].says, findings
    assert watched.wheel_rad_s <= most_rad_s


@pytest.mark.parametrize(("wrap", "check", "words", "most_deg"), [
    (on(("hood",), floats(lambda turns, speed: (0.0, 0.0))), "motion", "hood does not turn", 1.0),
    (on(("hood",), swap), "hood motor, estimates", "big-endian", 1.0),
    (on(("hood",), floats(lambda turns, speed: (turns / 2.0, speed / 2.0))), "motion", "scaled", 5.0),
    (on(("hood_encoder",), frozen()), "motion", "stuck, scaled, late", 3.0),
    (on(("hood_encoder",), angles(lambda turns: 2 * 80.0 / 360.0 - turns)), "motion", "the wrong way round", 3.0),
    (on(("hood_encoder",), angles(lambda turns: 2.0 * turns)), "motion", "scaled", 3.0),
    (on(("hood",), switch(1)), "motion", "hood encoder reads 39.3 deg, its screw 15.0", 1.0),
], ids=["dead", "swapped", "scaled", "frozen", "reversed", "double", "switch closed"])
def test_what_is_wrong_with_a_hood_is_found_within_degrees(wrap, check, words, most_deg):
    findings, watched, _ = move(wrap=wrap)
    assert check in failures(findings) and words in findings[check].says, findings
    assert max(watched.high_deg - watched.start_deg, watched.start_deg - watched.low_deg) <= most_deg


def test_a_dead_limit_switch_is_found_and_the_stop_is_not_pushed():
    findings, watched, motion = move(wrap=on(("hood",), switch(0)))
    assert "15.0 deg and its limit switch stays open" in findings["motion"].says
    pushed_ns = [tick.inputs.t_ns for _, tick, sent in motion.rows
                 if sent.hood_torque_nm < 0.0 and tick.estimate.hood_deg <= LOW_DEG + 0.1]
    assert pushed_ns and (pushed_ns[-1] - pushed_ns[0]) * 1e-9 <= 0.5
    assert watched.low_deg >= LOW_DEG


def test_a_hood_encoder_that_comes_late_is_a_failure():
    findings, _, _ = move(wrap=on(("hood_encoder",), late_ms=150))
    assert failures(findings) == {"hood encoder, motion"} and " ms late" in findings["hood encoder, motion"].says


@pytest.mark.parametrize(("device", "at_s"), [("flywheel_b", 2.5), ("hood", 5.0), ("hood_encoder", 8.0),
                                              ("feeder", 3.0)])
def test_silence_in_the_middle_releases_at_once(device, at_s):
    fault = Fault(SILENT, int(at_s * SECOND), 1 << 62)
    findings, _, motion = move(nodes_of=nodes_with({device: (fault,)}))
    assert "motion" in failures(findings)
    driven_ns = max(tick.inputs.t_ns for _, tick, sent in motion.rows if sent.enable_hood)
    assert driven_ns * 1e-9 <= at_s + CONFIG.gate.reading_age_s + 0.01


def test_any_button_releases():
    findings, _, motion = move(button_ns=2 * SECOND)
    assert findings["motion"].level == FAILURE and "released by the operator (fire)" in findings["motion"].says
    assert max(tick.inputs.t_ns for _, tick, sent in motion.rows if sent.enable_hood) <= 2 * SECOND + 10 * MS


@pytest.mark.parametrize(("max_deg_s", "start_deg"), [(20.0, 60.0), (45.0, 30.0)])
def test_a_hood_found_high_has_time_to_creep_to_its_switch(max_deg_s, start_deg):
    config = replace(CONFIG, hood=replace(CONFIG.hood, max_deg_s=max_deg_s))
    findings, watched, motion = move(config, hood_deg=start_deg, start_deg=start_deg)
    assert motion.over == "" and not failures(findings) and watched.low_deg < LOW_DEG + 0.1


def test_a_hood_with_a_lower_limit_creeps_at_that():
    slow = replace(CONFIG, hood=replace(CONFIG.hood, max_deg_s=2.0))
    creeps = [phase.ends_rad_s for phase in plan(slow, 40.0) if phase.kind == CREEP]
    assert creeps and creeps == pytest.approx([2.0 * rad_per_deg(slow)] * len(creeps))


@pytest.mark.parametrize(("free_rad_s", "turns", "is_doubted"), [(594.0, 11.0, False), (594.0, 13.0, True),
                                                                 (2900.0, 40.0, False), (2900.0, 45.0, True)])
def test_wheels_may_turn_in_proportion_to_their_free_speed(free_rad_s, turns, is_doubted):
    rig = replace(CONFIG.rig, launcher=replace(CONFIG.rig.launcher, free_speed_rad_s=free_rad_s))
    spin = next(phase for phase in plan(replace(CONFIG, rig=rig), 40.0) if phase.joint == FLYWHEEL)
    said = _runaway("it", MotorReading(position_rad=turns * math.tau), MotorReading(), spin)
    assert (said is not None) == is_doubted


@pytest.mark.parametrize(("lost", "over"), [([600], False), (range(600, 620), True)])
def test_frames_unsent_once_are_no_doubt(lost, over, monkeypatch):
    send = HardwareRig._send
    monkeypatch.setattr(HardwareRig, "_send", lambda rig, frame: rig._cycle not in lost and send(rig, frame))
    findings, _, motion = move()
    assert any(sent.refused for _, _, sent in motion.rows) and (motion.over != "") == over
    assert ("could not be sent" in findings["motion"].says) == over


def test_what_is_not_ours_or_fails_at_rest_is_not_moved():
    with pytest.raises(InputError, match="another controller"):
        plan(only_advice("odrive"), None)
    findings = doctor_checks.move_robot(CONFIG, MonotonicClock(), [failure("bitrate", "none", "x")], True)
    assert [finding.level for finding in findings] == [WARNING] and "not tried" in findings[0].says


@pytest.mark.parametrize(("words", "says"), [
    (["--yes"], "--yes: applies with --move or --set only"), (["--move"], "no terminal"),
    (["--move", "--set", "--yes"], "--move: apart")])
def test_move_without_a_yes_is_refused_before_anything_is_opened(words, says, capsys):
    assert main(["doctor", "--config", str(SHIPPED), *words]) == 2
    assert says in capsys.readouterr().err


def serve(far: Connection) -> None:
    """The emulated robot behind a serial CAN adapter, in real time and a process of its own, until told to end.

    At the end it tells what it saw of the plant, and for how long this process stood still at most, in seconds.
    """
    world, box = World(1), open_button_box(prompt=False)
    adapter, watched = SlcanAdapter(PtyCable(prompt=False)), Watched(world)
    nodes: list[Node] = list(make_nodes(CONFIG, world, WATCHDOG_MS).values())
    far.send((adapter.port, box.port))
    twin, times = Twin(world, adapter, tuple(nodes), (box.step, watched.step)), [time.monotonic()]
    longest_s = 0.0

    def advance(t_ns: int) -> None:
        nonlocal longest_s
        twin.advance(t_ns)
        times.append(time.monotonic())
        longest_s = max(longest_s, times[-1] - times.pop(0))

    keep_time(MonotonicClock(), advance, far.poll)
    far.send((watched.wheel_rad_s, watched.low_deg, longest_s))
    box.unplug()


# Why a motion ends on a machine that others keep busy: the devices' process, or ours, has stood still. What it missed
# comes at once when it goes on, so that a position changes faster than its speed.
STALLED = ("no frames for", "no heartbeat for", "could not be sent", "ticks stalled")
FAR_STALL_S = 0.03


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_on_a_serial_bus_it_asks_moves_and_tells(tmp_path, monkeypatch, capsys):
    spawn = multiprocessing.get_context("spawn")
    near, far = spawn.Pipe()
    devices = spawn.Process(target=serve, args=(far,), daemon=True)
    devices.start()
    can, box = near.recv()
    text = SHIPPED.read_text(encoding="utf-8").replace('"socketcan"', '"slcan"').replace("/dev/buttonbox", box)
    text = text.replace('"can0"', f'"{can}"').replace("reading_age_s = 0.1", "reading_age_s = 0.15")
    (tmp_path / "launcher.toml").write_text(text, encoding="utf-8")
    config, clock = load_config(tmp_path / "launcher.toml"), MonotonicClock()
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda: "yes")
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with excuse_stalls():
        try:
            doctor_checks.check_move(argparse.Namespace(move=True, yes=False))
            found = [*doctor_checks._look_at_can(config, clock, None, 2.0)]
            findings = {one.check: one for one in doctor_checks.move_robot(config, clock, found, False)}
        finally:
            near.send("end")
            wheel_rad_s, low_deg, longest_s = near.recv()
            devices.join()
            for number, handler in handlers.items():
                signal.signal(number, handler)
        says = findings["motion"].says
        if failures(findings) and (longest_s > FAR_STALL_S or any(word in says for word in STALLED)):
            pytest.skip(f"host too slow: the devices stood still for {longest_s:.2f} s: {says}")
        said = capsys.readouterr().err
        assert "hood: 3 deg up" in said and "Type yes" in said, found
        assert not failures(findings) and findings["motion"].level == OK, (longest_s, findings)
    assert wheel_rad_s <= 1.2 * TOP_RAD_S and low_deg >= LOW_DEG
