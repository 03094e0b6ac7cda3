"""A round as it is played, and played to its end: made once, copied for whoever spoils it."""

import shutil
from pathlib import Path

import pytest

from tests.proof.playing import ARGUMENTS, prove_apart, quiet
from truearc_proof.rounds.grader import grade_round
from truearc_proof.rounds.round_layout import Room


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Room:
    """Sealed and claimed; nothing opened yet."""
    room = Room(tmp_path_factory.mktemp("prove") / "round")
    for role in (["seal", *ARGUMENTS], ["solve", "--processes", "1"]):
        done = prove_apart(room.root, *role)
        assert done.returncode == 0, done.stderr
    return room


@pytest.fixture
def room(played: Room, tmp_path: Path) -> Room:
    """A copy of it, to be spoilt."""
    shutil.copytree(played.root, tmp_path / "round")
    return Room(tmp_path / "round")


@pytest.fixture(scope="session")
def marked(played: Room, tmp_path_factory: pytest.TempPathFactory) -> Room:
    """Played to its end."""
    room = Room(tmp_path_factory.mktemp("marked") / "round")
    shutil.copytree(played.root, room.root)
    grade_round(room, quiet, 1)
    return room


@pytest.fixture
def done(marked: Room, tmp_path: Path) -> Room:
    """A copy of it, to be spoilt."""
    shutil.copytree(marked.root, tmp_path / "done")
    return Room(tmp_path / "done")
