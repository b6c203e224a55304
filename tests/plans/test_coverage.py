"""Whether the truth lies within the uncertainty: rigs whose sensors err as their data sheets allow."""

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.rates import TICK
from bench_protocol.units import Hz, mm, s
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans import steps
from test_plans.analysis import Stiffness, dynamic_stiffness
from test_plans.instruments import ordinary
from test_plans.loads import AW0
from test_plans.readings import LASER_LAG, LOAD_CELL_LAG
from test_plans.run import Run
from test_plans.steps.shaking import SAMPLE_RATE, VERTICAL, generator_cycles, spring_motion

FREQUENCY, AMPLITUDE, CYCLES = 2 * Hz, 5 * mm, 5
#: A sample of the fast messages, in ticks.
SAMPLE = round(1 / SAMPLE_RATE / TICK)


class Unrecorded:
    """Where no event is kept."""

    def event(self, time, kind, text, **data):
        pass


class Rigs:
    """A rig under the empty car whose sensors are exchanged again and again, and the truth beside their readings."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.rig = Rig(load("astb"), seed=seed)
        self.truth: dict[int, np.ndarray] | None = None
        self.ticks = 0
        self.memory = RigInMemory(self.rig, self._run)
        self.bench = self.memory.bench()

    def _run(self, ticks):
        if self.truth is None:
            self.ticks += ticks
            return self.rig.run(ticks)
        blocks = []
        for _ in range(ticks):
            blocks.append(self.rig.run(1))
            self.ticks += 1
            if self.ticks % SAMPLE == 0:
                self.truth[self.ticks // SAMPLE] = self.rig.plant.ideal().copy()
        return np.concatenate(blocks)

    def begin(self) -> None:
        self.bench.connect()
        self.run = Run(self.bench, Unrecorded(), instruments=ordinary())
        steps.carry(AW0)(self.run)
        steps.hold_the_height(self.run)
        steps.lock_the_air(self.run)
        self.bench.wait(20 * s)

    def exchange(self) -> None:
        """Give every sensor the errors of another piece of its data sheet."""
        parameters, nominal = self.rig.plant.parameters, load("astb").entries["sensor_lag"].value
        for name, piece in ordinary().pieces.items():
            k, one = sensor_of(name), piece.instrument
            parameters.sensor_bias[k] = one.offset * self.rng.uniform(-1, 1)
            parameters.sensor_gain[k] = one.gain * self.rng.uniform(-1, 1)
            parameters.sensor_lag[k] = nominal[k] + one.lag * self.rng.uniform(-1, 1)
        self.bench.wait(0.5 * s)

    def looked_at(self):
        """Return what was measured of pressure, height and stiffness, and what is true."""
        bench, run, found, self.truth = self.bench, self.run, {}, {}
        names = {"pressure": "left.bellows_pressure", "height": "left.height"}
        mean = bench.averages(*names.values(), over=steps.AVERAGE_OVER)
        ideal = np.mean(list(self.truth.values()), axis=0)
        for what, name in names.items():
            found[what] = (
                run.measured(lambda m, name=name: m[name], mean, averaged=10),
                ideal[sensor_of(name)],
            )
        with bench.capture(*VERTICAL) as capture:
            bench.generator.run("vertical", amplitude=AMPLITUDE, frequency=FREQUENCY, cycles=CYCLES)
        times, values = capture.aligned(SAMPLE_RATE)
        steady = generator_cycles(times, values, 1, CYCLES - 2, FREQUENCY)
        at = np.round((capture.start * 1e-9 + times[steady]) * SAMPLE_RATE).astype(int)
        values = {name: series[steady] for name, series in values.items()}
        ideal = np.array([self.truth[k] for k in at])
        exact = {sensor.name.lower(): ideal[:, sensor] for sensor in Sensor}
        exact = {name: exact[sensor_of(name).name.lower()] for name in VERTICAL if name in ordinary().pieces}
        self.truth = None

        def stiffness(values, lag=LASER_LAG - LOAD_CELL_LAG) -> Stiffness:
            motion, force = spring_motion(values, "left")
            return dynamic_stiffness(times[steady], motion, force, FREQUENCY, motion_lag=lag)

        K, c = run.measure(lambda m: (stiffness(m).storage, stiffness(m).damping), values)
        true = stiffness(exact, lag=0.0)
        return found | {"stiffness": (K, true.storage), "damping": (c, true.damping)}


def deviations(seed: int, count: int):
    """Yield, for so many rigs, (measured − true) / U of each quantity."""
    from bench_records.conformity import coverage_factor

    rigs = Rigs(seed)
    rigs.begin()
    for _ in range(count):
        rigs.exchange()
        yield {
            what: (one.value - true) / (coverage_factor(one.even / one.u) * one.u)
            for what, (one, true) in rigs.looked_at().items()
        }
    rigs.bench.close()


@pytest.mark.slow
def test_the_truth_lies_within_the_expanded_uncertainty_as_often_as_it_says():
    found = list(deviations(seed=11, count=24))
    away = np.array([[one[what] for what in ("pressure", "height", "stiffness", "damping")] for one in found])
    inside = np.count_nonzero(np.abs(away) <= 1.0)
    # Of 96 at 95.45 %: fewer than 86 or all within half of it would come about once in a thousand times.
    assert inside >= 86
    assert np.count_nonzero(np.abs(away) > 0.5) >= 15
