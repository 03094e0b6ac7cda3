"""Advice from keys: FIRE where all is well, and what it makes of values; tests/loops has keys in trouble."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tests.robot.aim_files import CONTENT, HOOD, LEAD, RATIO, write
from tests.waiting import SetClock, wait_until
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.advice import ADVICE, advise_step
from truearc.robot.aim_file import Segment, load_aim
from truearc.robot.config.schema import AimConfig, Config, load_config
from truearc.robot.config.shot_map import Detection, OutcomeKeys, ShotMap, Signal
from truearc.robot.gate import load_gate
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials, make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.runtime import run
from truearc.robot.types import Tick
from truearc_frc.advice import AdviceIo, Adviser, advised_columns
from truearc_frc.advise_session import keys_of
from truearc_frc.keys import NtKeys, Reading, names_of, parse_server

GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"
MAP = ShotMap("truearc.shot-map/1", columns={
    "distance_m": "/Vision/Distance", "hood_deg": Signal("/Hood/Angle", "deg"),
    "motor_rad_s": Signal("/Shooter/RPM", "rpm"), "battery_v": "/Battery"},
    shots=Detection(feed="/Feeding"), outcome=OutcomeKeys(key="/Result", values={"in": "three", "short": "miss-low"}))
WELL = {"/Vision/Distance": 2.2488, "/Hood/Angle": 51.737, "/Shooter/RPM": 0.44958 * 594.0 * 9.549297, "/Battery": 12.4}
HZ, NS = 50, 1_000_000_000
Clock = partial(SetClock, 5 * NS)


def config() -> Config:
    shipped = load_config(SHIPPED)
    return replace(shipped, tick_hz=HZ, gate=replace(shipped.gate, policy="model", reading_age_s=0.5,
                                                     sighting_age_s=0.5, threshold=0.3))


class Robot:
    """Keys of a robot whose sensors jitter in the last digits; `trouble` changes what it publishes from 4 s on."""

    def __init__(self, trouble: str = "", key: str = "") -> None:
        self.trouble, self.key, self.began_ns = trouble, key, 0
        self.connected = True
        self.said: list[Mapping[str, float | str | Sequence[str]]] = []
        self.marks: dict[str, Reading] = {"/Feeding": Reading(1, 0.0), "/Result": Reading(1, "")}

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        self.began_ns = self.began_ns or now_ns
        since_s = (now_ns - self.began_ns) / NS
        found = {key: Reading(now_ns - 3_000_000, value * (1.0 + 1e-5 * (now_ns // 1000 % 7)))
                 for key, value in WELL.items()} | self.marks
        if since_s >= 4.0 and self.trouble:
            if self.trouble == "disappears":
                del found[self.key]
            else:
                found[self.key] = found[self.key]._replace(value=float(self.trouble.removeprefix("says ")))
        return found

    def publish(self, values: Mapping[str, float | str | Sequence[str]]) -> None:
        self.said.append(dict(values))


class Nothing:
    def record(self, tick: Tick, sent: object) -> None: ...

    def keep_picture(self, picture: object) -> None: ...


def advise(robot: Robot, seconds: float, recorder: object = None, play: Iterator[None] | None = None,
           aim: Path | None = None) -> list[str]:
    """The verdicts of so many seconds; `play` goes on by one before each tick; aim: the file of set points."""
    clock, facts, gate = Clock(), config(), load_gate(GATE)
    facts = facts if aim is None else replace(facts, aim=AimConfig("belief", 0.0))
    aims = {} if aim is None else {"": load_aim(aim)}
    end_ns = clock.t_ns + round(seconds * NS)

    def over() -> bool:
        if play is not None:
            next(play, None)
        return clock.t_ns >= end_ns

    io = AdviceIo(facts, MAP, robot, clock, over, 0.02)
    run(io, facts, gate, Adviser(recorder or Nothing(), robot, facts, gate),             # type: ignore[arg-type]
        partial(advise_step, aims=aims))
    return [str(said["verdict"]) for said in robot.said]


def test_a_robot_that_is_well_is_told_to_fire_and_why() -> None:
    robot = Robot()
    verdicts = advise(robot, 4.0)
    assert verdicts[-1] == "FIRE" and verdicts.count("FIRE") > 0.9 * len(verdicts) and verdicts[0] == "HOLD"
    last = robot.said[-1]
    rated = load_gate(GATE).rate(2.2488, 0.44958, 51.737)
    assert last["p_three"] == pytest.approx(rated.p_three, abs=0.02) and last["novelty"] == pytest.approx(
        rated.novelty, abs=0.02)
    assert last["reasons"] == () and 0.0 < float(last["age_s"]) < 0.1          # type: ignore[arg-type]
    assert set(last) == {"p_two", "p_three", "verdict", "reasons", "novelty", "hood_deg", "wheel_rad_s", "correction",
                         "lead_deg", "age_s"}


@pytest.mark.parametrize(("key", "value"), [
    ("/Hood/Angle", 51.737 + 360.0), ("/Hood/Angle", 51.737 - 360.0), ("/Battery", 0.0), ("/Battery", 12400.0),
    ("/Vision/Distance", -2.2488), ("/Vision/Distance", 224.88), ("/Shooter/RPM", -WELL["/Shooter/RPM"]),
    ("/Shooter/RPM", 1.2 * 594.0 * 9.549297)])
def test_a_value_that_cannot_be_is_named_from_the_start_too(key: str, value: float) -> None:
    robot = Robot(f"says {value}", key)
    verdicts = advise(robot, 6.0)
    assert "FIRE" in verdicts[:4 * HZ] and "FIRE" not in verdicts[4 * HZ + 1:]
    assert verdicts[4 * HZ + 1] == "HOLD" and f"{key}: not a possible value" in robot.said[-1]["reasons"]  # type: ignore[operator]
    always = Robot()
    always.marks[key] = Reading(0, value)         # instead of the good one
    always.read = lambda now_ns: {name: one._replace(t_ns=now_ns) for name, one in      # type: ignore[method-assign]
                                  Robot.read(always, now_ns).items()}
    assert "FIRE" not in advise(always, 2.0)


def test_a_jump_over_a_value_that_is_missing_or_cannot_be_is_still_one() -> None:
    class Gap(Robot):
        def read(self, now_ns: int) -> Mapping[str, Reading]:
            found = dict(super().read(now_ns))
            tick = round((now_ns - self.began_ns) / NS * HZ)
            if tick == 4 * HZ:
                del found["/Hood/Angle"]
            elif tick > 4 * HZ:
                found["/Hood/Angle"] = found["/Hood/Angle"]._replace(value=70.0)
            return found

    robot = Gap()
    verdicts = advise(robot, 4.3)
    assert verdicts[4 * HZ - 2] == "FIRE" and "FIRE" not in verdicts[4 * HZ:]
    assert any("hood angle jumped" in reason for reason in robot.said[-1]["reasons"])      # type: ignore[union-attr]


class Resting(Robot):
    """A robot whose hood stands still from the start; its program counts its loops until `died_s`."""

    def __init__(self, died_s: float = 1e6) -> None:
        super().__init__()
        self._died_s = died_s

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        found = dict(super().read(now_ns))
        beat_ns = min(now_ns, self.began_ns + int(self._died_s * NS))
        still = Reading(self.began_ns, WELL["/Hood/Angle"])
        return {**found, "/Hood/Angle": still, "/Loops": Reading(beat_ns, beat_ns)}


def test_a_key_may_stand_still_while_another_says_that_the_program_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert advise(Resting(), 3.0)[-1] == "STALE"
    alive = replace(MAP, columns={**MAP.columns, "hood_deg": Signal("/Hood/Angle", "deg", alive="/Loops")})
    monkeypatch.setattr("tests.frc.test_advice.MAP", alive)
    assert "/Loops" in keys_of(alive)
    runs, died, without = Resting(), Resting(2.0), Robot()
    assert [advise(robot, 3.0)[-1] for robot in (runs, died, without)] == ["FIRE", "STALE", "STALE"]
    assert "/Loops" in str(without.said[-1]["reasons"])  # no key of that name


def test_wheels_that_change_their_speed_are_not_settled() -> None:
    class SpinningUp(Robot):
        def read(self, now_ns: int) -> Mapping[str, Reading]:
            found = dict(super().read(now_ns))
            since_s = (now_ns - self.began_ns) / NS
            found["/Shooter/RPM"] = Reading(now_ns, WELL["/Shooter/RPM"] * (0.9 + 0.1 * min(since_s / 2.0, 1.0)))
            return found

    robot = SpinningUp()
    verdicts = advise(robot, 4.0)
    assert "FIRE" not in verdicts[:round(1.5 * HZ)] and verdicts[-1] == "FIRE"


def play(robot: Robot) -> Iterator[None]:
    """Three balls: in, short, and one without a mark."""
    for tick in range(10_000):
        for number, mark in enumerate(("in", "short", "")):
            began = round((1.0 + 2.0 * number) * HZ)
            t_ns = 5 * NS + tick * NS // HZ
            if tick == began:
                robot.marks["/Feeding"] = Reading(t_ns, 1.0)
            if tick == began + 10:
                robot.marks["/Feeding"] = Reading(t_ns, 0.0)
            if tick == began + 50 and mark:
                robot.marks["/Result"] = Reading(t_ns, mark)
        yield


def test_it_records_a_session_that_replays_to_the_bit_and_has_its_shots(tmp_path, capsys):
    robot, facts, gate = Robot(), config(), load_gate(GATE)
    folder = tmp_path / "advice"
    recorder = SessionWriter(folder, replace(make_header(facts, gate, None), policy=ADVICE), facts, GATE.read_bytes(),
                             lossless=True)
    advise(robot, 8.0, recorder, play(robot))
    recorder.close()
    assert [trial.outcome.outcome for trial in load_trials(folder)] == ["three", "miss-low"]
    shots = [trial.shot for trial in load_trials(folder) if trial.shot is not None]
    assert [shot.distance_m for shot in shots] == pytest.approx([2.2488] * 2, rel=1e-3)
    ticks = [tick for tick, _ in TickReader(folder)]
    assert len(ticks) == 8 * HZ and not any(tick.command.enable_flywheel for tick in ticks)
    assert main(["session", "replay", str(folder), "--check"]) == 0
    assert "400 ticks" in capsys.readouterr().out


def test_a_wheels_speed_is_that_of_the_motors_by_its_gear() -> None:
    facts = config()
    wheel = facts.rig.launcher.wheel[0]
    columns = {**MAP.columns, f"wheel_{wheel.name}_rad_s": "/Wheel"}
    del columns["motor_rad_s"]
    found = advised_columns(replace(MAP, columns=columns), facts)["motor_rad_s"]
    assert isinstance(found, Signal) and found.times == pytest.approx(1.0 / wheel.gear)
    for column in ("distance_m", "hood_deg", "battery_v"):
        with pytest.raises(InputError, match=f"the map has no columns.{column}"):
            advised_columns(replace(MAP, columns={name: key for name, key in MAP.columns.items() if name != column}),
                            facts)
    with pytest.raises(InputError, match="no motor_rad_s and no wheel"):
        advised_columns(replace(MAP, columns={"distance_m": "x"}), facts)


def test_a_logs_key_is_found_where_networktables_has_it() -> None:
    assert names_of("/RealOutputs/X")[:2] == ["/RealOutputs/X", "/AdvantageKit/RealOutputs/X"]
    assert names_of("NT:/SmartDashboard/Y") == ["/SmartDashboard/Y", "/AdvantageKit/SmartDashboard/Y"]
    assert names_of("/Array/2") == ["/Array/2", "/AdvantageKit/Array/2", "/Array", "/AdvantageKit/Array"]


@pytest.mark.parametrize(("server", "parts"), [
    ("254", (254, "", 0)), ("25599", (25599, "", 0)), ("localhost", (0, "localhost", 0)),
    ("10.2.54.2:5811", (0, "10.2.54.2", 5811)), ("robot:65535", (0, "robot", 65535))])
def test_a_robot_is_a_team_number_or_a_host_with_or_without_its_port(server: str, parts: tuple[int, str, int]) -> None:
    assert parse_server(server) == parts
    for neither in ("", "0", "25600", "\u0662\u0665", f"{server}:", f"{server}:abc", f"{server}:65536", ":5810"):
        with pytest.raises(InputError, match="is not a robot: give a team number"):
            parse_server(neither)


def test_set_points_are_those_of_the_aim_file_and_where_it_has_none_it_holds(tmp_path: Path) -> None:
    robot = Robot()
    assert advise(robot, 3.0, aim=write(tmp_path / "aim.json"))[-1] == "FIRE"
    assert 54.0 < float(robot.said[-1]["hood_deg"]) < 60.0                     # type: ignore[arg-type]
    far = Segment((3.0, 4.0), *(replace(curve, value=curve.value[1:3], slope=curve.slope[1:3])
                                for curve in (HOOD, RATIO, LEAD)))
    robot = Robot()
    assert "FIRE" not in advise(robot, 3.0, aim=write(tmp_path / "far.json", replace(CONTENT, segments=(far,))))
    last = robot.said[-1]
    assert last["reasons"] == ("the aim file has no set point for 2.25 m",) and last["verdict"] == "HOLD"
    assert math.isnan(last["hood_deg"]) and math.isnan(last["wheel_rad_s"])    # type: ignore[arg-type]


def test_without_an_aim_file_and_a_hood_there_are_no_set_points() -> None:
    robot = Robot("disappears", "/Hood/Angle")
    advise(robot, 4.2)
    before, last = robot.said[4 * HZ - 2], robot.said[-1]
    assert before["hood_deg"] == pytest.approx(51.737, rel=1e-3)
    assert math.isnan(last["hood_deg"]) and math.isnan(last["wheel_rad_s"])    # type: ignore[arg-type]


def test_a_gamepads_buttons_and_a_toggle_are_read_from_a_real_server(nt_server: tuple[Any, str]) -> None:
    server, address = nt_server
    pad = server.getIntegerTopic("/AdvantageKit/DriverStation/Joystick1/ButtonValues").publish()
    toggle = server.getBooleanTopic("/SmartDashboard/Scored").publish()
    buttons = ["/DriverStation/Joystick1/ButtonValues/0", "/DriverStation/Joystick1/ButtonValues/2"]
    keys = NtKeys(address, [*buttons, "/SmartDashboard/Scored"])
    facts = replace(MAP, outcome=OutcomeKeys(buttons={buttons[0]: "three", buttons[1]: "miss-low",
                                                      "/SmartDashboard/Scored": "two"}))
    clock = Clock()
    io = AdviceIo(config(), facts, keys, clock, lambda: False, 0.02)
    pressed = list[str]()
    for held, scored in ((0, False), (0b100, False), (0b101, False), (0, False), (0, True)):
        pad.set(held)
        toggle.set(scored)
        server.flush()
        wanted = [float(held & 1), float(held >> 2 & 1), float(scored)]
        wait_until(lambda wanted=wanted: [one.value for one in keys.read(time.monotonic_ns()).values()] == wanted)
        clock.t_ns = max(clock.t_ns, time.monotonic_ns())
        inputs = io.read()
        assert inputs is not None
        pressed += [event.button for event in inputs.buttons]
    stamps = {keys.read(time.monotonic_ns())["/SmartDashboard/Scored"].t_ns for _ in range(2000)}
    keys.close()
    assert pressed == ["miss-low", "three", "two"]
    assert len(stamps) == 1           # a stamp that wanders would make an old mark a new one
