"""The paper's spring under both loads, its wind, and the virtual rig on which its plans run."""

import pytest

from astb_studies.paper.parameters import load_paper
from bench_protocol.clock import RealClock
from tests.plans.conftest import bench_composed, bench_run, judged, sound_run

__all__ = ["aw0", "aw3", "bench_composed", "bench_run", "judged", "quick_study", "sound_run", "wind"]


@pytest.fixture(scope="session")
def aw0():
    return load_paper("paper", "AW0").spring


@pytest.fixture(scope="session")
def aw3():
    return load_paper("paper", "AW3").spring


@pytest.fixture(scope="session")
def wind():
    return load_paper().wind


@pytest.fixture(scope="session")
def quick_study(once):
    """What `astb paper --quick` writes, once for all tests: its page, in a folder with all the rest."""
    return once("paper --quick", made_quickly)


def made_quickly(folder):
    from astb_studies.paper.make import make

    clock = RealClock()
    start = clock.now()
    written = make(folder, quick=True, seed=0)
    print(f"astb paper --quick took {(clock.now() - start) / 1e9:.0f} s")
    return written
