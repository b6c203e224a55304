"""A virtual rig with a bench on it, in memory and virtual time."""

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_records.result import CheckVerdict
from bench_sim.parameters import load
from bench_sim.parameters.effects import read_effect_text, with_effects
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import UNKNOWN, ordinary
from test_plans.run import PLAIN
from test_plans.specimen import read_specimen

NO_VALUE = {CheckVerdict.ERROR, CheckVerdict.NOT_AVAILABLE}


def explained(result):
    """Insist that each value of a plan of ours has an uncertainty, or is declared as one that has none; return it.

    And that each check has the sentence of one of those that the plan declares.
    """
    plain = [
        str(one)
        for one in result.checks
        if one.verdict not in NO_VALUE and one.u is None and one.without in {"", PLAIN}
    ]
    assert not plain
    if plan := plans().get(result.plan):
        declared = {one.about for one in plan.checks}
        assert [one.name for one in result.checks if one.about not in declared] == []
    return result


@contextmanager
def composed(seed=0, faults=None, latency=0.0, outward=None, **changes):
    memory = RigInMemory(Rig(load("astb").with_values(**changes), seed=seed))
    with memory.bench(faults=faults, outward=outward, seed=seed, latency=latency) as bench:
        bench.instruments = ordinary()
        yield SimpleNamespace(rig=memory.rig, clock=memory.clock, cut=memory.cut, bench=bench)


@pytest.fixture(scope="session")
def bench_composed():
    """A virtual rig with a connected bench: ``with bench_composed(seed, **changes) as made``."""
    return composed


@pytest.fixture(scope="session")
def sound_run(once):
    """Run a plan on a sound virtual rig, once for all tests: its result, curves by group and name, what it left."""

    def run(name, seed=0):
        def make(folder):
            with composed(seed) as made:
                before = made.rig.plant.parameters.copy()
                result = execute(plans()[name], made.bench, folder, rig="virtual", seed=seed)
                return SimpleNamespace(
                    result=result,
                    curves={
                        (one.group, one.name): (np.array(one.xs), np.array(one.ys)) for one in result.curves
                    },
                    directory=folder,
                    state=made.rig.state.name,
                    before=before,
                    after=made.rig.plant.parameters.copy(),
                )

        return once(f"{name} {seed}", make)

    return run


class After:
    """Does something once the bench's time has come."""

    def __init__(self, clock, seconds, act):
        self.task = clock.every(round(seconds * 1e9), self)
        self.act = act

    def __call__(self):
        self.task.cancel()
        self.act()


@pytest.fixture(scope="session")
def after():
    """Let something happen once the bench's time has come: ``after(clock, seconds, act)``."""
    return After


@pytest.fixture
def bench_run(tmp_path):
    """Run a plan on a fresh virtual rig; ``at=(seconds, act)`` lets something happen to it meanwhile."""

    def run(name, seed=0, *, at=None, faults=None, outward=None, latency=0.0, directory="out", **changes):
        with composed(seed, faults, latency, outward, **changes) as made:
            if at is not None:
                After(made.clock, at[0], lambda: at[1](made))
            result = explained(
                execute(plans()[name], made.bench, tmp_path / directory, rig="virtual", seed=seed)
            )
            return SimpleNamespace(
                result=result,
                failed={one.name for one in result.checks if not one.passed},
                directory=tmp_path / directory,
                state=made.rig.state.name,
                pressure=max(made.bench.left.bellows_pressure, made.bench.right.bellows_pressure),
            )

    return run


@pytest.fixture
def judged(tmp_path):
    """Run a plan with parameters on a bench with changes, effects and faults; return the result and what failed.

    A fault is a name, its values, and from when on (s) if not from the beginning.
    """

    def run(
        name, seed=1, *, given=(), effects=(), faults=(), instruments=UNKNOWN, specimen="astb", **changes
    ):
        parameters = load("astb").with_values(**changes)
        effects = {effect: read_effect_text(effect, text) for effect, text in effects}
        rig = Rig(with_effects(parameters, effects), seed=seed)
        for fault, values, *start in faults:
            rig.faults.plan(PlannedFault(fault, values, *(start or [0.0]), None))
        with RigInMemory(rig).bench(seed=seed) as bench:
            bench.instruments = instruments
            chosen = plans()[name].given(dict(given))
            springs = read_specimen(specimen)
            ran = execute(chosen, bench, tmp_path / name, rig="virtual", seed=seed, specimen=springs)
            result = explained(ran)
        return result, {one.name for one in result.checks if not one.passed}

    return run
