"""Claims that somebody wrote who had seen the truth, the ledger made anew and all: only solving again can tell. (That
honest ones come out the same, test_both_engines has.)"""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.proof.forging import enter_otherwise
from tests.proof.playing import prove, quiet
from truearc_proof.rounds.archive import pack
from truearc_proof.rounds.commitment import canonical
from truearc_proof.rounds.grader import grade_round
from truearc_proof.rounds.ledger import digest
from truearc_proof.rounds.reproduce_claims import _unlike, compare_claims
from truearc_proof.rounds.round_layout import Room
from truearc_proof.rounds.solver import solver_id


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
    {"where": WHERE | {"stage": "launch"}}, {"where": WHERE | {"stage_probability": {"flight": 0.3, "launch": 0.7}}},
    {"where": WHERE | {"covariate": "ball_id"}}, {"where": WHERE | {"direction": "vertical"}},
    {"where": WHERE | {"inseparable": []}}], ids=str)
def test_whatever_marks_are_made_of_cannot_be_forged_unseen(tmp_path: Path, forged: dict[str, Any]) -> None:
    rooms = [Room(tmp_path / name) for name in ("was", "now", "same")]
    for room, change in zip(rooms, (forged, {}, {}), strict=True):
        room.claims("w0001").parent.mkdir(parents=True)
        room.claims("w0001").write_bytes(canonical({**CLAIMS, "finding": {**CLAIMS["finding"], **change}}))
    assert compare_claims(rooms[0], rooms[1], "w0001") and not compare_claims(rooms[1], rooms[2], "w0001")


@pytest.mark.parametrize(("was", "now", "lines"), [
    ({"p": 0.05, "set": ["drag"]}, {"p": 0.05 + 1e-8, "set": ["drag"]}, []),
    ({"p": 0.05}, {"p": 0.051}, ["claims p 0.05; solved again, it is 0.051"]),
    ({"found": True}, {"found": 1}, ["claims found True; solved again, it is 1"]),
    ({"set": ["drag"]}, {"set": ["drag", "wind_x"]}, ["claims set ['drag']; solved again, it is ['drag', 'wind_x']"]),
    ({"what": {"drag": [0.5, {"cd": {"value": 1.0}}]}}, {"what": {"drag": [0.5, {"cd": {"value": 1.1}}]}},
     ["claims what.drag[1].cd.value 1.0; solved again, it is 1.1"]),
    ({"believed": None}, {"believed": {}}, ["claims believed None; solved again, it is {}"])])
def test_every_difference_is_named_by_its_place(was: object, now: object, lines: list[str]) -> None:
    assert list(_unlike("", was, now)) == lines
