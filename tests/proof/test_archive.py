"""A round in one file: whoever unpacks it makes the same worlds again, and finds whatever was changed or left out."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from tests.proof.forging import enter_otherwise, leave_world_out, make_mark_kinder
from truearc.cli.main import main
from truearc.errors import InputError
from truearc_proof.rounds.archive import check_round, pack, unpack
from truearc_proof.rounds.commitment import canonical, load_seal, save_seal
from truearc_proof.rounds.grader import graded_of
from truearc_proof.rounds.ledger import digest
from truearc_proof.rounds.round_layout import Room

pytestmark = pytest.mark.slow


def quiet(done: float, note: str) -> None:
    pass


@pytest.fixture(scope="module")
def packed(marked: Room, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("packed") / "round.tar.xz"
    pack(marked, path)
    return path


@pytest.fixture
def room(packed: Path, tmp_path: Path) -> Room:
    room = Room(tmp_path / "again")
    unpack(packed, room)
    return room


def test_the_same_data_are_made_again_from_the_seals_alone(packed: Path, tmp_path: Path, capsys) -> None:
    words = ["prove", "check", "--quiet", "--packed", str(packed), "--out", str(tmp_path / "again")]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "3 worlds were sealed, 3 marked" in said and "3 worlds made again" in said
    assert "at most 0 (strength), 0 (error), 0 (oracle_gain), 0 (off_m), 0 (allowed), 0 (random)." in said
    assert main(words) == 2 and "is there already" in capsys.readouterr().err


def test_a_round_that_is_not_marked_is_not_packed(played: Room, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="w0001, w0002, w0003: not marked yet"):
        pack(played, tmp_path / "early.tar.xz")


def test_packing_twice_gives_the_same_file(room: Room, packed: Path, tmp_path: Path) -> None:
    pack(room, tmp_path / "twice.tar.xz")
    assert (tmp_path / "twice.tar.xz").read_bytes() == packed.read_bytes()


def change_claims(room: Room) -> str:
    path = room.claims("w0001")
    path.write_bytes(path.read_bytes().replace(b"verdict", b"Verdict", 1))
    return "w0001.json: is not what was claimed"


def change_marks(room: Room) -> str:
    make_mark_kinder(room, 0)
    return "w0001 is not marked as the ledger has it"


def change_seal(room: Room) -> str:
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


@pytest.mark.parametrize("cheat", [change_claims, change_marks, forge_marks, change_seal, leave_out, choose_data])
def test_whatever_was_changed_or_left_out_is_named(room: Room, cheat: Callable[[Room], str]) -> None:
    expected = cheat(room)
    assert any(expected in line for line in check_round(room, 3, quiet).wrong)      # all that there are


def test_what_is_no_packed_round_is_refused(tmp_path: Path, capsys) -> None:
    (tmp_path / "no.tar.xz").write_bytes(b"no")
    words = ["prove", "check", "--packed", str(tmp_path / "no.tar.xz"), "--out", str(tmp_path / "again")]
    assert main(words) == 2
    assert "no.tar.xz" in capsys.readouterr().err
    assert main(["prove", "pack", "--out", str(tmp_path / "nothing"), "--packed", "x"]) == 2
    assert "ledger.jsonl: is missing" in capsys.readouterr().err


def test_which_worlds_are_made_again_nobody_knows_beforehand(room: Room) -> None:
    """Of three worlds one is made again: not always the same, and the same by the same seed."""
    marks = {one.world: one for one in graded_of(room)}

    def remade(worlds: int, seed: int | None = None) -> tuple[str, ...]:
        return check_round(room, worlds, quiet, seed, lambda *some: [], lambda root, job: marks[job[0].name]).remade

    assert {remade(1) for _ in range(60)} == {("w0001",), ("w0002",), ("w0003",)}
    assert remade(1, 7) == remade(1, 7)
    assert remade(9, 7) == ("w0001", "w0002", "w0003")
