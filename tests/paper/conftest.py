"""The paper's spring under both loads, and its wind."""

import pytest

from bench_sim.parameters.paper import load_paper


@pytest.fixture(scope="session")
def aw0():
    return load_paper("paper", "AW0").spring


@pytest.fixture(scope="session")
def aw3():
    return load_paper("paper", "AW3").spring


@pytest.fixture(scope="session")
def wind():
    return load_paper().wind
