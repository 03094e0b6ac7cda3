"""A round as it is played, and played to its end: made once, copied for whoever spoils it."""

import os
import shutil
import time
from pathlib import Path

import pytest

from tests.proof.playing import ARGUMENTS, prove, prove_apart, quiet
from truearc.errors import InputError
from truearc_proof.rounds import Room, alone
from truearc_proof.rounds.grader import grade_round


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Room:
    """Sealed and claimed; nothing opened yet. All workers have one: the first that needs it plays it, others wait."""
    worker = "PYTEST_XDIST_WORKER" in os.environ
    shared = (tmp_path_factory.getbasetemp().parent if worker else tmp_path_factory.mktemp("prove")) / "played"
    shared.mkdir(exist_ok=True)
    while not (shared / "whole").exists():
        try:
            with alone(shared):
                if not (shared / "whole").exists():
                    shutil.rmtree(shared / "round", ignore_errors=True)
                    play(Room(shared / "round"))
                    (shared / "whole").touch()
        except InputError:            # another worker is at it
            time.sleep(0.2)
    return Room(shared / "round")


def play(room: Room) -> None:
    """The solver has a process of its own: one that has solved may open no seal any more."""
    sealed = prove(room.root, "seal", *ARGUMENTS)
    assert sealed.returncode == 0, sealed.stderr
    solved = prove_apart(room.root, "solve", "--processes", "1")
    assert solved.returncode == 0, solved.stderr


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
