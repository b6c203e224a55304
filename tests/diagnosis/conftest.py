"""Systems with hidden effects: what the engine is tried on, hundreds of times where needed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from astb_studies import oscillator as system
from astb_studies.oscillator import Laboratory, ar1_noise
from diagnosis.contracts import Array, Surface


@pytest.fixture(scope="session")
def laboratory() -> Callable[..., Laboratory]:
    """Return the maker of laboratories."""
    return Laboratory


@pytest.fixture(scope="session")
def oscillator() -> Callable[..., system.Oscillator]:
    """Return the maker of oscillators."""
    return system.Oscillator


@pytest.fixture(scope="session")
def force_surface() -> Surface:
    """A force over (x, asinh v), which the oscillator takes as an unknown term."""
    return system.force_surface()


@pytest.fixture(scope="session")
def ar1() -> Callable[[np.random.Generator, int, float], Array]:
    """AR(1) noise of unit variance."""
    return ar1_noise


@pytest.fixture(scope="session")
def bench_record(tmp_path_factory):
    """Record stretches of motion on a virtual rig: ``directory`` of the record and the ``parameters`` without effects.

    ``effects`` are hidden in the rig, ``faults`` in what its CAN brings; the sensors' biases are drawn from the seed.
    """
    from types import SimpleNamespace

    from astb.rig_in_memory import RigInMemory
    from bench_sim.parameters import load
    from bench_sim.parameters.effects import with_effects
    from bench_sim.rig.rig import Rig
    from drivers.memory import Faults
    from test_plans.execution import execute
    from test_plans.loads import AW0
    from test_plans.programmes.motions import Part, Programme
    from test_plans.programmes.perform import programme_plan

    def make(name, stretches, *, effects=None, faults=None, seed=1, **changes):
        parameters = load("astb").with_values(**changes)
        rig = Rig(with_effects(parameters, effects or {}), seed=seed)
        directory = tmp_path_factory.mktemp(name)
        programme = Programme("short", "Short motions", (Part(AW0, tuple(stretches)),), "To be replayed.")
        with RigInMemory(rig).bench(faults=faults, outward=Faults(), seed=seed) as bench:
            result = execute(programme_plan(programme), bench, directory, seed=seed)
        assert result.verdict.value == "pass" or not stretches, result.reason
        return SimpleNamespace(directory=directory, parameters=parameters)

    return make
