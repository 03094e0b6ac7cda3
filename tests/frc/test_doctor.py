"""The doctor on NetworkTables: server, keys, clocks, calibration; on a real server and on hand-made answers."""

import math
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from truearc.cli.common import SHIPPED
from truearc.cli.doctor_checks import look_at_readings
from truearc.cli.main import main
from truearc.hw.devices.family import FAILURE, OK, WARNING
from truearc.robot.config.schema import AprilTag, Config, load_config
from truearc.robot.config.shot_map import load_map
from truearc_frc.advice import scaled_columns
from truearc_frc.doctor import HeardKeys, check_network, check_tags, keys_wanted
from truearc_frc.inputs import calibration_key, keys_of_camera
from truearc_frc.keys import Reading
from truearc_frc.table import Nt4, Nt4Velocity, Nt4Vision, with_nt4

GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"
CONFIG = load_config(SHIPPED)
MAP = """schema = "truearc.shot-map/1"
[columns]
distance_m = "/Vision/Distance"
hood_deg = { key = "/Hood/Angle", unit = "deg" }
motor_rad_s = { key = "/Shooter/RPM", unit = "rpm" }
battery_v = "/Battery"
[outcome.buttons]
"/DriverStation/Joystick1/ButtonValues" = "three"
"""
HEARD = HeardKeys(2.0, True, {"/a": Reading(1, 3.0), "/b": Reading(1, 0.0)}, {"/a": 100}, -0.01, [5.0, 5.001])


def seeing(kind: str) -> Config:
    return with_nt4(replace(CONFIG, apriltag=AprilTag((4,), 0.1651, 1.35)),
                    Nt4("254", Nt4Vision(kind, "front", 0.05)))                 # type: ignore[arg-type]


def levels(heard: HeardKeys, lively: tuple[str, ...] = ("/a",), still: tuple[str, ...] = ("/b",)) -> list[str]:
    return [finding.level for finding in check_network("254", lively, still, heard)]


@pytest.mark.parametrize(("heard", "level", "place"), [
    (HEARD._replace(newest={"/b": Reading(1, 0.0)}), FAILURE, 1),
    (HEARD._replace(newest={**HEARD.newest, "/a": Reading(1, math.nan)}), FAILURE, 1),
    (HEARD._replace(changes={}), WARNING, 1),
    (HEARD._replace(newest={"/a": Reading(1, 3.0)}), FAILURE, 2),
    (HEARD._replace(ahead_s=0.2), FAILURE, 3), (HEARD._replace(offsets_s=[]), WARNING, 3),
    (HEARD._replace(offsets_s=[5.0, 5.1]), WARNING, 3)])
def test_each_trouble_is_named_with_what_to_do(heard: HeardKeys, level: str, place: int) -> None:
    found = list(check_network("254", ["/a"], ["/b"], heard))
    assert [finding.level for finding in found].index(level) == place and found[place].do
    assert sum(finding.level != OK for finding in found) == 1


@pytest.mark.parametrize(("column", "value", "said"), [
    ("distance_m", -3.0, "distance_m would be -3, possible is 0 to 20"),
    ("hood_deg", 411.0, "hood_deg would be 411, possible is 0 to 90"),
    ("battery_v", -5.0, "battery_v would be -5, possible is 6 to 16"),
    ("motor_rad_s", 9000.0, "motor_rad_s would be 942.478, possible is -59.4 to 653.4"),
    ("hood_deg", "45", "is a text, '45'"), ("distance_m", 3.0, ""), ("battery_v", 12.0, "")])
def test_a_value_that_advice_would_not_believe_fails(column, value, said, tmp_path):
    (tmp_path / "shots.toml").write_text(MAP, encoding="utf-8")
    columns = scaled_columns(load_map(tmp_path / "shots.toml"), CONFIG)
    key = columns[column].key
    heard = HeardKeys(2.0, True, {key: Reading(1, value)}, {key: 100}, -0.01, [5.0])
    finding = list(check_network("254", [key], [], heard, columns.values()))[1]
    assert (finding.level, finding.says if said else "") == (FAILURE if said else OK, said)
    assert finding.check == f"key {key}" and bool(finding.do) == bool(said)
    if not said:
        assert finding.says == f"{column} {value:.4g} (sent as {value:g}), 50 changes per second"


def test_only_an_outcome_may_be_a_text_and_a_server_that_is_not_there_is_all_that_is_said() -> None:
    heard = HEARD._replace(newest={**HEARD.newest, "/b": Reading(1, "in")})
    assert levels(heard) == [OK, OK, FAILURE, OK] and levels(HEARD) == [OK] * 4
    assert [one.level for one in check_network("254", ["/a"], ["/b"], heard, texts=["/b"])] == [OK] * 4
    assert levels(HEARD._replace(is_connected=False)) == [FAILURE]


def test_the_keys_of_the_configuration_are_looked_at() -> None:
    facts = with_nt4(CONFIG, Nt4("254", Nt4Vision("photonvision", "front", 0.05),
                                 Nt4Velocity("/v", 2.0, 2.0, alive="/t")))
    lively, still = keys_wanted(facts)
    assert lively == ["/photonvision/front/heartbeat", "/t"]
    assert set(still) >= {"/photonvision/front/targetPose/0", "/v/0", "/v/1"}
    assert keys_wanted(CONFIG) == ([], [])


def test_whether_the_camera_is_calibrated_for_tags() -> None:
    vision = Nt4Vision("photonvision", "front", 0.05)
    key = calibration_key(vision)
    assert key == "/photonvision/front/cameraIntrinsics/0" and key not in keys_of_camera(vision)
    for facts, newest, level in (
            (seeing("photonvision"), {key: Reading(1, 700.0)}, OK), (seeing("photonvision"), {}, FAILURE),
            (seeing("limelight"), {}, WARNING)):
        (finding,) = check_tags(facts, newest)
        assert finding.level == level and bool(finding.do) == (level != OK)
    assert not list(check_tags(CONFIG, {}))


@pytest.mark.parametrize(("sigma", "level"), [(0.0, WARNING), (0.01, OK)])
def test_a_camera_of_ours_that_sees_tags_needs_a_calibration(sigma: float, level: str) -> None:
    (finding,) = look_at_readings(replace(CONFIG, camera=replace(CONFIG.camera, target="apriltag", focal_sigma=sigma)))
    assert finding.level == level and not list(look_at_readings(CONFIG))


@pytest.fixture
def robot(nt_server: tuple[Any, str]) -> Iterator[str]:
    """A server whose hood stands still and which has no battery."""
    server, address = nt_server
    distance, hood, wheel = (server.getDoubleTopic(key).publish() for key in ("/Vision/Distance", "/Hood/Angle",
                                                                              "/Shooter/RPM"))
    server.getIntegerTopic("/DriverStation/Joystick1/ButtonValues").publish().set(0)
    over = threading.Event()

    def publish() -> None:
        count = 0
        while not over.wait(0.02):
            count += 1
            distance.set(3.0 + 1e-3 * (count % 5))
            hood.set(45.0)
            wheel.set(2400.0 + count % 7)
            server.flush()

    thread = threading.Thread(target=publish)
    thread.start()
    yield address
    over.set()
    thread.join()


def test_the_keys_of_a_map_on_a_real_server(robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "shots.toml").write_text(MAP, encoding="utf-8")
    words = ["advise", "--check", "--nt", robot, "--map", str(tmp_path / "shots.toml"), "--seconds", "1"]
    assert main(words) == 1
    said = capsys.readouterr().out
    assert f"ok       NetworkTables server: {robot} answers" in said
    assert "key /Vision/Distance: distance_m 3" in said
    assert re.search(r"key /Shooter/RPM: motor_rad_s 25[12](\.\d)? \(sent as 240[0-6]\)", said)
    assert "warning  key /Hood/Angle: has not changed in 1 s" in said
    assert "FAILURE  key /Battery: the robot publishes no such key" in said
    assert "NetworkTables clocks: no stamp is ahead of ours" in said


@pytest.mark.parametrize(("words", "said"), [
    (["--check", "--nt", "254"], "--map: missing"), (["--nt", "254", "--map", "wpilib"], "--gate is needed"),
    (["--nt", "254", "--map", "wpilib", "--json"], "--json: applies with --check only"),
    (["--check", "--nt", "254", "--map", "wpilib", "--gate", "x"], "--gate: does not apply with --check"),
    (["--check", "--nt", "robot:x", "--map", "tracker"], "no motor_rad_s"),
    (["--nt", "254", "--gate", str(GATE), "--map", "nowhere"], "neither a file nor an installed map"),
    (["--nt", "254", "--gate", str(GATE), "--map", "wpilib", "--rate", "5"], "expected 20 to 1000")])
def test_what_cannot_be_looked_at_is_refused(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["advise", *words]) == 2
    assert said in capsys.readouterr().err
