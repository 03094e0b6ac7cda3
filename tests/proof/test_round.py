"""Rounds as they are played, cut short and tampered with, with both engines."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from tests.proof.playing import chain_anew, leave_world_out, make_mark_kinder, prove, prove_apart, quiet
from truearc.errors import InputError
from truearc_proof.parallel import append_line
from truearc_proof.rounds import Room, load_seal, read_ledger
from truearc_proof.rounds.committer import RoundPlan, load_plan, seal_round
from truearc_proof.rounds.grader import grade_round, graded_of
from truearc_proof.rounds.worlds import FOREIGN, MUJOCO, NUMPY

pytestmark = pytest.mark.slow


def test_every_world_is_sealed_claimed_opened_and_marked_in_that_order(room: Room) -> None:
    marks = grade_round(room, quiet, 1)
    assert [one.first.world for one in marks] == ["w0001", "w0002", "w0003"]
    for world in ("w0001", "w0002", "w0003"):
        assert [entry.what for entry in read_ledger(room.ledger) if entry.world == world] == [
            "sealed", "claimed", "opened", "graded"]
    before = room.ledger.read_bytes(), room.grades.read_bytes()
    assert grade_round(room, quiet, 1) == marks
    assert (room.ledger.read_bytes(), room.grades.read_bytes()) == before      # never marked twice


def test_rivals_without_tracks_are_refused(room: Room) -> None:
    early = prove(room.root.parent / "new", "--level", "L1", "--rivals", "gp", "--seed", "1")
    assert early.returncode == 2 and "--rivals" in early.stderr and not (room.root.parent / "new").exists()
    late = prove(room.root, "solve", "--rivals", "gp")
    assert late.returncode == 2 and "no world has tracks" in late.stderr


def test_the_solver_needs_no_keeper_beside_it(room: Room, tmp_path: Path) -> None:
    """Whoever does not trust a solver gives it a copy of data and ledger."""
    away = Room(tmp_path / "away")
    shutil.copytree(room.root / "data", away.root / "data")
    chain_anew(away, [one for one in read_ledger(room.ledger) if one.what == "sealed"])
    done = prove(away.root, "solve", "--processes", "1")
    assert done.returncode == 0 and not away.keeper.exists(), done.stderr
    shutil.copytree(away.root / "claims", room.root / "claims", dirs_exist_ok=True)
    shutil.copy(away.ledger, room.ledger)
    assert len(grade_round(room, quiet, 1)) == 3


def test_what_was_cut_short_goes_on(room: Room) -> None:
    """Killed after the first world was sealed and claimed: the same data come again, and what is there stays."""
    claims = room.claims("w0001").read_bytes()
    lines = room.ledger.read_bytes().splitlines(keepends=True)
    kept = [line for line in lines[:3] if b'"w0001"' in line]
    assert len(kept) == 1
    room.ledger.write_bytes(kept[0])
    data = {path: path.read_bytes() for path in room.data("w0003").iterdir()}
    given = {path: path.read_bytes() for path in room.data("w0001").iterdir()}
    shutil.rmtree(room.data("w0003"))
    shutil.rmtree(room.data("w0001"))            # in the ledger, and not given away yet
    (room.data("w0002") / "torn").write_bytes(b"")
    seal_round(room, load_plan(room), quiet, 1)
    assert [(one.world, one.what) for one in read_ledger(room.ledger)] == [
        ("w0001", "sealed"), ("w0002", "sealed"), ("w0003", "sealed")]
    assert {path: path.read_bytes() for path in room.data("w0003").iterdir()} == data
    assert {path: path.read_bytes() for path in room.data("w0001").iterdir()} == given
    assert room.claims("w0001").read_bytes() == claims


def test_another_plan_needs_another_directory(room: Room) -> None:
    with pytest.raises(InputError, match="drawn from something else"):
        seal_round(room, RoundPlan(4, 3, "L0", 40, ("numpy",)), quiet, 1)


def test_the_solver_can_open_nothing_of_the_keepers(tmp_path: Path) -> None:
    (tmp_path / "keeper").mkdir()
    for name in ("keeper/seal.json", "other.json"):
        (tmp_path / name).write_text("{}")
    program = f"""
import os, pathlib
from truearc_proof.rounds.solver import forbid
os.chdir({str(tmp_path)!r})
os.symlink("keeper/seal.json", "way_round") if hasattr(os, "symlink") else None
forbid(pathlib.Path("keeper"))
assert open("other.json").read() == "{{}}"
for attempt in (lambda: open("keeper/seal.json"), lambda: open("way_round"), lambda: os.listdir("keeper"),
                lambda: os.open("keeper/seal.json", os.O_RDONLY), lambda: list(os.scandir("keeper")),
                lambda: pathlib.Path("other/../keeper/seal.json").read_text(),
                lambda: os.rename("keeper/seal.json", "mine.json"), lambda: os.link("keeper/seal.json", "mine.json")):
    try:
        attempt()
    except (PermissionError, FileNotFoundError):
        continue
    raise SystemExit(f"opened: {{attempt}}")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "keeper" / "seal.json").exists()


def change(path: Path, was: bytes, becomes: bytes) -> Path:
    whole = path.read_bytes()
    assert was in whole
    path.write_bytes(whole.replace(was, becomes, 1))
    return path


def change_data(room: Room) -> Path:
    return change(next(room.data("w0002").glob("shots.*")), b"\n", b"\n\n")


def change_claims(room: Room) -> Path:
    return change(room.claims("w0001"), b'"verdict":"', b'"verdict":"x')


def change_seal(room: Room) -> Path:
    return change(room.seal("w0003"), b'"seed": ', b'"seed": 1')


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


def forge_marks(room: Room) -> str:
    make_mark_kinder(room, 1)
    return "w0002 is not marked as the ledger has it"


def add_marks(room: Room) -> str:
    line = msgspec.json.decode(room.grades.read_bytes().splitlines()[0])
    append_line(room.grades, {**line, "world": "w0099"})
    return "w0099: is marked here, but not in the ledger"


def edit_last_line(room: Room, **how: str) -> str:
    """Nothing follows it whose `before` could tell."""
    lines = room.ledger.read_bytes().splitlines(keepends=True)
    last = msgspec.json.decode(lines[-1])
    room.ledger.write_bytes(b"".join(lines[:-1]) + msgspec.json.encode(last | (how or {"sha256": "0" * 64})) + b"\n")
    return f"{last['world']} is not marked as the ledger has it"


def rename_last_line(room: Room) -> str:
    edit_last_line(room, world="w0099")
    return "w0099: was never sealed"


def change_plan(room: Room) -> str:
    change(room.plan, b'"seed":3', b'"seed":4')
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
    if cheat is forge_marks:
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


# --- both engines, checked by a stranger

ARGUMENTS = ["--worlds", "4", "--level", "L1", "--shots", "24", "--engines", "numpy,mujoco", "--seed", "26",
             "--processes", "1"]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Room:
    room = Room(tmp_path_factory.mktemp("both") / "round")
    done = prove_apart(room.root, *ARGUMENTS)
    assert done.returncode == 0, done.stderr
    return room


def test_every_world_of_either_engine_is_sealed_before_and_opened_after_it_is_claimed(both: Room) -> None:
    entries = read_ledger(both.ledger)
    order = {step: [one.number for one in entries if one.what == step] for step in ("sealed", "claimed", "opened")}
    assert [len(numbers) for numbers in order.values()] == [5, 4, 4]        # MuJoCo's home is sealed, too
    assert max(order["sealed"]) < min(order["claimed"]) and max(order["claimed"]) < min(order["opened"])
    marks = [one.first for one in graded_of(both)]
    assert {one.engine for one in marks} == {NUMPY, MUJOCO}
    assert {(one.engine, one.kind) for one in marks} == {
        (NUMPY, "off"), (NUMPY, "dirty"), (MUJOCO, "one"), (MUJOCO, "clean")}


def test_marks_follow_from_claims_and_seals(both: Room) -> None:
    for mark in (one.first for one in graded_of(both)):
        sealed = load_seal(both.seal(mark.world)).world
        found = msgspec.json.decode(both.claims(mark.world).read_bytes())["finding"]["mismatch"]
        assert mark.kind == sealed["kind"] and mark.found == found["found"] == (found["p_value"] < 0.05)
        assert mark.engine == MUJOCO or mark.hidden == tuple(sealed["effects"])
        assert mark.allowed is None or 0.0 <= mark.allowed[0] <= 1.0
        assert (mark.off_m is not None) == mark.found          # adopted beliefs are put to the sealed season


def test_figures_are_there_as_json(both: Room) -> None:
    figures = msgspec.json.decode(both.figures.read_bytes())["L1, 24"]
    clean, dirty = figures["false alarms, clean"], figures["false alarms, dirty"]
    assert clean["value"] is None                              # the clean world is MuJoCo's, in a row of its own
    assert dirty["value"] in (0.0, 1.0) and dirty["low95"] <= dirty["value"] <= dirty["high95"]     # of one world


def test_a_stranger_makes_data_claims_and_marks_again(both: Room, tmp_path: Path) -> None:
    packed = str(tmp_path / "round.tar.xz")
    assert prove(both.root, "pack", "--packed", packed).returncode == 0
    done = prove(tmp_path / "again", "check", "--packed", packed, "--worlds", "2", "--solve", "1", "--seed", "1",
                 "--processes", "1")
    assert done.returncode == 0 and "solved again from the data alone, and marked alike" in done.stdout, done.stderr


ONE_WORLD = ["--worlds", "1", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3"]


def test_a_foreign_world_is_solved_from_its_own_practice(tmp_path: Path) -> None:
    room, packed = Room(tmp_path / "round"), str(tmp_path / "round.tar.xz")
    for more in (["seal", *ONE_WORLD, "--engines", "foreign"], ["solve"], ["grade"], ["pack", "--packed", packed]):
        done = prove(room.root, *more)
        assert done.returncode == 0, done.stderr
    (one,) = graded_of(room)
    assert one.first.engine == FOREIGN and one.first.kind in ("clean", "one")
    told = msgspec.json.decode(room.claims("w0001").read_bytes())
    assert told["finding"]["data"]["shots"] == 11 and {"shots.csv", "home/shots.csv"} <= set(told["data"])
    done = prove(tmp_path / "again", "check", "--packed", packed, "--worlds", "1", "--processes", "1")
    assert done.returncode == 0 and "1 worlds made again" in done.stdout, done.stderr


def test_a_round_that_was_begun_is_played_to_its_end(tmp_path: Path) -> None:
    room = Room(tmp_path / "round")
    for words in (["seal", *ONE_WORLD], ["solve", "--quiet"]):
        done = prove(room.root, *words)
        assert done.returncode == 0, done.stderr
    done = prove(room.root, *ONE_WORLD, "--quiet")
    assert done.returncode == 0, done.stderr
    assert [one.what for one in read_ledger(room.ledger)] == ["sealed", "claimed", "opened", "graded"]
    assert len(room.grades.read_bytes().splitlines()) == 1
