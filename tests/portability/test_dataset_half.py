"""The way from a team's spreadsheet to set points, without what only Linux has, by names that are not English.

tests/cli/test_demo.py runs the demo in the same way.
"""

import csv
import json
from pathlib import Path

import pytest

import truearc as ta
from tests.portability.elsewhere import ROOT, run_elsewhere

SHOTS = 20                            # of the example's
MAP = """schema = "truearc.shot-map/1"
rows = "shot"

[columns]
distance_m = { key = "Abstand in Fuß", unit = "ft" }
hood_deg = "Höhe"
motor_ratio = "Motor"

[outcome]
key = "Ergebnis"
values = { drin = "three", knapp = "two", daneben = "miss" }
"""
WORDS = {"three": "drin", "two": "knapp", "miss": "daneben"}
COMMANDS = (
    ("import", "csv", "unsere Würfe.csv", "--map", "Übersetzung.toml", "--rig", "rig.toml", "-o", "erste Woche"),
    ("check", "erste Woche"),
    ("fit", "erste Woche", "--terms", "gravity,drag,magnus,exit_efficiency", "-o", "was gilt.toml"),
    ("discover", "erste Woche", "--report", "Befund.html", "--adopt", "was neu gilt.toml"),
    ("design", "erste Woche", "--shots", "12", "--json", "nächste.json"),
    ("aim", "was gilt.toml", "--rig", "rig.toml", "--distances", "3,4", "--format", "csv", "-o", "Ziele.csv",
     "--picture", "Ziele.png"),
)
LACKING = """
import importlib, os, signal, socket, sys
import truearc.hw.real.system as ours
def refused(error, call, *values):
    try:
        call(*values)
    except error:
        return True
for name in ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd"):
    assert refused(ModuleNotFoundError, importlib.import_module, name)
assert not any(hasattr(os, name) for name in ("fork", "mkfifo", "sched_yield")) and not hasattr(signal, "SIGUSR1")
assert refused(FileNotFoundError, os.listdir, "/proc/self") and refused(OSError, open, "12:30.txt", "wb")
assert refused(OSError, socket.socket, 29, socket.SOCK_RAW, 1)
with open("held", "wb"):
    assert refused(PermissionError, os.remove, "held")
assert eval("sys.platform", vars(ours)) == "win32" and eval("os.name", vars(ours)) == "nt"
assert refused(EncodingWarning, lambda: exec("open('held')", vars(ours)))
"""


def test_the_interpreter_lacks_what_windows_lacks(tmp_path: Path) -> None:
    run_elsewhere(LACKING, tmp_path)


@pytest.mark.slow
def test_spreadsheet_becomes_set_points_without_linux(tmp_path: Path) -> None:
    folder = tmp_path / "Schüler und Ölfass"
    folder.mkdir()
    (folder / "rig.toml").write_bytes((ROOT / "examples" / "spreadsheet" / "rig.toml").read_bytes())
    (folder / "Übersetzung.toml").write_text(MAP, encoding="utf-8")
    with (ROOT / "examples" / "spreadsheet" / "shots.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))[:SHOTS]
    distances_m = [float(row["distance_m"]) for row in rows]
    lines = [f"{distance_m / 0.3048:.3f},{row['hood_deg']},{row['motor_ratio']},{WORDS[row['outcome']]}"
             for row, distance_m in zip(rows, distances_m, strict=True)]
    text = "\n".join(["Abstand in Fuß,Höhe,Motor,Ergebnis", *lines])
    (folder / "unsere Würfe.csv").write_text(text, encoding="utf-8")
    run_elsewhere("from truearc.cli.main import main\n"
                  f"for words in {COMMANDS!r}:\n    assert main(list(words)) == 0, words", folder)
    week = ta.load_dataset(folder / "erste Woche").shots
    assert week.texts["outcome"] == tuple(row["outcome"] for row in rows)
    assert week.numbers["distance_m"] == pytest.approx(distances_m, abs=2e-4)
    assert ta.load_belief(folder / "was gilt.toml").coefficients["drag"]["cd"] == pytest.approx(0.5, abs=0.5)
    assert json.loads((folder / "nächste.json").read_text(encoding="utf-8"))["schema"].startswith("truearc.")
    with (folder / "Ziele.csv").open(encoding="utf-8", newline="") as file:
        assert [float(row["distance_m"]) for row in csv.DictReader(file)] == [3.0, 4.0]
    assert (folder / "Ziele.png").read_bytes().startswith(b"\x89PNG")
    assert "wheel" in (folder / "Befund.html").read_text(encoding="utf-8")
