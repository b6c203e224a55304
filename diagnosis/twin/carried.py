"""State of the gas at a start in the middle of a motion, taken from the replay of the stretch before.

During a motion a pressure reading is not sufficient without a temperature, and thermometers lag by a second. While the
gas is compressed or expanded, it is some kelvins warmer or colder than their readings.
"""

from typing import Final, NamedTuple

import numpy as np

from bench_sim.parameters import Parameters
from diagnosis.contracts import Job, MeasuredRun, Nuisance
from diagnosis.systems.air_spring.gas import GAS, MOVING
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.records import STEP
from diagnosis.twin.innovations import Estimate

#: Longest period of a motion (s).
_TO_AND_FRO: Final = 4.0


class Carried(NamedTuple):
    """The state of the gas (pressures and temperatures, SI) at a sample of the earlier stretch, and the index of this
    sample.
    """

    sample: int
    gas: dict[str, float]


class GasOf:
    """Replays a bench with ``parameters``, only to compute the state of its gas."""

    def __init__(self, parameters: Parameters) -> None:
        self._simulator = AirSpring(parameters, effects={}, only=GAS)
        names = [channel.name for channel in self._simulator.channels]
        self._names = names
        self._lags = np.array([float(parameters.record.sensor_lag[OUTPUTS[name]]) for name in names])
        self._pressures = [k for k, name in enumerate(names) if name.endswith("_pressure")]

    def carried(
        self, run: MeasuredRun, parameters: tuple[Nuisance, ...], estimate: Estimate, before: float
    ) -> Carried:
        """Return the gas at the moment, shortly before the time ``before`` (s) of a run, at which the pressures change
        least.

        ``estimate`` is that of the ``parameters`` at this time.
        """
        known = {one.name for one in self._simulator.nuisances}
        believed = {
            one.name: one.nominal + one.spread * float(mean)
            for one, mean in zip(parameters, estimate.mean, strict=True)
            if one.name in known
        }
        read = next(self._simulator.run_many([Job(run.experiment, believed, {})]))
        self._simulator.forget()
        rates = np.gradient(read, STEP, axis=0)
        last = round(before / STEP)
        first = max(last - round(_TO_AND_FRO / STEP), 0)
        # A reading that is a sample early or late is nearly the same there.
        sample = first + int(np.argmin((rates[first:last, self._pressures] ** 2).sum(axis=1)))
        gas = read[sample] + self._lags * rates[sample]
        return Carried(sample, {MOVING: 1.0, **dict(zip(self._names, map(float, gas), strict=True))})
