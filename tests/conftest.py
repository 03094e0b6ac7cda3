"""Where the shared recordings are, and what runs when they are not there."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("TRUEARC_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Directory of real recordings by others; a test that asks for it carries the `data` mark."""
    return DATA


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "data" in item.keywords and not DATA.is_dir():
            item.add_marker(pytest.mark.skip(reason="needs the shared recordings (TRUEARC_DATA)"))
        if "socketcan" in item.keywords and not Path("/sys/class/net/vcan0").exists():
            item.add_marker(pytest.mark.skip(reason="needs SocketCAN interface vcan0"))
