"""What is told of driven worlds: a page also where nothing else was played, and nothing that was forged."""

from pathlib import Path

import msgspec
import pytest

from truearc.cli.main import main
from truearc.errors import InputError
from truearc_proof.cli import prove_roles
from truearc_proof.cli.prove_roles import Driven, driven_of, room_of
from truearc_proof.rounds import Room, append
from truearc_proof.rounds.grader import save_mark


def make_driven(root: Path) -> Room:
    """One world, as if it had been driven in."""
    room = room_of(root)
    room.root.mkdir(parents=True)
    append(room.ledger, "sealed", "r0001", "0" * 64)
    scored = {"no gate": (3, 10), "before": (5, 10), "after": (7, 10)}
    save_mark(room, "r0001", Driven("r0001", "tail_wind", "named", ("wind_x",), scored), {})
    return room


def test_a_round_that_was_only_driven_has_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prove_roles, "play_driven", lambda root, *rest: driven_of(make_driven(root)))
    assert main(["prove", "drive", "--shots", "120", "--seed", "1", "--quiet", "--out", str(tmp_path / "round")]) == 0
    page = (tmp_path / "round" / "report.html").read_text(encoding="utf-8")
    assert "r0001" in page and "tail_wind" in page and "7 of 10" in page


def test_driven_marks_that_the_ledger_does_not_have_are_refused(tmp_path: Path) -> None:
    room = make_driven(tmp_path / "round")
    assert driven_of(room)[0].scored["after"] == (7, 10)
    line = msgspec.json.decode(room.grades.read_bytes())
    line["scored"]["after"] = [10, 10]
    room.grades.write_bytes(msgspec.json.encode(line) + b"\n")
    with pytest.raises(InputError, match="r0001 is not marked as the ledger has it"):
        driven_of(room)
