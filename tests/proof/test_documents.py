"""Rounds on disk: seals, somebody else's world, claims, the ledger, one writer at a time, and a round in one file."""

import hashlib
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.proof.playing import enter_otherwise, leave_world_out, make_mark_kinder, prove, quiet
from truearc.cli.main import main
from truearc.errors import InputError
from truearc_proof import rounds
from truearc_proof.rounds import (
    FIRST,
    SCHEMA,
    Room,
    alone,
    append,
    canonical,
    check_data,
    digest,
    load_claims,
    load_seal,
    make_seal,
    save_seal,
)
from truearc_proof.rounds.archive import check_round, compare_gradings, pack, unpack
from truearc_proof.rounds.committer import seal_own
from truearc_proof.rounds.grader import Graded, grade_round, graded_of
from truearc_proof.rounds.marks import Mark
from truearc_proof.rounds.solver import solver_id
from truearc_proof.rounds.worlds import Drawn, make_data

PLAIN = st.recursive(st.none() | st.booleans() | st.integers(-10**9, 10**9) | st.text(max_size=8)
                     | st.floats(allow_nan=False, allow_infinity=False), lambda inner: (st.lists(inner, max_size=3)
                                    | st.dictionaries(st.text(max_size=5), inner, max_size=3)), max_leaves=8)
WORLDS = st.dictionaries(st.text(max_size=5), PLAIN, max_size=4)


@given(WORLDS)
def test_canonical_text_is_the_same_for_the_same_world(world):
    turned = dict(reversed(world.items()))
    assert canonical(world) == canonical(turned)
    assert msgspec.json.decode(canonical(world)) == world


def test_canonical_text_is_json_as_anybody_would_hash_it():
    assert canonical({"b": 0.1, "a": [1, None, "ü"]}) == b'{"a":[1,null,"\\u00fc"],"b":0.1}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical({"a": float("nan")})


@settings(max_examples=25)
@given(WORLDS, st.binary(min_size=32, max_size=32))
def test_a_seal_comes_back_from_disk_with_its_commitment(tmp_path_factory, world, salt):
    folder = tmp_path_factory.mktemp("seal")
    (folder / "data").mkdir()
    (folder / "data" / "shots.csv").write_bytes(b"1,2\n")
    seal, other = (make_seal(world, "numpy 1", folder / "data", *how) for how in ((salt,), ()))
    assert seal.commitment != other.commitment and len(bytes.fromhex(other.salt)) == 32
    rounds.save_seal(folder / "seal.json", seal)
    again = load_seal(folder / "seal.json")
    assert again == seal and again.commitment == seal.commitment
    assert seal.data == {"shots.csv": hashlib.sha256(b"1,2\n").hexdigest()}


@settings(max_examples=60)
@given(st.data())
def test_any_changed_byte_of_the_data_is_found_and_its_file_named(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("data")
    files = {"rig.toml": b"[ball]\n", "shots.csv": b"a,b\n1,2\n", "more/tracks.csv": b"x\n"}
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(text)
    seal = make_seal({}, "numpy 1", folder)
    assert check_data(seal, folder) == []
    name = data.draw(st.sampled_from(sorted(files)))
    text = bytearray(files[name])
    text[data.draw(st.integers(0, len(text) - 1))] ^= data.draw(st.integers(1, 255))
    (folder / name).write_bytes(text)
    (problem,) = check_data(seal, folder)
    assert str(folder / name) in problem


def test_missing_and_added_files_are_named(tmp_path):
    (tmp_path / "a").write_bytes(b"1")
    seal = make_seal({}, "numpy 1", tmp_path)
    (tmp_path / "a").rename(tmp_path / "b")
    missing, added = check_data(seal, tmp_path)
    assert "missing" in missing and str(tmp_path / "a") in missing
    assert "not among" in added and str(tmp_path / "b") in added


@pytest.mark.parametrize("text", ["", "[]", '{"world": {}}',
                                  '{"world": {}, "maker": "x", "data": {}, "salt": "", "y": 1}',
                                  '{"world": {"a": 1e999}, "maker": "x", "data": {}, "salt": ""}'])
def test_what_is_no_seal_is_refused(tmp_path, text):
    (tmp_path / "seal.json").write_text(text)
    with pytest.raises(InputError, match=r"seal\.json"):
        load_seal(tmp_path / "seal.json")


def make_ledger(path: Path) -> list[bytes]:
    for world in ("w1", "w2"):
        for step in ("sealed", "claimed", "opened", "graded"):
            append(path, step, world, hashlib.sha256(f"{world} {step}".encode()).hexdigest())
    return path.read_bytes().split(b"\n")[:-1]


def test_a_ledger_is_a_chain_of_hashes(tmp_path):
    lines = make_ledger(tmp_path / "ledger.jsonl")
    entries = rounds.read_ledger(tmp_path / "ledger.jsonl")
    assert [entry.number for entry in entries] == list(range(1, 9))
    assert [entry.before for entry in entries] == [FIRST, *(hashlib.sha256(line).hexdigest() for line in lines[:-1])]
    assert rounds.committed(entries, "w2")["claimed"] == hashlib.sha256(b"w2 claimed").hexdigest()


@settings(max_examples=60)
@given(st.data())
def test_a_changed_ledger_is_broken(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("ledger") / "ledger.jsonl"
    lines = make_ledger(path)
    number = data.draw(st.integers(0, len(lines) - 2))             # but the last, which nothing follows yet
    what = data.draw(st.sampled_from(["drop", "double", "swap", "flip"]))
    if what == "drop":
        del lines[number]
    elif what == "double":
        lines.insert(number, lines[number])
    elif what == "swap":
        lines[number], lines[number + 1] = lines[number + 1], lines[number]
    else:
        line = bytearray(lines[number])
        line[data.draw(st.integers(0, len(line) - 1))] ^= data.draw(st.integers(1, 127))
        lines[number] = bytes(line)
    path.write_bytes(b"\n".join(lines) + b"\n")
    with pytest.raises(InputError, match=r"ledger\.jsonl: line"):
        rounds.read_ledger(path)


def test_a_line_torn_by_a_kill_is_no_line_and_the_next_takes_its_place(tmp_path):
    path = tmp_path / "ledger.jsonl"
    lines = make_ledger(path)
    path.write_bytes(b"\n".join(lines[:3]) + b"\n" + lines[3][:20])
    assert len(rounds.read_ledger(path)) == 3
    append(path, "graded", "w1", "0" * 64)
    assert [entry.what for entry in rounds.read_ledger(path)] == ["sealed", "claimed", "opened", "graded"]


@pytest.mark.parametrize("steps", [("sealed", "opened", "claimed"), ("sealed", "sealed")])
def test_a_claim_after_the_seal_was_opened_counts_for_nothing(tmp_path, steps):
    for step in steps:
        append(tmp_path / "ledger.jsonl", step, "w1", "0" * 64)
    with pytest.raises(InputError, match="w1 is"):
        rounds.committed(rounds.read_ledger(tmp_path / "ledger.jsonl"), "w1")


def test_claims_of_another_schema_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w1.json"
    claims = {"schema": SCHEMA, "data": {}, "finding": {"mismatch": {"found": True}, "verdict": "set"},
              "asked": [{"measure": "inclinometer"}]}             # a key of older claims
    path.write_bytes(canonical(claims))
    assert load_claims(path).finding["verdict"] == "set"
    path.write_bytes(canonical({**claims, "schema": "truearc.claims/3"}))
    with pytest.raises(InputError, match=r"w1\.json: schema: .*truearc\.claims/3"):
        load_claims(path)


def test_steps_of_older_rounds_are_read(tmp_path: Path) -> None:
    """In which solvers had asked for further shots."""
    path, older = tmp_path / "ledger.jsonl", ("sealed", "claimed", "asked", "answered", "claimed again", "opened")
    for step in older:
        append(path, step, "w1", "0" * 64)
    assert tuple(rounds.committed(rounds.read_ledger(path), "w1")) == older


def test_a_second_writer_is_told_so_and_the_lock_goes_with_its_holder(tmp_path: Path) -> None:
    program = ("from pathlib import Path; from truearc_proof.rounds import alone\n"
               f"with alone(Path({str(tmp_path)!r})): pass")
    with alone(tmp_path):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert "is being played by another process" in done.stderr
    subprocess.run([sys.executable, "-c", program], check=True)


DOCS = Path(__file__).parents[2] / "docs" / "how-to" / "challenge.md"
WIND: dict[str, Any] = {"kind": "one", "effects": {"wind_x": 2.0}}


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("own") / "challenge"
    make_data(Drawn("challenge", "numpy", "clean", "L0", 12, 5), directory)
    return directory


def seal(folder: Path, truth: dict[str, Any], data: Path) -> str:
    (folder / "truth.json").write_bytes(msgspec.json.encode(truth))
    return seal_own(Room(folder / "round"), folder / "truth.json", data)


@pytest.mark.parametrize(("truth", "said"), [
    ({"kind": "one"}, "effects: there are 0; kind 'one' has 1"),
    ({"kind": "one", "effects": {"wind_x": 1.0, "wind_y": 1.0}}, "effects: there are 2"),
    ({"kind": "clean", "effects": {"wind_x": 1.0}}, "effects: there are 1; kind 'clean' has none"),
    ({"kind": "off"}, "kind 'off' has 1 or more"),
    ({"kind": "one", "effects": {"windx": 1.0}}, "windx: the catalogue has no such term"),
    ({"kind": "one", "effects": {"gravity": 1.0}}, "gravity: claims about this term cannot be marked"),
    ({"kind": "off", "effects": {"wind_x": 1.0}}, "wind_x: is in the catalogue"),
    ({"kind": "one", "effects": {"wind_x": 0.0}}, "wind_x: 0 is nothing"),
    ({"kind": "one", "effects": ["wind_x"]}, r"effects"),
    ({"effects": {"wind_x": 1.0}}, "kind")])
def test_a_truth_that_can_never_be_marked_is_refused_by_file_and_key(tmp_path, shots, truth, said):
    with pytest.raises(InputError, match=rf"truth\.json: .*{said}"):
        seal(tmp_path, truth, shots)
    assert not (tmp_path / "round").exists()


def test_reserved_names_too_few_shots_and_nothing_to_believe_are_refused(tmp_path: Path, shots: Path) -> None:
    shutil.copytree(shots, tmp_path / "home")
    with pytest.raises(InputError, match="home: a world cannot be called 'home'"):
        seal(tmp_path, WIND, tmp_path / "home")
    for name in ("few", "blank"):
        shutil.copytree(shots, tmp_path / name)
    table = tmp_path / "few" / "shots.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:8]))
    with pytest.raises(InputError, match=r"shots\.csv: 7 shots; discovery takes 10 at least"):
        seal(tmp_path, WIND, tmp_path / "few")
    facts = tmp_path / "blank" / "rig.toml"
    facts.write_text(re.sub(r"(?ms)^\[believe\]\n.*?(?=^\[|\Z)", "", facts.read_text()) + "\n[believe]\nterms = []\n")
    with pytest.raises(InputError, match=r"rig\.toml: believe: terms"):
        seal(tmp_path, WIND, tmp_path / "blank")


def test_a_kill_between_the_ledger_and_the_data_is_made_good_with_the_sealed_data_alone(tmp_path, shots):
    room = Room(tmp_path / "round")
    told = seal(tmp_path, WIND, shots)
    shutil.rmtree(room.data("challenge"))        # entered, and not given away yet
    other = tmp_path / "other" / "challenge"
    shutil.copytree(shots, other)
    (other / "notes.txt").touch()
    with pytest.raises(InputError, match=r"notes\.txt: was not among the sealed data"):
        seal(tmp_path, WIND, other)
    assert not room.data("challenge").exists()
    assert seal(tmp_path, WIND, shots) == told and room.steps() == {"challenge": {"sealed": told}}
    assert room.data("challenge").is_dir()


def test_the_line_by_which_anybody_checks_a_seal_gives_the_number_that_was_told(tmp_path: Path, shots: Path) -> None:
    told = seal(tmp_path, WIND, shots)
    (program,) = re.findall(r"python -c '(.*)' round/keeper/challenge\.json", DOCS.read_text(encoding="utf-8"))
    done = subprocess.run([sys.executable, "-c", program, "round/keeper/challenge.json"], cwd=tmp_path,
                          capture_output=True, text=True, check=True)
    assert done.stdout.strip() == told


# --- a round in one file: whoever unpacks it makes the same worlds again, and finds whatever was changed or left out

MARK = Mark("w1", "numpy", "one", "L1", 300, ("wind_x",), True, 0.01, "named", ("wind_x",), 1, True, True, True,
            True, None, True, 0.5, (0.9,), None, ("wind_x",))
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
    assert "at most 0 (error), 0 (off_m), 0 (allowed)." in said
    assert main(words) == 2 and "is there already" in capsys.readouterr().err


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
    enter_otherwise(room, "w0001", {"sealed": seal.commitment, "claimed": digest(room.claims("w0001").read_bytes())})
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
            unpacked, worlds, quiet, seed, lambda *some: [], lambda root, drawn: marks[drawn.name]).remade

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
@pytest.mark.parametrize(("solver", "told"), [
    (solver_id(), "w0001.json: solved again, its p_value is "),
    ("f" * 64, f"this one is {solver_id()[:16]}: check that commit out")], ids=["this solver", "another"])
def test_forged_claims_pass_every_hash_and_are_named_when_solved_again(room: Room, solver: str, told: str) -> None:
    forge(room, "w0001", solver)
    code, said = check(room, "--solve", "1")
    assert code == 2 and told in said, said


def otherwise(**how: Any) -> Graded:
    return Graded("w1", structs.replace(MARK, **how))


def test_last_digits_and_the_luck_of_the_draw_are_told_and_are_no_change() -> None:
    other, off = compare_gradings(WAS, otherwise(error=float(np.nextafter(0.5, 1.0)), allowed=(0.87,)))
    assert other == ()
    assert off["allowed"] == pytest.approx(0.03) and 0.0 < off["error"] < 1e-15


@pytest.mark.parametrize("how", [
    {"verdict": "set"}, {"names": ("wheel_slip",)}, {"hidden": ("wheel_slip",)}, {"first": False}, {"alias": None},
    {"found": False}, {"p_value": 0.02}, {"error": 0.5001}, {"error": None},
    {"error": float("nan")}, {"allowed": (0.8,)}, {"allowed": None}, {"allowed": (0.9, 0.8)}], ids=str)
def test_whatever_else_is_otherwise_is_named(how: dict[str, Any]) -> None:
    (line,) = compare_gradings(WAS, otherwise(**how)).other
    (name, value), = how.items()
    assert line == f"{name} is {value!r}, was {getattr(MARK, name)!r}"
