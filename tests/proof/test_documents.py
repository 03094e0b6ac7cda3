"""Rounds on disk: seals, claims, the ledger, and one writer at a time."""

import hashlib
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc_proof import rounds
from truearc_proof.rounds import FIRST, SCHEMA, Room, alone, append, canonical, check_data, load_seal, make_seal
from truearc_proof.rounds.committer import asked_of

# --- documents

PLAIN = st.recursive(st.none() | st.booleans() | st.integers(-10**9, 10**9) | st.text(max_size=8)
                     | st.floats(allow_nan=False, allow_infinity=False),
                     lambda inner: (st.lists(inner, max_size=3)
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


@pytest.mark.parametrize(("change", "said"), [
    ({"asked": [{"measure": "the truth"}]}, "asked: measure: there is no 'the truth'"),
    ({"schema": "truearc.claims/3"}, r"w1\.json: Invalid enum value 'truearc\.claims/3'")])
def test_claims_that_cannot_be_read_are_refused(tmp_path: Path, change: dict[str, object], said: str) -> None:
    room = Room(tmp_path)
    room.claims("w1").parent.mkdir()
    claims = {"schema": SCHEMA, "data": {}, "finding": {"mismatch": {"found": True}, "verdict": "set"},
              "asked": [{"measure": "inclinometer"}]}
    room.claims("w1").write_bytes(canonical(claims))
    assert asked_of(room, "w1") == "inclinometer"
    room.claims("w1").write_bytes(canonical({**claims, **change}))
    with pytest.raises(InputError, match=said):
        asked_of(room, "w1")


# --- file lock

def test_a_second_writer_is_told_so_and_the_lock_goes_with_its_holder(tmp_path: Path) -> None:
    program = ("from pathlib import Path; from truearc_proof.rounds import alone\n"
               f"with alone(Path({str(tmp_path)!r})): pass")
    with alone(tmp_path):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert "is being played by another process" in done.stderr
    subprocess.run([sys.executable, "-c", program], check=True)
