"""Jobs in threads: results in their order, what is new first and alone, errors told."""

import threading
import time

import pytest

from truearc.sim.compute import each_core


def test_results_come_in_the_order_of_the_jobs() -> None:
    def late(job: int) -> int:
        time.sleep(0.01 * (5 - job))
        return job * job

    assert each_core(late, range(5), "squares") == each_core(late, range(5), "squares") == [0, 1, 4, 9, 16]
    assert each_core(late, [], "none") == []


def test_what_is_compiled_first_is_done_alone_and_once() -> None:
    alone: list[str] = []

    def who(job: int) -> None:
        alone.append(threading.current_thread().name)

    each_core(who, range(4), "new code")
    assert alone[0] == threading.current_thread().name and len(alone) == 4
    assert all(name.startswith("each-core") for name in alone[1:])
    alone.clear()
    each_core(who, range(4), "new code")
    assert all(name.startswith("each-core") for name in alone)


def test_an_error_of_a_job_is_raised() -> None:
    def bad(job: int) -> float:
        return 1.0 / (job - 3)

    with pytest.raises(ZeroDivisionError):
        each_core(bad, range(5), "divide")
