"""A round on a cluster whose one worker serves solver and keeper alike."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.proof import playing
from tests.proof.forging import ask
from truearc_proof.rounds.ledger import read_ledger
from truearc_proof.rounds.round_layout import Room

pytestmark = pytest.mark.slow
ARGUMENTS = ["--worlds", "2", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3"]
# In a process of its own: in one that holds a whole test session, distributed's own thread may starve.
CLUSTER = """
from distributed import LocalCluster
with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
    print(cluster.scheduler_address, flush=True)
    input()
"""


@pytest.fixture
def address() -> Iterator[str]:
    pytest.importorskip("distributed")
    cluster = subprocess.Popen([sys.executable, "-c", CLUSTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                               text=True)
    assert cluster.stdout is not None
    try:
        yield cluster.stdout.readline().strip()
    finally:
        cluster.communicate("\n", timeout=60)


def prove(room: Room, address: str, *more: str) -> None:
    done = subprocess.run([sys.executable, "-m", "truearc", "prove", *more, "--scheduler", address, "--quiet", "--out",
                           str(room.root)], capture_output=True, text=True, check=False, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_round_is_played_to_its_end_by_a_worker_that_is_refused_the_seals(address: str, tmp_path: Path) -> None:
    room = Room(tmp_path / "round")
    assert playing.prove(room.root, "seal", *ARGUMENTS).returncode == 0
    prove(room, address, "solve")
    ask(room, "w0002", [{"distance_m": 4.0, "hood_deg": 48.0, "motor_ratio": 0.55, "shots": 12}])
    prove(room, address, *ARGUMENTS, "--follow-up")
    assert [one.what for one in read_ledger(room.ledger) if one.world == "w0002"] == [
        "sealed", "claimed", "asked", "answered", "claimed again", "opened", "graded"]
    assert len(room.grades.read_bytes().splitlines()) == 2


def test_a_cluster_is_refused_where_none_is_used(tmp_path: Path) -> None:
    done = playing.prove(tmp_path / "round", "drive", "--shots", "60", "--seed", "1", "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 2 and "--scheduler: drive" in done.stderr
