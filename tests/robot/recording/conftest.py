"""Sessions of the emulated robot, recorded from fixed seeds: they are small, and the same on every run."""

import shutil
from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.faulty_robot import parts_with
from tests.robot.gate.test_model import build
from tests.robot.good_tick import CONFIG
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.world.faults import SILENT, TRUNCATED, Fault

SECOND = 1_000_000_000


@pytest.fixture(scope="session")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Torn frames for a while, then a camera that is gone."""
    folder = tmp_path_factory.mktemp("recorded") / "faulty"
    config = replace(CONFIG, gate=replace(CONFIG.gate, request_s=2.0))
    emulate(config, folder, trials=1, seed=5, **parts_with({
        "flywheel_a": (Fault(TRUNCATED, SECOND, 2 * SECOND, length=4),), "camera": (Fault(SILENT, SECOND, 1 << 62),)}))
    return folder


@pytest.fixture(scope="session")
def gated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gate of random weights, which lets nothing through."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "gate.onnx").write_bytes(build())
    config = replace(CONFIG, gate=replace(CONFIG.gate, request_s=3.0, doubt_s=0.2, threshold=1.0))
    emulate(config, folder / "gated", trials=1, seed=4, gate_path=folder / "gate.onnx")
    return folder / "gated"


@pytest.fixture
def session(plain: Path, tmp_path: Path) -> Path:
    """A copy of the plain one, to be changed."""
    return shutil.copytree(plain, tmp_path / "s")
