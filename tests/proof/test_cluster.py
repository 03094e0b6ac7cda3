"""A round on a cluster whose one worker serves solver and keeper alike."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.proof.forging import ask
from tests.proof.playing import prove
from truearc_proof.rounds import Room, read_ledger

pytestmark = pytest.mark.slow
ARGUMENTS = ["--worlds", "1", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3"]
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


def test_a_round_is_played_to_its_end_by_a_worker_that_is_refused_the_seals(address: str, tmp_path: Path) -> None:
    room, by_cluster = Room(tmp_path / "round"), ("--scheduler", address, "--quiet")
    for words in (["seal", *ARGUMENTS], ["solve", *by_cluster]):
        done = prove(room.root, *words)
        assert done.returncode == 0, done.stderr
    ask(room, "w0001", [{"distance_m": 4.0, "hood_deg": 48.0, "motor_ratio": 0.55, "shots": 12}])
    done = prove(room.root, *ARGUMENTS, "--follow-up", *by_cluster)
    assert done.returncode == 0, done.stderr
    assert [one.what for one in read_ledger(room.ledger)] == [
        "sealed", "claimed", "asked", "answered", "claimed again", "opened", "graded"]
    assert len(room.grades.read_bytes().splitlines()) == 1


def test_a_cluster_is_refused_where_none_is_used(tmp_path: Path) -> None:
    done = prove(tmp_path / "round", "drive", "--shots", "60", "--seed", "1", "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 2 and "--scheduler: drive" in done.stderr
