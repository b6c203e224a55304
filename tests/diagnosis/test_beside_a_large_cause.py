"""A second cause that makes a much larger one look unphysical is found with it."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

import numpy as np
import pytest

from diagnosis.contracts import (
    Array,
    Channel,
    CompleteSimulator,
    Dataset,
    Effects,
    Experiment,
    Hypothesis,
    MeasuredRun,
    Nuisance,
    Parameter,
)
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose

TIME: Final = 0.01 * np.arange(1000)
#: Candidates that are like the large cause, and as many as are fitted at once.
ALIKE: Final = 9
LARGE, SMALL = 300.0, 12.0


def wave(number: int, shift: float) -> Array:
    return np.sin(2.0 * np.pi * (0.37 + 0.61 * number) * TIME + shift * (number + 1))


def cause(name: str, family: str) -> Hypothesis:
    return Hypothesis(name, family, name, Parameter("size", "N", 0.0, 1.0, step=0.1))


class Mixed(CompleteSimulator):
    """Waves: a drag with a small prior, a leak with many relatives, and rubber that is nearly a drag."""

    name = "waves"
    channels = (Channel("force", "N", 1.0),)
    nuisances = (Nuisance("drag", "N", 0.0, 1.0, step=0.1),)
    catalogue = MappingProxyType(
        {"leak": cause("leak", "gas"), "rubber": cause("rubber", "rubber")}
        | {f"relative {k}": cause(f"relative {k}", "gas") for k in range(ALIKE)}
    )
    surfaces = ()

    def run(self, experiment: Experiment, parameters: dict[str, float], effects: Effects) -> Array:
        shift = experiment.settings["shift"]
        size = {name: values["size"] for name, values in effects.items()}
        drag = wave(0, shift)
        leak = wave(1, shift) - SMALL / LARGE * drag  # without it the drag seems to be none
        force = parameters.get("drag", 0.0) * drag + size.get("leak", 0.0) * leak
        force = force + size.get("rubber", 0.0) * (drag + 0.3 * wave(2, shift))
        for k in range(ALIKE):
            force = force + size.get(f"relative {k}", 0.0) * (leak + 0.3 * wave(3 + k, shift))
        return force[:, None]


@pytest.mark.parametrize("seed", range(3))
def test_a_small_cause_is_found_with_a_large_one(seed, monkeypatch):
    # Here the test at finite sizes finds the leak, too.
    monkeypatch.setattr("diagnosis.engine.search.try_finite_sizes", lambda *_: ())
    simulator, rng = Mixed(), np.random.default_rng(seed)
    runs = []
    for number, role in enumerate(("fit", "select", "report")):
        experiment = Experiment(f"waves {number}", TIME, {}, {"shift": float(number)})
        outputs = simulator.run(experiment, {}, {"leak": {"size": LARGE}, "rubber": {"size": SMALL}})
        outputs += rng.standard_normal(outputs.shape)
        runs.append(
            MeasuredRun(experiment, outputs, np.ones(len(TIME), bool), np.zeros(len(TIME), bool), role)
        )
    finding = diagnose(
        Dataset(simulator.channels, tuple(runs)), simulator, Config(workers=1, with_panel=False)
    )
    sizes = {one.effect: one.parameters[0].value for one in finding.causes}
    assert sizes == {"leak": pytest.approx(LARGE, abs=0.5), "rubber": pytest.approx(SMALL, abs=1.0)}, (
        finding.sentence
    )
