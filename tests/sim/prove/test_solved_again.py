"""Claims that somebody wrote who had seen the truth, the ledger made anew and all: only solving again can tell. (That
honest ones come out the same, test_both_engines has.)"""


import msgspec
import pytest

from sim.prove.ledger import digest
from sim.prove.opener import grade_round
from sim.prove.packed import pack
from sim.prove.room import Room
from sim.prove.seal import canonical
from sim.prove.solved_again import _unlike
from sim.prove.solver import solver_id
from tests.sim.prove.forging import enter_otherwise
from tests.sim.prove.playing import prove, quiet


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
