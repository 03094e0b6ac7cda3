"""What cannot be emulated is refused before there is a folder or a wire."""

import pytest

from truearc.cli.common import SHIPPED
from truearc.cli.main import main

TEXT = SHIPPED.read_text(encoding="utf-8")
SECOND = '[[axes.flywheels]]\ndriver = "odrive"\nnode = 2'
THIRD = f"{SECOND.replace('2', '7')}\ndirection = 1\nendstop_endpoint = 0\n\n"


@pytest.mark.parametrize(("old", "new", "said"), [
    (SECOND, f"{THIRD}{SECOND}", "axes.flywheels: 3 motors; the emulated robot has 2, so state as many"),
    ("node = 2", "node = 1", "axes.flywheels[1].node: 1 is that of axes.flywheels[0], too"),
])
@pytest.mark.parametrize("words", [["emulate", "--trials", "1", "--out", "s"], ["sysid", "--emulate", "--out", "s"],
                                   ["emulate", "--trials", "1", "--bus", "slcan:auto"]])
def test_axes_that_cannot_be_emulated_leave_nothing(words, old, new, said, tmp_path, monkeypatch, capsys):
    assert old in TEXT
    (tmp_path / "mine.toml").write_text(TEXT.replace(old, new, 1))
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--config", "mine.toml"]) == 2
    assert said in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_a_robot_with_one_device_twice_is_refused_before_there_is_a_folder(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.toml").write_text(TEXT.replace("node = 2", "node = 1"))
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--config", "mine.toml", "--can", "virtual:x", "--page", "off"]) == 2
    assert "is that of axes.flywheels[0], too" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
