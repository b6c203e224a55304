"""What holds for all tests: which run with nothing beside them, little to collect as garbage, one core for each."""

import gc
import os
import signal
from pathlib import Path

import pytest

# As `astb` does, and like it before numpy is loaded: tests and diagnoses use their cores themselves.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: What gives a test away that has deadlines; others say it themselves.
WIRES = Path(__file__).parent / "wires"
RIGS = {"site", "start_rig"}


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "real_time: holds deadlines of real time; `make test` runs nothing beside it"
    )
    # A suite started with `&` by a script is deaf to Ctrl-C, and so would be every rig and run that it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)


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
