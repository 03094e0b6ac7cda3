"""The chain from sealed recordings to what gates score, once for real, and a gate that was put in afterwards."""

import shutil
from pathlib import Path

import pytest

from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.cli.prove_roles import LEVEL, NO_GATE, SIDES, Driven, driven_table, play_driven, room_of
from truearc_proof.rounds import load_seal, read_ledger
from truearc_proof.rounds.committer import RoundPlan

pytestmark = pytest.mark.slow
RECORDED, TRIALS = 20, 2
PLAN = RoundPlan(5, 1, LEVEL, RECORDED, ("mujoco",))


def quiet(done: float, note: str) -> None:
    pass


def play(root: Path) -> list[Driven]:
    return play_driven(root, PLAN, TRIALS, quiet, 1)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("drive") / "round"
    play(root)
    return root


def test_gates_are_learnt_before_the_seal_is_opened_and_driven_after_it(played: Path) -> None:
    room = room_of(played)
    assert [entry.what for entry in read_ledger(room.ledger)] == ["sealed", "claimed", "opened", "graded"]
    assert 0.8 * RECORDED < len(load_dataset(room.data("r0001")).shots) <= RECORDED
    (driven,) = play(played)                         # all is there: nothing is played again
    assert len(read_ledger(room.ledger)) == 4
    assert driven.change == load_seal(room.seal("r0001")).world["change"]
    assert set(driven.scored) == {NO_GATE, *SIDES}
    assert all(0 <= threes <= fired <= TRIALS for threes, fired in driven.scored.values())
    assert driven.scored[NO_GATE][1] >= TRIALS - 1   # without a gate the driver's button fires; one may be lost
    assert driven_table([driven]).rows[-1][0] == "together"


def test_a_gate_that_is_not_the_one_that_was_claimed_is_not_driven_with(played: Path, tmp_path: Path) -> None:
    shutil.copytree(played, tmp_path / "round")
    room = room_of(tmp_path / "round")
    room.ledger.write_bytes(b"".join(room.ledger.read_bytes().splitlines(keepends=True)[:2]))      # not opened yet
    room.grades.unlink()
    with (room.root / "gates" / "r0001" / "after.onnx").open("ab") as file:
        file.write(b"x")
    with pytest.raises(InputError, match=r"after\.onnx: is not what was claimed"):
        play(tmp_path / "round")
    assert len(read_ledger(room.ledger)) == 2
