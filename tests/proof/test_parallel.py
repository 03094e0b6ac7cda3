"""Fan-out: the same results in the same order whatever runs the jobs, and whoever dies on the way."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from truearc.errors import InputError
from truearc_proof.parallel import fan_out

JOBS = list(range(12))


def draw(seed):
    """A pure function of its job."""
    return np.random.default_rng(seed).normal(size=3)


def fail(job):
    raise ValueError(f"job {job} is wrong")


def die_once(folder, seed):
    """As draw, but the first process that is given seed 5 dies of it; `folder` has a file per call."""
    time.sleep(0.01)
    calls = len(list(folder.glob(f"{seed}.*")))
    (folder / f"{seed}.{calls}").touch()
    if seed == 5 and not calls:
        os._exit(1)
    return draw(seed)


def die(seed):
    os._exit(1)


EXPECTED = [np.random.default_rng(seed).normal(size=3) for seed in JOBS]


def same(results):
    return len(results) == len(EXPECTED) and all(np.array_equal(*pair) for pair in zip(results, EXPECTED, strict=True))


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs_and_progress_ends_at_one(workers):
    shown = []
    assert same(fan_out(draw, JOBS, workers=workers, progress=lambda done, note: shown.append(done)))
    assert len(shown) == len(JOBS) + 1 and shown[0] == 0.0 and shown[-1] == 1.0 and shown == sorted(shown)


@pytest.mark.parametrize("workers", [1, 2])
def test_each_result_is_kept_with_its_job_before_the_next(workers):
    kept = []
    found = fan_out(draw, JOBS, workers=workers, keep=lambda job, result: kept.append((job, result)))
    assert [job for job, _ in kept] == JOBS and same([result for _, result in kept]) and same(found)


def test_what_is_there_is_kept_where_a_later_job_fails():
    def fail_late(job):
        if job == JOBS[-1]:
            raise ValueError(job)
        return job
    kept = []
    with pytest.raises(ValueError, match=str(JOBS[-1])):
        fan_out(fail_late, JOBS, workers=1, keep=lambda job, result: kept.append(job))
    assert kept == JOBS[:-1]


def test_no_jobs_no_results():
    assert fan_out(draw, []) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_of_a_job_is_raised_as_it_is(workers):
    with pytest.raises(ValueError, match=r"job \d is wrong"):
        fan_out(fail, [1, 2, 3], workers=workers)


def test_a_process_that_dies_loses_nothing(tmp_path):
    kept = []
    assert same(fan_out(partial(die_once, tmp_path), JOBS, workers=2, keep=lambda job, result: kept.append(job)))
    assert (tmp_path / "5.1").exists() and kept == JOBS


def test_only_what_was_lost_with_a_process_is_run_again(tmp_path):
    fan_out(partial(die_once, tmp_path), JOBS, workers=2)
    again = {int(path.stem) for path in tmp_path.glob("*.1")}
    assert 5 in again and len(again) <= 3 and not again & {0, 1, 2}


def test_a_job_that_always_kills_its_process_is_told_not_tried_for_ever():
    with pytest.raises(InputError, match="killed 3 processes"):
        fan_out(die, [1, 2], workers=2)


def test_a_scheduler_that_is_not_there_is_told_within_seconds():
    pytest.importorskip("distributed")
    began = time.monotonic()
    with pytest.raises(InputError, match="no scheduler answers"):
        fan_out(draw, JOBS, scheduler="tcp://127.0.0.1:9", patience_s=1.0)
    assert time.monotonic() - began < 10.0


@pytest.mark.parametrize("address", ["nonsense://x", "tcp://127.0.0.1:none"])
def test_an_address_that_is_none_is_told(address):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="--scheduler"):
        fan_out(draw, JOBS, scheduler=address, patience_s=1.0)


def test_without_distributed_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"\./proof\[cluster\]"):
        fan_out(draw, JOBS, scheduler="tcp://127.0.0.1:8786")


class Cluster:
    """A scheduler and workers as processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen] = []
        self.file = folder / "scheduler.json"
        self._start("distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard",
                    "--scheduler-file", str(self.file))
        self._await(self.file.exists)
        self.address = json.loads(self.file.read_text(encoding="utf-8"))["address"]

    def add_worker(self) -> subprocess.Popen:
        name = f"w{len(self.processes)}"
        worker = self._start("distributed.cli.dask_worker", self.address, "--nthreads", "1", "--no-nanny",
                             "--no-dashboard", "--name", name, "--local-directory", str(self.folder / name))
        return worker

    def _start(self, module: str, *words: str) -> subprocess.Popen:
        log = (self.folder / f"{len(self.processes)}.log").open("wb")
        process = subprocess.Popen([sys.executable, "-m", module, *words], stdout=log, stderr=log, cwd=self.folder)
        self.processes.append(process)
        return process

    def _await(self, there) -> None:
        deadline = time.monotonic() + 60.0
        while not there():
            assert time.monotonic() < deadline, (self.folder / "0.log").read_text(encoding="utf-8")
            time.sleep(0.1)

    def close(self) -> None:
        for process in reversed(self.processes):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    pytest.importorskip("distributed")
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.close()


# A user's run is a fresh process; in one that holds a whole test session, distributed's own thread may starve.
OVER_DASK = """
import json, os, signal, sys
from distributed import Client
from truearc_proof.parallel import fan_out

address, worker, jobs = sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3])

def draw(seed):
    import time, numpy
    time.sleep(0.3)
    return numpy.random.default_rng(seed).normal(size=3)

with Client(address, timeout=30) as client:
    client.wait_for_workers(2, timeout=60)
killed = []

def kill_one(done, note):
    if done >= 0.25 and not killed:
        killed.append(done)
        os.kill(worker, signal.SIGKILL)

results = fan_out(draw, jobs, scheduler=address, progress=kill_one)
print(json.dumps({"killed_at": killed, "results": [list(each) for each in results]}))
"""


@pytest.mark.slow
def test_a_cluster_one_of_whose_workers_is_killed_gives_everything_and_the_same(cluster):
    workers = [cluster.add_worker(), cluster.add_worker()]
    said = subprocess.run([sys.executable, "-c", OVER_DASK, cluster.address, str(workers[0].pid), json.dumps(JOBS)],
                          capture_output=True, text=True, timeout=120)
    assert said.returncode == 0, said.stderr
    answer = json.loads(said.stdout)
    assert answer["killed_at"] and answer["killed_at"][0] < 0.6
    assert workers[0].wait(timeout=10) == -signal.SIGKILL
    assert same([np.array(each) for each in answer["results"]])
    assert same(fan_out(draw, JOBS, workers=2))


@pytest.mark.slow
def test_a_cluster_without_workers_is_told(cluster):
    with pytest.raises(InputError, match="no workers"):
        fan_out(draw, JOBS, scheduler=cluster.address, patience_s=2.0)
