"""benchmarks/loop.py --lateness: which late ticks the machine is to blame for."""

import numpy as np

from benchmarks.loop_lateness import judge

MS = 1_000_000


def test_a_tick_is_excused_when_a_bare_loop_was_late_for_half_of_its_time():
    came = np.array([5, 10, 22, 25, 30, 47]) * MS
    late = np.array([0, 0, 7, 5, 0, 12]) * MS
    stalls = np.array([[16, 21], [46, 51], [90, 99]]) * MS
    told = judge(came, late, 5 * MS, stalls, 30.0, [])
    assert (told.missed, told.excused) == (3, 1)
    assert sorted(told.stalls_us) == [5000.0, 5000.0]          # the third came after the last tick


def test_without_bare_loops_nothing_is_excused():
    told = judge(np.array([5, 15]) * MS, np.array([0, 5]) * MS, 5 * MS, np.zeros((0, 2), np.int64), 30.0, [])
    assert (told.missed, told.excused, len(told.stalls_us)) == (1, 0, 0)
