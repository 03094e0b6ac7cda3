"""The field's table from lines whose marks are counted by hand."""

from typing import Any

import msgspec

from benchmarks.compare import flight_names, make_table, marks_of
from benchmarks.worlds import Job
from truearc_proof.rivals.claim import Claim


def line(kind: str, name: str, claims: dict[str, Claim], detected: float | None = 1.0) -> dict[str, Any]:
    scale = 0.0 if kind == "nulls" else 1.0
    made = {"job": Job(kind, name, "L2", 300, scale, 1, 0),
            "ceiling": None if detected is None else (detected, 1.0, 1.0, 1.0, ("spin_drag",)),
            "claims": {who: {"claim": claim, "seconds": 2.0} for who, claim in claims.items()}}
    return msgspec.json.decode(msgspec.json.encode(made))


RIGHT, ALIAS = Claim(True, ("spin_decay", "wind_x"), 0.05, 0.03), Claim(True, ("spin_drag",), 0.05, 0.04)
ALL, NONE = "1/1 = 1.00 (0.21-1.00)", "0/1 = 0.00 (0.00-0.79)"
MUTE, NAMELESS = Claim(False, (), 0.05, 0.05), Claim(True)


def test_marks_count_silence_and_namelessness_as_misses() -> None:
    marks = {mark.entrant: mark for mark in marks_of(line("effects", "spin_decay", {
        "truearc": RIGHT, "alias": ALIAS, "mute": MUTE, "nameless": NAMELESS}))}
    assert [(mark.says, mark.right, mark.alias) for mark in marks.values()] == [
        (True, True, True), (True, False, True), (False, False, False), (True, False, False)]


def test_an_alias_of_the_level_counts_too() -> None:
    assert marks_of(line("effects", "buoyancy", {"x": Claim(True, ("added_mass",))}))[0].alias is True


def test_only_resolvable_worlds_are_counted_and_the_target_is_told() -> None:
    lines = [line("effects", "spin_decay", {"truearc": RIGHT, "gp": NAMELESS}),
             line("effects", "spin_decay", {"truearc": MUTE, "gp": MUTE}, detected=0.9),
             line("nulls", "clean", {"truearc": MUTE, "gp": NAMELESS}, None)]
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in make_table(lines).splitlines() if "|" in row]
    table = {(row[0], row[2]): row for row in rows}
    assert table["spin_decay x 1", "truearc"][1:5] == ["1 of 2", "truearc", ALL, ALL]
    assert table["spin_decay x 1", "truearc"][6] == "5.00 -> 3.00"
    assert table["spin_decay x 1", "gp"][3:7] == [ALL, NONE, NONE, "-"]
    assert table["nothing: clean", "gp"][3:5] == [ALL, "-"]
    assert f"names it {ALL}: reached" in make_table(lines)
    assert "| spin_decay x 1 | 1 of 2 | truearc | 1/2 = 0.50 (0.09-0.91) |" in make_table(lines, everywhere=True)


def test_what_cannot_be_resolved_anywhere_has_one_row() -> None:
    lines = [line("effects", "spin_decay", {"truearc": MUTE, "gp": MUTE}, detected=0.5)]
    assert make_table(lines).count("spin_decay x 1 | 0 of 1 | -") == 1
    assert "No world with something hidden is resolvable." in make_table(lines)


def test_what_is_hidden_belongs_to_the_flight() -> None:
    assert set(flight_names("cut")) == {"drag", "magnus"}
    assert "wheel_slip" not in flight_names("effects") and len(flight_names("effects")) == 11
    assert "clean" in flight_names("nulls")
