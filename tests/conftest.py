"""What holds for all tests: which of them run with nothing beside them, and a garbage collector with little to do."""

import gc
from pathlib import Path

import pytest

#: What gives a test away that has deadlines; others say it themselves.
WIRES = Path(__file__).parent / "wires"
RIGS = {"site", "start_rig"}


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "real_time: holds deadlines of real time; `make test` runs nothing beside it"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark them before `-m` chooses."""
    for item in items:
        if item.path.is_relative_to(WIRES) or RIGS.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("real_time")


def pytest_collection_finish() -> None:
    """Set aside what exists now and stays: a thousand tests and all libraries, 0.2 s in each full collection."""
    gc.collect()
    gc.freeze()
