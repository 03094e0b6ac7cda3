"""Every way of cheating in a round that we could think of, and what is told of each."""

import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from tests.proof.forging import ask, enter_otherwise, leave_world_out, make_mark_kinder
from tests.proof.playing import prove, quiet
from truearc.errors import InputError
from truearc_proof.parallel import append_line
from truearc_proof.rounds import Room, digest
from truearc_proof.rounds.committer import answer_round
from truearc_proof.rounds.grader import grade_round, graded_of

pytestmark = pytest.mark.slow


def change_data(room: Room) -> Path:
    path = next(room.data("w0002").glob("shots.*"))
    path.write_bytes(path.read_bytes() + b"\n")
    return path


def change_claims(room: Room) -> Path:
    path = room.claims("w0001")
    path.write_bytes(path.read_bytes().replace(b'"verdict":"', b'"verdict":"x', 1))
    return path


def change_seal(room: Room) -> Path:
    path = room.seal("w0003")
    path.write_bytes(path.read_bytes().replace(b'"seed": ', b'"seed": 1', 1))
    return path


def lose_claims(room: Room) -> Path:
    room.claims("w0003").unlink()
    return room.claims("w0003")


def add_data(room: Room) -> Path:
    path = room.data("w0001") / "hint.txt"
    path.write_text("it is the wind")
    return path


@pytest.mark.parametrize("cheat", [change_data, change_claims, change_seal, lose_claims, add_data])
def test_whatever_was_changed_is_named(room: Room, cheat: Callable[[Room], Path]) -> None:
    path = cheat(room)
    with pytest.raises(InputError, match=path.name):
        grade_round(room, quiet, 1)
    assert not room.grades.exists() or not room.grades.read_bytes()


def test_a_line_taken_out_of_the_ledger_breaks_it(room: Room) -> None:
    lines = room.ledger.read_bytes().splitlines(keepends=True)
    room.ledger.write_bytes(b"".join(lines[:1] + lines[2:]))
    with pytest.raises(InputError, match="line 2: does not follow"):
        grade_round(room, quiet, 1)


def forge_marks(room: Room) -> str:
    make_mark_kinder(room, 1)
    return "w0002 is not marked as the ledger has it"


def add_marks(room: Room) -> str:
    line = msgspec.json.decode(room.grades.read_bytes().splitlines()[0])
    append_line(room.grades, {**line, "world": "w0099"})
    return "w0099: is marked here, but not in the ledger"


def edit_last_line(room: Room) -> str:
    """Nothing follows it whose `before` could tell."""
    lines = room.ledger.read_bytes().splitlines(keepends=True)
    last = msgspec.json.decode(lines[-1])
    room.ledger.write_bytes(b"".join(lines[:-1]) + msgspec.json.encode({**last, "sha256": "0" * 64}) + b"\n")
    return f"{last['world']} is not marked as the ledger has it"


def rename_last_line(room: Room) -> str:
    lines = room.ledger.read_bytes().splitlines(keepends=True)
    last = msgspec.json.decode(lines[-1])
    room.ledger.write_bytes(b"".join(lines[:-1]) + msgspec.json.encode({**last, "world": "w0099"}) + b"\n")
    return "w0099: was never sealed"


def change_plan(room: Room) -> str:
    room.plan.write_bytes(room.plan.read_bytes().replace(b'"seed":3', b'"seed":4'))
    return "round.json was changed"


def drop_world(room: Room) -> str:
    """Out of the ledger, its chain made anew, and out of the marks."""
    leave_world_out(room, "w0002")
    lines = room.grades.read_bytes().splitlines(keepends=True)
    room.grades.write_bytes(lines[0] + lines[2])
    return "w0002.json: its world is not in the ledger"


@pytest.mark.parametrize("cheat", [forge_marks, add_marks, edit_last_line, rename_last_line, change_plan, drop_world])
def test_a_marked_round_cannot_be_changed_afterwards(done: Room, cheat: Callable[[Room], str]) -> None:
    expected = cheat(done)
    with pytest.raises(InputError, match=expected):
        grade_round(done, quiet, 1)


def test_tables_are_not_made_of_forged_marks(done: Room) -> None:
    expected = forge_marks(done)
    with pytest.raises(InputError, match=expected):
        graded_of(done)


def test_marks_laid_down_before_the_grading_are_refused(room: Room, marked: Room) -> None:
    shutil.copy(marked.grades, room.grades)
    with pytest.raises(InputError, match="w0001: is marked here, but not in the ledger"):
        grade_round(room, quiet, 1)


def test_marks_that_a_kill_has_lost_are_made_again(done: Room) -> None:
    """Between the ledger's line and that of the marks; what is marked again must be what was entered."""
    whole = done.grades.read_bytes()
    done.grades.write_bytes(b"".join(whole.splitlines(keepends=True)[:2])[:-20])
    assert [one.world for one in grade_round(done, quiet, 1)] == ["w0001", "w0002", "w0003"]
    assert [line for line in done.grades.read_bytes().splitlines() if line in whole.splitlines()] == whole.splitlines()


def test_worlds_that_nobody_claimed_do_not_vanish(room: Room) -> None:
    leave_world_out(room, "w0002", "claimed")
    refused = prove(room.root, "grade", "--processes", "1")
    assert refused.returncode == 2 and "w0002.json: is missing: there is no claim" in refused.stderr
    told = prove(room.root, "grade", "--processes", "1", "--so-far")
    assert told.returncode == 0 and "1 worlds are sealed and not claimed" in told.stdout, told.stderr
    assert [one.world for one in graded_of(room)] == ["w0001", "w0003"]


def test_where_second_claims_are_withheld_the_first_are_marked(room: Room) -> None:
    ask(room, "w0002", [{"distance_m": 4.0, "hood_deg": 48.0, "motor_ratio": 0.55, "shots": 12}])
    answer_round(room, quiet, 1)
    room.again("w0002").parent.mkdir()
    shutil.copy(room.claims("w0002"), room.again("w0002"))       # lies there, but nobody has entered it
    marks = {one.world: one for one in grade_round(room, quiet, 1)}
    assert list(marks) == ["w0001", "w0002", "w0003"] and marks["w0002"].again is None


@pytest.mark.parametrize(("claims", "key"), [(b"no json", "malformed"), (b"[]", "object"), (b'{"finding": {}}', "data"),
                                             (b'{"data": {}}', "finding"),
                                             (b'{"data": {}, "finding": {"verdict": "none"}}', "mismatch"),
                                             (b'{"data": {}, "finding": {"mismatch": {"found": true}}}', "verdict")])
def test_claims_that_cannot_be_read_are_refused_by_file_and_key(room: Room, claims: bytes, key: str) -> None:
    room.claims("w0003").write_bytes(claims)
    enter_otherwise(room, "w0003", {"claimed": digest(claims)})
    with pytest.raises(InputError, match=rf"w0003\.json: .*{key}"):
        grade_round(room, quiet, 1)
