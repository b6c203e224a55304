"""Every way to lose the commander: the bench holds and is safe in the promised time; a part of the benchmark."""

import pickle

import numpy as np
import pytest

from astb_studies.benchmarks.cuts import CUTS, POWER, REAL_CUTS, Cut
from astb_studies.benchmarks.real_cuts import RealCuts
from astb_studies.benchmarks.time_to_safe import TELLING, TRANSPORT, rows
from astb_studies.benchmarks.virtual_cuts import virtual_cuts
from bench_protocol.rates import TICK
from bench_protocol.units import ms


def assert_in_time(kind: Cut, times: list[tuple[float, float]], transport: float) -> None:
    held, safe = np.array(times).T
    assert held.max() <= kind.hold_within + TICK + transport, held
    assert safe.max() <= kind.safe_within, safe


@pytest.mark.parametrize("kind", CUTS, ids=lambda kind: kind.name)
def test_in_virtual_time(kind: Cut) -> None:
    """A cut connection is reported to another process as an equal value of another type."""
    told = pickle.loads(pickle.dumps(kind))
    assert_in_time(kind, virtual_cuts(told, 3), TELLING if kind is POWER else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CUTS, ids=lambda kind: kind.name)
def test_twenty_times_in_virtual_time(kind: Cut) -> None:
    """The benchmark does it a hundred times each, and draws it."""
    assert_in_time(kind, virtual_cuts(kind, 20, seed=2), TELLING if kind is POWER else 0.0)


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.timeout(300)
def test_over_sockets() -> None:
    with RealCuts() as rig:
        for kind in REAL_CUTS:
            assert_in_time(kind, [rig.cut(kind)], TRANSPORT)


def test_what_is_never_safe_is_not_in_time() -> None:
    (held, safe) = rows({POWER: np.array([[50 * ms, np.nan], [5 * ms, 3.0]])}, "virtual", 0.0)
    assert (held.met, safe.met) == (True, False)
