"""The unmodified robot's session is worked out once a round, not by every worker that claims."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

import truearc as ta
from truearc.sim.infer.belief import as_table
from truearc_proof.rounds import Room, solver
from truearc_proof.rounds.worlds import MUJOCO, Drawn, make_data

BELIEVED = ta.Belief({"drag": {"k_per_m": 0.1 + 0.2}, "gravity": {"g_m_s2": 9.81}}, {"speed_rel": 0.01},
                     ("drag.k_per_m",), np.array([[1e-4 / 3]]))


@pytest.fixture
def worked_out(monkeypatch: pytest.MonkeyPatch) -> list[Room]:
    """Rooms whose session was worked out, in a solver that does not take minutes."""
    rooms: list[Room] = []
    monkeypatch.setattr(solver, "_believed_at_home", lambda room: (rooms.append(room), BELIEVED)[1])
    solver.at_home.cache_clear()
    return rooms


@pytest.fixture
def room(tmp_path: Path) -> Room:
    make_data(Drawn("home", MUJOCO, "clean", "L1", 6, 5, change="nothing"), Room(tmp_path).data("home"))
    return Room(tmp_path)


def test_what_was_kept_is_what_was_worked_out_to_the_last_bit(room: Room, worked_out: list[Room]) -> None:
    solver._keep_home(room)
    solver._keep_home(room)
    dataset, belief = solver.at_home(room)
    assert worked_out == [room] and len(dataset.shots.shot_id) == 6
    assert as_table(belief) == as_table(BELIEVED)


@pytest.mark.parametrize("key", ["solver", "data"])
def test_what_another_solver_kept_or_of_other_data_is_worked_out_again(room: Room, worked_out: list[Room],
                                                                       key: str) -> None:
    solver._keep_home(room)
    kept = msgspec.json.decode(room.home.read_bytes())
    room.home.write_bytes(msgspec.json.encode({**kept, key: "other"}))
    solver.at_home(room)
    solver._keep_home(room)
    assert worked_out == [room] * 3 and msgspec.json.decode(room.home.read_bytes()) == kept
