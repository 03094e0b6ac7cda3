"""A round in one file: whoever unpacks it makes the same worlds again, and finds whatever was changed or left out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import structs

from tests.proof.playing import enter_otherwise, leave_world_out, make_mark_kinder, prove, quiet
from truearc.cli.main import main
from truearc.errors import InputError
from truearc_proof.rounds import Room, canonical, digest, load_seal, save_seal
from truearc_proof.rounds.archive import check_round, compare_claims, compare_gradings, pack, unpack
from truearc_proof.rounds.grader import Graded, grade_round, graded_of
from truearc_proof.rounds.marks import Mark
from truearc_proof.rounds.solver import solver_id

MARK = Mark("w1", "numpy", "one", "L1", 300, ("wind_x",), 20.0, True, 0.01, "named", ("wind_x",), 1, True, True, True,
            True, None, True, 0.5, (0.9, 0.8, 0.85, 0.9), None, ("wind_x",))
WAS = Graded("w1", MARK)


@pytest.fixture(scope="module")
def packed(marked: Room, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("packed") / "round.tar.xz"
    pack(marked, path)
    return path


@pytest.fixture
def unpacked(packed: Path, tmp_path: Path) -> Room:
    room = Room(tmp_path / "again")
    unpack(packed, room)
    return room


@pytest.mark.slow
def test_the_same_data_are_made_again_from_the_seals_alone(packed: Path, tmp_path: Path, capsys) -> None:
    words = ["prove", "check", "--quiet", "--packed", str(packed), "--out", str(tmp_path / "again")]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "3 worlds were sealed, 3 marked" in said and "3 worlds made again" in said
    assert "at most 0 (strength), 0 (error), 0 (off_m), 0 (allowed)." in said
    assert main(words) == 2 and "is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_round_that_is_not_marked_is_not_packed(played: Room, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="w0001, w0002, w0003: not marked yet"):
        pack(played, tmp_path / "early.tar.xz")


def change_seal(room: Room) -> str:
    """And with it whatever the ledger's hashes tell: test_round.py has each of them."""
    path = room.seal("w0002")
    path.write_bytes(path.read_bytes().replace(b'"salt": "', b'"salt": "0', 1))
    return "w0002.json: is not what was sealed"


def forge_marks(room: Room) -> str:
    """A kinder mark, in a ledger made anew: what only marking it again can find."""
    line = make_mark_kinder(room, 0)
    enter_otherwise(room, line["world"], {"graded": digest(canonical(line))})
    return f"{line['world']}.json: is marked otherwise now: verdict is"


def leave_out(room: Room) -> str:
    """A world whose outcome did not please, taken out of everything, the chain made anew."""
    leave_world_out(room, "w0002")
    first, _, last = room.grades.read_bytes().splitlines(keepends=True)
    room.grades.write_bytes(first + last)
    return "w0002, which the seed of the round gives, is missing"


def choose_data(room: Room) -> str:
    """Other data than the world of the seal gives, sealed and all: what only making them again can find."""
    seal = load_seal(room.seal("w0001"))
    seal = msgspec.structs.replace(seal, data={**seal.data, "shots.csv": digest(b"kinder shots")})
    save_seal(room.seal("w0001"), seal)
    claims = msgspec.json.decode(room.claims("w0001").read_bytes())
    room.claims("w0001").write_bytes(canonical({**claims, "data": seal.data}))
    enter_otherwise(room, "w0001", {"sealed": seal.commitment,
                                    "claimed": digest(room.claims("w0001").read_bytes())})
    return "shots.csv: was changed"


@pytest.mark.slow
@pytest.mark.parametrize("cheat", [forge_marks, change_seal, leave_out, choose_data])
def test_whatever_was_changed_or_left_out_is_named(unpacked: Room, cheat: Callable[[Room], str]) -> None:
    expected = cheat(unpacked)
    assert any(expected in line for line in check_round(unpacked, 3, quiet).wrong)      # all that there are


@pytest.mark.slow
def test_what_is_no_packed_round_is_refused(tmp_path: Path, capsys) -> None:
    (tmp_path / "no.tar.xz").write_bytes(b"no")
    words = ["prove", "check", "--packed", str(tmp_path / "no.tar.xz"), "--out", str(tmp_path / "again")]
    assert main(words) == 2
    assert "no.tar.xz" in capsys.readouterr().err
    assert main(["prove", "pack", "--out", str(tmp_path / "nothing"), "--packed", "x"]) == 2
    assert "ledger.jsonl: is missing" in capsys.readouterr().err


@pytest.mark.slow
def test_which_worlds_are_made_again_nobody_knows_beforehand(unpacked: Room) -> None:
    """Of three worlds one is made again: not always the same, and the same by the same seed."""
    marks = {one.world: one for one in graded_of(unpacked)}

    def remade(worlds: int, seed: int | None = None) -> tuple[str, ...]:
        return check_round(
            unpacked, worlds, quiet, seed, lambda *some: [], lambda root, job: marks[job[0].name]).remade

    assert {remade(1) for _ in range(60)} == {("w0001",), ("w0002",), ("w0003",)}
    assert remade(1, 7) == remade(1, 7)
    assert remade(9, 7) == ("w0001", "w0002", "w0003")


def forge(room: Room, world: str, solver: str) -> None:
    """Surer than the solver was, under its name or another's."""
    claims = msgspec.json.decode(room.claims(world).read_bytes())
    claims["finding"]["mismatch"]["p_value"] = 0.0123
    room.claims(world).write_bytes(canonical({**claims, "solver": solver}) + b"\n")
    enter_otherwise(room, world, {"claimed": digest(room.claims(world).read_bytes())})


def check(room: Room, *more: str) -> tuple[int, str]:
    """Marked, packed and checked by a stranger; exit code and what was said."""
    grade_round(room, quiet, 1)
    pack(room, room.root / "round.tar.xz")
    done = prove(room.root / "again", "check", "--packed", str(room.root / "round.tar.xz"), "--worlds", "3",
                 "--processes", "1", "--quiet", *more)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
def test_forged_claims_pass_every_hash_and_are_named_when_solved_again(room: Room) -> None:
    forge(room, "w0001", solver_id())
    code, said = check(room, "--solve", "1")
    assert code == 2 and "w0001.json: claims p_value 0.0123; solved again, it is " in said, said


@pytest.mark.slow
def test_claims_under_another_solvers_hash_are_not_solved_by_this_one(room: Room) -> None:
    forge(room, "w0001", "f" * 64)
    code, said = check(room, "--solve", "1")
    assert code == 2 and f"this one is {solver_id()[:16]}: check that commit out" in said, said


CLAIMS: dict[str, Any] = {"finding": {
    "verdict": "set", "mismatch": {"found": True, "p_value": 0.01}, "set": ["drag", "wind_x"], "unknown": None,
    "what": [{"term": "drag", "probability": 0.6, "parameters": {"cd": {"value": 0.5}}},
             {"term": "wind_x", "probability": 0.4, "parameters": {}}], "also": [{"set": ["hood_offset"]}],
    "where": {"stage": None, "stage_probability": {"flight": 0.7, "launch": 0.3}, "covariate": "t_s",
              "direction": "along", "inseparable": ["shot"]}, "fit": {"gain_per_shot": 0.1}},
    "believed": {"before": {"cd": 0.4}, "after": {"cd": 0.5}}}
WHERE: dict[str, Any] = CLAIMS["finding"]["where"]


@pytest.mark.parametrize("forged", [
    {"verdict": "named"}, {"mismatch": {"found": False, "p_value": 0.01}},
    {"mismatch": {"found": True, "p_value": 0.02}}, {"set": ["drag"]}, {"what": CLAIMS["finding"]["what"][:1]},
    {"also": []}, {"fit": {"gain_per_shot": 0.2}}, {"unknown": {"covariate": "t_s", "direction": "along"}},
    *({"where": WHERE | one} for one in ({"stage": "launch"}, {"stage_probability": {"flight": 0.3, "launch": 0.7}},
                                         {"covariate": "ball_id"}, {"direction": "vertical"}, {"inseparable": []}))],
    ids=str)
def test_whatever_marks_are_made_of_cannot_be_forged_unseen(tmp_path: Path, forged: dict[str, Any]) -> None:
    rooms = [Room(tmp_path / name) for name in ("was", "now", "same")]
    for room, change in zip(rooms, (forged, {}, {}), strict=True):
        room.claims("w0001").parent.mkdir(parents=True)
        room.claims("w0001").write_bytes(canonical({**CLAIMS, "finding": {**CLAIMS["finding"], **change}}))
    assert compare_claims(rooms[0], rooms[1], "w0001") and not compare_claims(rooms[1], rooms[2], "w0001")


def changed(**how: Any) -> Graded:
    return Graded("w1", structs.replace(MARK, **how))


def test_last_digits_and_the_luck_of_the_draw_are_told_and_are_no_change() -> None:
    other, off = compare_gradings(WAS, changed(error=float(np.nextafter(0.5, 1.0)), strength=20.0 + 1e-9,
                                      allowed=(0.87, 0.8, 0.85, 0.9)))
    assert other == ()
    assert off["allowed"] == pytest.approx(0.03) and 0.0 < off["error"] < 1e-15
    assert off["strength"] == pytest.approx(5e-11, rel=1e-3)


@pytest.mark.parametrize("how", [
    {"verdict": "set"}, {"names": ("wheel_slip",)}, {"hidden": ("wheel_slip",)}, {"first": False}, {"alias": None},
    {"found": False}, {"p_value": 0.02}, {"error": 0.5001}, {"error": None},
    {"error": float("nan")}, {"strength": 20.001}, {"allowed": (0.9, 0.7, 0.85, 0.9)},
    {"allowed": None}, {"allowed": (0.9,)}], ids=str)
def test_whatever_else_is_otherwise_is_named(how: dict[str, Any]) -> None:
    (line,) = compare_gradings(WAS, changed(**how)).other
    (name, value), = how.items()
    assert line == f"{name} is {value!r}, was {getattr(MARK, name)!r}"


def test_what_was_said_with_further_shots_is_compared_too() -> None:
    assert compare_gradings(Graded("w1", MARK, MARK), WAS).other == ("with further shots: was marked only once",)
    (line,) = compare_gradings(Graded("w1", MARK, MARK), Graded("w1", MARK, structs.replace(MARK, verdict="set"))).other
    assert line == "with further shots: verdict is 'set', was 'named'"
