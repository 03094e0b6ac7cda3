"""Replay from the wires, and with something changed."""

import re
import shutil
import struct

import cv2
import numpy as np
import pytest

from tests.robot.recording.conftest import CONFIG
from tests.robot.test_rig import UNPLUGGED, Stream, Time, Wire, rig_on
from truearc import robot
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.protocols import Frame
from truearc.robot.config.schema import load_config
from truearc.robot.reasons import CAN_LOST
from truearc.robot.recording.files import TappedBus, load_pictures
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Difference, config_changes, find_changes, replay, replay_frames
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.runtime import run


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("name", ["plain", "faulty", "gated"])
def test_golden_sessions_replay_to_the_bit_from_inputs_and_from_frames(name, request):
    folder = request.getfixturevalue(name)
    replayed, again = replay_frames(folder)
    assert replayed == replay(folder) and replayed.ticks > 500 and not replayed.cut_short
    assert again.frames > 3 * replayed.ticks and again.missing == 0
    assert again.seen == len(load_pictures(folder)) and again.taken > 5
    assert main(["session", "replay", str(folder), "--from", "frames", "--check"]) == 0


def test_frames_with_stamps_of_their_own_and_a_lost_bus_are_parsed_again(tmp_path):
    """As a real bus gives them: stamped when they came, between ticks, some in none's time, and once not at all."""
    bus, box, clock = Wire(), Stream(), Time()
    recorder = SessionWriter(tmp_path / "s", make_header(CONFIG, None, None), CONFIG, None, lossless=True)
    rig = rig_on(TappedBus(bus, recorder.tap), clock, CONFIG, box, lambda: clock.t_ns > 2_000_000_000)

    class Feeding:
        """Puts frames on the wire before each tick."""

        write, picture = rig.write, rig.picture

        def read(self):
            velocity = struct.pack("<ff", 1.0, clock.t_ns * 1e-9)
            bus.frames = [Frame(clock.t_ns + 1_234_000 * at, 0x29 + 0x20 * (at % 4), velocity)
                          for at in range(clock.t_ns // 5_000_000 % 4)]
            bus.lost = 1_500_000_000 < clock.t_ns < 1_600_000_000
            return rig.read()

    run(Feeding(), CONFIG, None, recorder)
    recorder.close()
    faults = [fault for tick, _ in TickReader(tmp_path / "s") for fault in tick.inputs.faults]
    assert CAN_LOST(cause=UNPLUGGED) in faults
    replayed, again = replay_frames(tmp_path / "s")
    assert replayed == replay(tmp_path / "s") and replayed.ticks == 201 and again.frames > 200


def test_one_bit_of_one_frame_is_a_difference_that_names_the_input(session, capsys):
    lines = (session / "can0.log").read_text().splitlines(keepends=True)
    at = next(index for index, line in enumerate(lines) if index > 2000 and " 029#" in line)
    place = lines[at].index("#") + 9                       # velocity, lowest byte
    lines[at] = lines[at][:place] + f"{int(lines[at][place:place + 2], 16) ^ 1:02X}" + lines[at][place + 2:]
    (session / "can0.log").write_text("".join(lines))
    assert replay(session).ticks > 1000                    # the recorded inputs are as they were
    with pytest.raises(Difference, match=r"tick\.inputs\.flywheels\.0\.velocity_rad_s was .*, is now"):
        replay_frames(session)
    assert main(["session", "replay", str(session), "--from", "frames"]) == 1
    assert "velocity_rad_s" in capsys.readouterr().err


def test_another_image_is_another_sighting(session):
    path = session / "frames" / load_pictures(session)[1].file
    image = cv2.imread(str(path))
    cv2.imwrite(str(path), np.roll(image, 3, axis=1))
    with pytest.raises(Difference, match=r"tick\.inputs\.sighting\."):
        replay_frames(session)


def test_an_image_that_is_not_there_fails_the_check_and_is_told(session, capsys):
    (session / "frames" / load_pictures(session)[0].file).unlink()
    assert main(["session", "replay", str(session), "--from", "frames"]) == 0
    assert main(["session", "replay", str(session), "--from", "frames", "--check"]) == 1
    assert "1 images that the session names, or the index of all, are not there" in capsys.readouterr().out


def test_a_log_of_frames_that_ends_early_is_replayed_so_far_and_fails_the_check(session, capsys):
    data = (session / "can0.log").read_bytes()
    (session / "can0.log").write_bytes(data[:len(data) // 2 + 7])
    replayed, _ = replay_frames(session)
    assert 300 < replayed.ticks < 800 and "ends before the ticks" in replayed.cut_short
    assert main(["session", "replay", str(session), "--from", "frames", "--check"]) == 1
    assert main(["session", "replay", str(session), "--check"]) == 0


def test_frames_that_cannot_be_read_are_an_error(session, capsys):
    edit(session / "can0.log", "can0 ", "can0  ")
    with pytest.raises(InputError, match=r"can0\.log:1: not a candump line"):
        replay_frames(session)
    (session / "can0.log").write_text("")
    assert main(["session", "replay", str(session), "--from", "frames"]) == 2
    (session / "can0.log").unlink()
    assert main(["session", "replay", str(session), "--from", "frames"]) == 2
    assert "can0.log" in capsys.readouterr().err


def test_a_missing_or_foreign_model_is_an_error(gated, tmp_path, capsys):
    session = shutil.copytree(gated, tmp_path / "s")
    (session / "model.onnx").unlink()
    for depth in ("inputs", "frames"):
        assert main(["session", "replay", str(session), "--from", depth, "--check"]) == 2
        assert "the model that gated the recording is missing" in capsys.readouterr().err


@pytest.fixture
def other(tmp_path):
    """A function that gives launcher.toml with one text replaced by another."""
    path = tmp_path / "launcher.toml"
    shutil.copy(f"{robot.__path__[0]}/launcher.toml", path)

    def change(old, new):
        edit(path, old, new)
        return path
    return change


def test_a_changed_gain_is_a_report_of_what_when_first_and_by_how_much(plain, other, capsys):
    path = other("ks_nm = 0.02", "ks_nm = 0.03")
    changes = find_changes(plain, load_config(path), None)
    assert config_changes(CONFIG, load_config(path)) == ["flywheel.ks_nm: 0.02 -> 0.03"]
    assert list(changes.outputs) == ["command.flywheel_torque_nm"] and changes.flips == []
    change = changes.outputs["command.flywheel_torque_nm"]
    assert 0.005 < change.largest < 0.01 + 1e-9            # ks itself, unless the limit cuts it
    assert change.now > change.was and change.unit == "Nm"
    assert main(["session", "replay", str(plain), "--config", str(path)]) == 0
    said = capsys.readouterr().out
    assert "with flywheel.ks_nm: 0.02 -> 0.03" in said and "command.flywheel_torque_nm" in said
    assert "No verdict changes: 2 shots then and now." in said
    assert main(["session", "replay", str(plain), "--config", str(path), "--check"]) == 1


def test_verdicts_that_flip_are_told_with_the_reason(plain, other, capsys):
    path = other("sighting_age_s = ", "sighting_age_s = 0.02 #")
    changes = find_changes(plain, load_config(path), None)
    assert (changes.fired, changes.fires) == (2, 0) and [flip.fired for flip in changes.flips] == [True, True]
    assert main(["session", "replay", str(plain), "--config", str(path)]) == 0
    said = capsys.readouterr().out
    assert "2 verdicts change: 2 shots then, 0 now." in said
    assert re.search(r"it fired, and now holds: .*target last seen", said)
    assert max(map(len, said.splitlines())) < 260


def test_the_same_configuration_changes_nothing_another_model_does(plain, gated, other, capsys):
    assert main(["session", "replay", str(plain), "--check", "--config",
                 str(other("ks_nm = 0.02", "ks_nm = 0.02"))]) == 0
    assert "no output changes" in capsys.readouterr().out
    assert main(["session", "replay", str(gated), "--gate", str(gated / "model.onnx"), "--check"]) == 0
    assert main(["session", "replay", str(plain), "--gate", str(gated / "model.onnx")]) == 0
    said = capsys.readouterr().out
    assert "verdict.p_three" in said and "nothing -> 0." in said


def test_questions_that_make_no_sense_are_bad_input(plain, other, tmp_path, capsys):
    assert main(["session", "replay", str(plain), "--config", str(tmp_path / "nowhere.toml")]) == 2
    assert main(["session", "replay", str(plain), "--config", str(other("ks_nm", "ks_nm")), "--from", "frames"]) == 2
    assert main(["session", "replay", str(plain), "--config",
                 str(other('policy = "collect"', 'policy = "model"'))]) == 2
    assert "--gate is needed" in capsys.readouterr().err
