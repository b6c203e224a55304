"""Late data: a channel is named, and a clock only where all channels of its device fall behind."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

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
from diagnosis.finding import Finding
from diagnosis.systems.measurement import Measured, driven_by, measurement_effects, read_as

STEP: Final = 0.01
TIME: Final = STEP * np.arange(1500)
#: The clocks were set so long (s) before a run: a slow one is behind by nearly the same all the time.
SET: Final = 20.0
NOISE: Final = {"pressure": 100.0, "force": 5.0, "acceleration": 0.02}
#: One device reads two of the outputs.
DEVICE: Final = ("pressure", "force")
CLOCK: Final = Hypothesis(
    name="clock",
    family="acquisition",
    title="clock of the device is slow",
    amplitude=Parameter("skew", "1", 0.0, 1e-3, 0.0, 0.1, 1e-5),
    touches=frozenset({"sensor", "timing"}),
)
SIGNALS: Final = (
    Measured("displacement", "m", "input", 1e-4, 5e-3),
    Measured("pressure", "Pa", "output", 200.0, 5e-3),
    Measured("force", "N", "output", 10.0, 5e-3),
    Measured("acceleration", "m/s2", "output", 0.05, 5e-3),
)
LATE: Final = {name: one for name, one in measurement_effects(SIGNALS).items() if name.startswith("latency")}


class Bellows(CompleteSimulator):
    """A bellows that is pressed: p and F follow from x and dx/dt, with readings that may be late."""

    name = "bellows"
    channels = tuple(Channel(name, "1", noise) for name, noise in NOISE.items())
    nuisances = (
        Nuisance("stiffness", "N/m", 1e4, 1e3, step=10.0),
        Nuisance("pressed", "Pa/m", 1e6, 1e5, step=1e3),
    )
    catalogue = MappingProxyType({**LATE, CLOCK.name: CLOCK})
    surfaces = ()

    def run(self, experiment: Experiment, parameters: dict[str, float], effects: Effects) -> Array:
        par = {nuisance.name: nuisance.nominal for nuisance in self.nuisances} | dict(parameters)
        time = experiment.time
        x = CubicSpline(time, driven_by("displacement", experiment.inputs["displacement"], time, effects))
        true = {
            "pressure": par["pressed"] * x(time) * (1.0 + 3.0 * x(time)),
            "force": par["stiffness"] * x(time) + 300.0 * x(time, 1),
            "acceleration": x(time, 2),
        }
        skew = effects.get("clock", {}).get("skew", 0.0)
        read = []
        for name, values in true.items():
            seen = read_as(name, values, time, effects)
            if skew and name in DEVICE:
                seen = CubicSpline(time, seen)(np.clip(time - skew * (SET + time), time[0], None))
            read.append(seen)
        return np.column_stack(read)


def measured(hidden: Effects, besides: float, seed: int = 1) -> Dataset:
    """Measure three runs of other waves; a force that no effect has acts ``besides`` (N)."""
    simulator, rng = Bellows(), np.random.default_rng(seed)
    runs = []
    for number, role in enumerate(("fit", "select", "report")):
        waves = [(0.02 / (k + 1), 0.4 * (k + 1) + 0.1 * number) for k in range(4)]
        x = sum(size * np.sin(2.0 * np.pi * f * TIME + number) for size, f in waves)
        experiment = Experiment(f"waves {number}", TIME, {"displacement": x})
        outputs = simulator.run(experiment, {}, hidden)
        outputs[:, 1] += besides * np.sign(np.sin(2.0 * np.pi * 1.7 * TIME))
        outputs += np.array(list(NOISE.values())) * rng.standard_normal(outputs.shape)
        scored, rest = TIME > 0.5, np.zeros(len(TIME), bool)
        runs.append(MeasuredRun(experiment, outputs, scored, rest, role))
    return Dataset(simulator.channels, tuple(runs))


def found(hidden: Effects, besides: float = 0.0, seed: int = 1) -> Finding:
    return diagnose(measured(hidden, besides, seed), Bellows(), Config(workers=1, with_panel=False))


@settings(deadline=None, max_examples=3, derandomize=True)
@given(
    st.sampled_from(sorted(LATE)), st.floats(11e-3, 30e-3), st.sampled_from([0.0, 100.0]), st.integers(0, 99)
)
def test_a_late_channel_is_named_instead_of_a_clock(channel, delay, besides, seed):
    finding = found({channel: {"delay": delay}}, besides, seed)
    if besides and channel == "latency.force":  # of that channel most remains: nothing is named
        assert not finding.causes
        return
    (cause,) = finding.causes
    assert cause.effect == channel
    assert cause.parameters[0].value == pytest.approx(1e3 * delay, rel=0.05)  # ms
    assert not finding.ambiguous_with


@settings(deadline=None, max_examples=2, derandomize=True)
@given(st.floats(3e-4, 1.5e-3), st.sampled_from([0.0, 100.0]), st.integers(0, 99))
def test_a_slow_clock_is_found_from_the_delay_of_all_its_channels(skew, besides, seed):
    finding = found({"clock": {"skew": skew}}, besides, seed)
    assert [cause.effect for cause in finding.causes] == ["clock"]
    assert finding.causes[0].parameters[0].value == pytest.approx(skew, rel=0.05)
    assert not finding.ambiguous_with


@pytest.mark.parametrize(
    ("late", "further"),
    [
        ({"pressure": 15e-3}, 0.0),
        ({"pressure": 15e-3, "acceleration": 15e-3}, 0.0),
        ({"pressure": 15e-3}, 15e-3),
        ({"pressure": 15e-3}, 20e-3),
        pytest.param({"pressure": 15e-3, "acceleration": 15e-3}, 15e-3, marks=pytest.mark.slow),
        pytest.param({"pressure": 15e-3, "acceleration": 15e-3}, 20e-3, marks=pytest.mark.slow),
    ],
)
def test_equal_delays_may_be_one_and_others_are_not(late, further):
    hidden = late | ({"force": further} if further else {})
    finding = found({f"latency.{name}": {"delay": delay} for name, delay in hidden.items()})
    assert {cause.effect for cause in finding.causes} == {f"latency.{name}" for name in hidden}
    together = len(hidden) > 1 and len(set(hidden.values())) == 1
    assert ("All of these are late by the same 15" in finding.sentence) == together
