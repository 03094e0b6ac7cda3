"""Two clocks with one promise: sleep_until_ns returns once now_ns says so."""


import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.emulated.nodes import StepClock
from truearc.hw.real.clock import MonotonicClock


@given(times=st.lists(st.integers(0, 10**12), max_size=20))
def test_a_step_clock_advances_the_world_only_forward(times) -> None:
    seen: list[tuple[int, int]] = []
    clock = StepClock(lambda t_ns: seen.append((clock.now_ns(), t_ns)))
    for t_ns in times:
        clock.sleep_until_ns(t_ns)
        assert clock.now_ns() >= t_ns
    assert clock.now_ns() == max(times, default=0)
    assert all(before < after for before, after in seen)
    assert [after for _, after in seen] == [before for before, _ in seen[1:]] + [clock.now_ns()] * bool(seen)


@pytest.mark.parametrize("ahead_ns", [-1_000_000_000, 0, 3_000_000])
def test_the_machines_clock_keeps_absolute_deadlines(ahead_ns: int) -> None:
    clock = MonotonicClock()
    start_ns = clock.now_ns()
    clock.sleep_until_ns(start_ns + ahead_ns)
    assert clock.now_ns() >= start_ns + ahead_ns
    assert clock.now_ns() - start_ns < 500_000_000          # a deadline that is past costs nothing
