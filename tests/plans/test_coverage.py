"""Whether the truth lies within the uncertainty: rigs whose sensors err as their data sheets allow."""

import numpy as np
import pytest

from bench_protocol.units import NS, Hz, mbar, mm, s
from bench_records.conformity import coverage_factor
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from bench_sim.rig.controls import TICK_NS
from test_plans import steps
from test_plans.analysis import VERTICAL_CELLS, Stiffness, dynamic_stiffness
from test_plans.analysis.cells import cells_under
from test_plans.description import lag_of
from test_plans.instruments import ordinary
from test_plans.loads import AW0
from test_plans.plans.leveling import _took
from test_plans.run import Run
from test_plans.steps.shaking import SAMPLE_RATE, VERTICAL, generator_cycles, spring_motion
from tests.plans.truth import Ideal

FREQUENCY, AMPLITUDE, CYCLES = 2 * Hz, 5 * mm, 5
#: Signals of a swing, and of a time: the pressure rises by 0.07 bar while the bolster goes down.
PISTON, PRESSURE = "vertical_left.displacement", "left.auxiliary_pressure"
RISE, DOWN, RATE = 70 * mbar, 15 * mm, 15 * mm / s


class Unrecorded:
    """Where no event is kept."""

    def event(self, time, kind, text, **data):
        pass


class Rigs:
    """A rig under the empty car with repeatedly exchanged sensors, and the true values of their readings."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.ideal = Ideal(load("astb"), seed, every=1)
        self.rig, self.bench = self.ideal.rig, self.ideal.bench

    def begin(self) -> None:
        self.bench.connect()
        self.run = Run(self.bench, Unrecorded(), instruments=ordinary(), dimensions=self.bench.dimensions)
        steps.carry(AW0)(self.run)
        steps.hold_the_height(self.run)
        steps.lock_the_air(self.run)
        self.bench.wait(20 * s)
        self.home = self.bench.commander.value("vertical_left.displacement_setpoint")

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
        """Return the measured pressure, height, stiffness, swing, time and drift, and the true values."""
        bench, run, found = self.bench, self.run, {}
        names = {"pressure": "left.bellows_pressure", "height": "left.height"}
        begun = bench.clock.now()
        mean = bench.averages(*names.values(), over=steps.AVERAGE_OVER)
        at = np.arange(begun, bench.clock.now(), TICK_NS)
        ideal = {name: self.ideal.at(name, at).mean() for name in (*names.values(), PRESSURE)}
        for what, name in names.items():
            found[what] = (
                run.measured(lambda m, name=name: m[name], mean, averaged=10),
                ideal[name],
            )
        times, values, exact = self._sine()

        late = lag_of(run.rig, "left.height"), lag_of(run.rig, *cells_under(run.rig, "left"))

        def stiffness(values, times=times, lags=late) -> Stiffness:
            motion, force = spring_motion(values, run.rig, "left")
            return dynamic_stiffness(times, motion, force, FREQUENCY, lags=lags)

        K, c = run.measure(lambda m: (stiffness(m).storage, stiffness(m).damping), values)
        true = stiffness(exact, lags=(0.0, 0.0))
        found |= {"stiffness": (K, true.storage), "damping": (c, true.damping)}
        rms = run.measured(lambda m: m[PISTON].std(), values)
        found["rms"] = rms, exact[PISTON].std()
        found["time"] = self._time(ideal[PRESSURE] + RISE)
        later, values_later, exact_later = self._sine()
        found["drift"] = (
            run.measured(
                lambda a, b: stiffness(b, later).storage / stiffness(a).storage - 1, values, values_later
            ),
            stiffness(exact_later, later, (0.0, 0.0)).storage / true.storage - 1,
        )
        self.bench.vertical.move_to(self.home, self.home, rate=RATE)
        return found

    def _sine(self):
        """Return times, readings and the truth of the whole cycles of a sine."""
        with self.bench.capture(*VERTICAL, *VERTICAL_CELLS, PISTON) as capture:
            self.bench.generator.run("vertical", amplitude=AMPLITUDE, frequency=FREQUENCY, cycles=CYCLES)
        times, values = capture.aligned(SAMPLE_RATE)
        steady = generator_cycles(times, values, 1, CYCLES - 2, FREQUENCY)
        values = {name: series[steady] for name, series in values.items()}
        return times[steady], values, self._exact(capture, times[steady], values)

    def _exact(self, capture, times, names):
        at = capture.start + np.round(times * NS)
        return {name: self.ideal.at(name, at) for name in names if name in ordinary().pieces}

    def _time(self, target: float):
        """Return after which time a pressure came to a target while the bolster went down, and after which it did."""
        with self.bench.capture(PRESSURE) as capture:
            self.bench.vertical.move_to(self.home - DOWN, self.home - DOWN, rate=RATE)
        times, values = capture.aligned(SAMPLE_RATE)
        exact = self._exact(capture, times, [PRESSURE])
        read = (_took(self.run, "left", -1.0, times, one, target, 60 * s) for one in (values, exact))
        measured, true = read
        return measured, true.value


def deviations(seed: int, count: int):
    """Yield, for so many rigs, (measured − true) / U of each quantity."""
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
    away = np.array([list(one.values()) for one in found])
    assert away.shape[1] == 7
    inside = np.count_nonzero(np.abs(away) <= 1.0)
    # Of 168 at 95.45 %: fewer than 152 or nearly all within half of it would come about once in a thousand times.
    assert inside >= 152
    assert np.count_nonzero(np.abs(away) > 0.5) >= 26
