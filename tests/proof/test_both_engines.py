"""Rounds with both engines that a stranger checks, and a round that goes on."""

from pathlib import Path

import msgspec
import pytest

from tests.proof.playing import ask, prove, prove_apart
from truearc_proof.rounds import Room, read_ledger
from truearc_proof.rounds.grader import graded_of
from truearc_proof.rounds.worlds import MUJOCO, NUMPY

# --- both engines

pytestmark = pytest.mark.slow
ARGUMENTS = ["--worlds", "4", "--level", "L1", "--shots", "24", "--seed", "26", "--follow-up", "--processes", "1"]


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Room:
    room = Room(tmp_path_factory.mktemp("both") / "round")
    done = prove_apart(room.root, *ARGUMENTS)
    assert done.returncode == 0, done.stderr
    return room


def test_every_world_of_either_engine_is_sealed_before_and_opened_after_it_is_claimed(played: Room) -> None:
    entries = read_ledger(played.ledger)
    order = {step: [one.number for one in entries if one.what == step] for step in ("sealed", "claimed", "opened")}
    assert [len(numbers) for numbers in order.values()] == [5, 4, 4]        # MuJoCo's home is sealed, too
    assert max(order["sealed"]) < min(order["claimed"]) and max(order["claimed"]) < min(order["opened"])
    marks = [one.first for one in graded_of(played)]
    assert {one.engine for one in marks} == {NUMPY, MUJOCO}
    assert {(one.engine, one.kind) for one in marks} == {
        (NUMPY, "off"), (NUMPY, "dirty"), (MUJOCO, "one"), (MUJOCO, "clean")}


def test_marks_follow_from_claims_and_seals(played: Room) -> None:
    for mark in (one.first for one in graded_of(played)):
        claims = msgspec.json.decode(played.claims(mark.world).read_bytes())
        assert mark.found == (claims["finding"]["mismatch"]["p_value"] < 0.05)
        assert mark.allowed is None or 0.0 <= mark.allowed[0] <= 1.0
        assert (mark.off_m is not None) == mark.found          # adopted beliefs are put to the sealed season


def test_figures_are_there_as_a_page_and_as_json(played: Room) -> None:
    figures = msgspec.json.decode(played.figures.read_bytes())["L1, 24"]
    clean, dirty = figures["false alarms, clean"], figures["false alarms, dirty"]
    assert clean["value"] is None                              # the clean world is MuJoCo's, in a row of its own
    assert dirty["value"] in (0.0, 1.0) and dirty["low95"] <= dirty["value"] <= dirty["high95"]     # of one world
    page = played.report.read_text(encoding="utf-8")
    assert "MuJoCo, unchanged" in page and "heavy_ball" in page


def test_a_stranger_makes_data_claims_and_marks_again(played: Room, tmp_path: Path) -> None:
    packed = str(tmp_path / "round.tar.xz")
    assert prove(played.root, "pack", "--packed", packed).returncode == 0
    done = prove(tmp_path / "again", "check", "--packed", packed, "--worlds", "2", "--solve", "1", "--seed", "1",
                 "--processes", "1")
    assert done.returncode == 0 and "solved again from the data alone, and the same claimed" in done.stdout, done.stderr


# --- one world

ONE_WORLD = ["--worlds", "1", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3"]


def test_a_round_that_was_begun_is_played_to_its_end(tmp_path: Path) -> None:
    room = Room(tmp_path / "round")
    for words in (["seal", *ONE_WORLD], ["solve", "--quiet"]):
        done = prove(room.root, *words)
        assert done.returncode == 0, done.stderr
    ask(room, "w0001", [{"distance_m": 4.0, "hood_deg": 48.0, "motor_ratio": 0.55, "shots": 12}])
    done = prove(room.root, *ONE_WORLD, "--follow-up", "--quiet")
    assert done.returncode == 0, done.stderr
    assert [one.what for one in read_ledger(room.ledger)] == [
        "sealed", "claimed", "asked", "answered", "claimed again", "opened", "graded"]
    assert len(room.grades.read_bytes().splitlines()) == 1
