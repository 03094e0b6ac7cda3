"""Where the shared recordings are, what runs when they are not there, and how a whole run is spread over the cores.

Nothing of a test may reach another process: buses, ports and pseudo-terminals are its own, files go to tmp_path, and
the one real vcan0 belongs to one test at a time. `-n 0` runs everything in one process.
"""

import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

from tests import shape_checks

DATA = Path(os.environ.get("TRUEARC_DATA", Path(__file__).parents[2] / "shared" / "data"))
VCAN0 = Path("/sys/class/net/vcan0")
# Folders, files or tests (beginnings of their ids) that `make test-long` runs although no mark of theirs says so.
LONG = (
    "tests/house/test_benchmarks.py", "tests/loops/test_devices.py::test_a_device_that_fails_is_a_hold_that_says_why",
    "tests/proof/reproduce", "tests/proof/rivals/test_pysindy.py",
    "tests/robot/test_vision_tag.py::test_no_wrong_tag_among_distractors",
    "tests/robot/test_vision_spoilt.py::test_errors_are_as_large_as_sigma_says_when_it_is_told_of_turning",
    "tests/sim/data/test_import_logs.py::test_a_session_that_was_exported_is_read_with_its_poses_and_its_shots",
    "tests/sim/discover/test_example_term.py", "tests/sim/discover/test_not_seen.py",
    "tests/sim/discover/test_row_order.py",
    "tests/sim/discover/test_sessions.py::test_a_tracker_that_was_compared_is_said_to_be",
    "tests/sim/paper/test_grid_fit.py::test_labels_are_those_of_flying_every_point[251",
    "tests/sim/paper/test_sweep.py::test_the_door_writes_tables_picture_and_weights",
)
MOST_WORKERS = 4                      # each holds JAX and what it has compiled: a gigabyte

# Arrays of tests are small, threads that wait for work of theirs take it from other processes. A fresh run compiles
# more than it runs: XLA's older code generator does it in two thirds of the time. All this before NumPy is there.
FRUGAL = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
          "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false --xla_cpu_use_fusion_emitters=false "
                       "intra_op_parallelism_threads=1",
          # what one test has compiled, tests of other files, workers and commands need not compile again
          "JAX_COMPILATION_CACHE_DIR": str(Path(__file__).parents[1] / ".pytest_cache" / "xla"),
          "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.3"}
os.environ |= {name: value for name, value in FRUGAL.items() if name not in os.environ}

# Where nothing may write bytecode, every worker compiles all sources, and every command that a test starts does so
# again: two seconds of CPU time for each that imports JAX.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Tracing makes many small objects that stay: the usual threshold of 700 looks for rubbish among them all the time.
gc.set_threshold(50_000, 20, 20)

shape_checks.install()

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("house", deadline=None)
settings.register_profile("million", deadline=None, max_examples=1000)    # for tests/robot/gate/test_no_doubt_fires.py
settings.register_profile("mutants", deadline=None, max_examples=10, derandomize=True)
settings.load_profile("house")


@pytest.fixture(autouse=True)
def all_shapes_checked() -> None:
    """Each test checks the first calls of every function anew."""
    shape_checks.start_again()


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the emulated robot: two shots, both marked."""
    from truearc.cli.common import SHIPPED
    from truearc.robot.config.schema import load_config
    from truearc.sim.world.emulated_robot import emulate
    folder = tmp_path_factory.mktemp("recorded") / "plain"
    emulate(load_config(SHIPPED), folder, trials=2, seed=3)
    return folder


@pytest.fixture(scope="module", autouse=True)
def kept_out_of_garbage_collection() -> Iterator[None]:
    """What JAX has traced and compiled stays for the whole run: without this every collection looks through it."""
    yield
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Directory of real recordings by others; a test that asks for it carries the `data` mark."""
    return DATA


@pytest.fixture(autouse=sys.platform == "linux")
def same_share_of_the_machine() -> Iterator[None]:
    """No test leaves its worker in real time or on fewer cores: the tests after it would keep the others' waiting."""
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    yield
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


@contextmanager
def vcan0_alone() -> Iterator[None]:
    """What another worker's test sends would be heard: a lock on the interface's own folder lets one at a time pass."""
    import fcntl  # Linux alone has SocketCAN
    folder = os.open(VCAN0, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


@pytest.fixture(autouse=True)
def alone_on_vcan0(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test on SocketCAN has vcan0 to itself."""
    with vcan0_alone() if request.node.get_closest_marker("socketcan") else nullcontext():
        yield


@cache
def trouble_of_vcan0() -> str:
    """Why the host's vcan0 cannot carry a robot's frames in real time, "" where it can; measured once."""
    from tests.hw.host_speed import why_too_slow
    from truearc.hw.real.can_bus import open_can
    from truearc.hw.real.clock import MonotonicClock

    with vcan0_alone():
        near, far = (open_can("socketcan", "vcan0", 1_000_000, MonotonicClock()) for _ in range(2))
        try:
            return why_too_slow(near, far)
        finally:
            near.close()
            far.close()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A test in real time is skipped, and says so, where vcan0 is too slow: before a fixture has taken its minutes."""
    missing = any(mark.name == "skip" for mark in item.iter_markers())
    if item.get_closest_marker("fast_bus") and not missing and (why := trouble_of_vcan0()):
        pytest.skip(f"vcan0: {why}")


def check_mutated_copy() -> None:
    """Refuse to test mutants with a package from elsewhere, such as an editable install: all of them would survive."""
    import truearc.hw

    here, there = Path(__file__).resolve().parents[1], Path(truearc.hw.__file__).resolve()
    if here not in there.parents:
        raise pytest.UsageError(f"mutants: truearc.hw comes from {there.parent}; expected a copy below {here}")


def pytest_configure(config: pytest.Config) -> None:
    """What XLA has compiled every process may take (FRUGAL); what Numba has compiled each worker keeps to itself."""
    if "MUTANT_UNDER_TEST" in os.environ:
        check_mutated_copy()
    # a shell starts what runs behind it deaf to Ctrl-C; commands that tests start and end so must not inherit that
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker:
        # Numba names what it keeps by counting: two processes may give one name to code for different arguments
        os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).parents[1] / ".truearc_cache" / worker))


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A worker a core and one more for a whole run, since tests in real time mostly wait; files named by hand run in
    this process, which is there sooner."""
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    return min(len(os.sched_getaffinity(0)) + 1, MOST_WORKERS) if whole else 0


@pytest.hookimpl(tryfirst=True)       # before -m selects
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("data") and not DATA.is_dir():
            item.add_marker(pytest.mark.skip(reason="needs the shared recordings (TRUEARC_DATA)"))
        if item.get_closest_marker("socketcan") and not VCAN0.exists():
            item.add_marker(pytest.mark.skip(reason="needs SocketCAN interface vcan0"))
        if item.nodeid.startswith(LONG):
            item.add_marker("slow")
    # workers take files in this order: the long ones first, so that none of them runs alone at the end
    slow = {item.path for item in items if "slow" in item.keywords}
    items.sort(key=lambda item: item.path not in slow)
