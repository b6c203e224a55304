"""Springs of a rig that an FMU computes. The FMU is tested in a separate process, then runs there or in the process of
the rig.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import TICK
from bench_sim.fmu.description import FmuError, read_fmu
from bench_sim.fmu.process import FmuRunner, Worker, log_tail
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.external_springs import FEEDS, SUPPLY_TAKEN, ExternalSprings, Feed, Slot
from bench_sim.model.layout import SIDES, Input
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PLANT_QUANTITIES, Lanes
from bench_sim.rig.external_springs import Failure
from bench_sim.rig.spring_fmu.instances import failure_reason, initialize, shared, where
from bench_sim.rig.spring_fmu.keys import SpringMap
from bench_sim.rig.spring_fmu.mapping import Coupling, coupling_of
from bench_sim.rig.spring_fmu.worker import StartOrder

_WORKER: Final = "bench_sim.rig.spring_fmu.worker"
#: Parameters of the supply before the main valve.
_SUPPLY: Final = ("supply_", "sawtooth_")
#: Timeout of initialization with the trial, s.
_START_TIMEOUT: Final = 120.0
#: Timeout of a step in real time, ms. Clients of the rig give up after 500 ms.
_STEP_TIMEOUT_MAX: Final = 300
#: Communication steps of a trial.
_TRIED: Final = 300
#: Largest share of a tick for a step, such that each tick keeps its deadline; and for all ticks on average.
_OF_A_TICK: Final = 0.5
_OF_ALL: Final = 0.7
#: Steps in ticks to try if one tick is too short.
_OTHERS: Final = (2, 5, 10, 20)


@dataclass(frozen=True, slots=True)
class Budget:
    """The measured durations (s) of communication steps of ``step`` s."""

    step: float
    median: float
    slow: float  #: 99 % are faster
    longest: float

    @classmethod
    def of(cls, step: float, durations: npt.NDArray[np.float64]) -> Budget:
        """Return the statistics of ``durations`` without the first tenth, in which memory is accessed for the first
        time.
        """
        counted = durations[len(durations) // 10 :]
        slow = float(np.quantile(counted, 0.99))
        return cls(step, float(np.median(counted)), slow, float(counted.max()))

    @property
    def in_a_tick(self) -> bool:
        """Whether a step is fast enough for the deadline of every tick."""
        return self.slow <= _OF_A_TICK * TICK

    @property
    def on_average(self) -> bool:
        """Whether a step is fast enough on average, so that the rig can catch up after late ticks."""
        return self.median <= _OF_ALL * self.step

    def __str__(self) -> str:
        return (
            f"a step of {self.step * 1e3:g} ms takes {_time(self.median)}, 99 % at most {_time(self.slow)}, the "
            f"longest {_time(self.longest)}"
        )


def _time(value: float) -> str:
    return f"{value * 1e6:.3g} µs" if value < 1e-3 else f"{value * 1e3:.3g} ms"


class SpringFmu:
    """Springs that an FMU computes (`bench_sim.rig.springs.ReplacementSprings`). `close` ends its process.

    Raises FmuError for an FMU that cannot be used or that fails in the trial. ``budget`` states the duration of its
    steps.
    """

    _worker: Worker | None = None

    def __init__(self, path: Path, keys: SpringMap, parameters: Any) -> None:
        self.coupling = coupling_of(read_fmu(path), keys, float(parameters.ambient_temperature))
        self._name = self.coupling.fmu.path.name
        self._runner = FmuRunner(self.coupling.fmu, _WORKER)
        self.close = self._runner.close
        self._log: list[str] = []
        feeds = first_feeds(Plant.depressurised(parameters))
        self.budget = self._try(self.coupling, feeds)
        #: Assumed outputs and the duration of steps, as sentences for the user.
        self.notes = (*self.coupling.notes, *self._time_notes(feeds))
        if self.coupling.apart:
            self._worker, self.arrays, _ = self._start("memory", self.coupling, feeds)
            n = self.arrays.numbers
            n[Slot.APART], (n[Slot.ASK], n[Slot.ANSWER]) = 1, self._worker.descriptors
            return
        self.arrays = shared(self._runner.folder / "memory", self.coupling, create=True)
        try:
            self._kept = initialize(
                self.arrays, self.coupling, self._runner.unpacked, feeds, self._log.append
            )
        except Exception as error:  # FMPy raises several types
            at = where(self.arrays, self.coupling)
            raise FmuError(f"{self._name} failed {at}: {error}; correct the FMU{self._log_tail()}") from None

    @property
    def adjustable(self) -> frozenset[str]:
        """Return the parameters that a person changes between runs and for which the FMU has inputs."""
        fed = set(self.arrays.fed.tolist())
        names = {"nominal_preload": Feed.NOMINAL_PRELOAD, "orifice_diameter": Feed.ORIFICE_DIAMETER}
        return frozenset(name for name, place in names.items() if {place, place + 1} <= fed)

    @property
    def owned(self) -> frozenset[str]:
        """Return the names of the bench parameters that the FMU replaces."""
        e = self.arrays
        bench = Lanes.FEEDS | Lanes.JOINS if e.numbers[Slot.VALVES] else Lanes(0)
        supply = SUPPLY_TAKEN in e.taken
        return frozenset(
            one.name
            for one in PLANT_QUANTITIES
            if (one.lanes is Lanes.NOT_IN_LANES and supply and one.name.startswith(_SUPPLY))
            or not (one.lanes & (Lanes.NOT_IN_LANES | bench))
        )

    def pressures(self) -> npt.NDArray[np.float64]:
        """Return the gauge pressures in Pa of all chambers whose pressure the FMU gives."""
        e = self.arrays
        chambers = (Algebraic.PRESSURE, Algebraic.AUXILIARY_PRESSURE)
        places = [place + side for place in chambers for side in range(SIDES)]
        return np.array(e.known[1, np.isin(e.taken, places)])

    def limit_timeout(self) -> None:
        """Reduce the timeout of a step to the time that clients of a rig in real time allow."""
        n = self.arrays.numbers
        n[Slot.PATIENCE] = min(n[Slot.PATIENCE], _STEP_TIMEOUT_MAX)

    def failure(self) -> str:
        """Return a text with the reason why the springs have failed. A process that hangs is killed."""
        e = self.arrays
        failed, at = Failure(e.numbers[Slot.FAILED]), where(e, self.coupling)
        if self._worker and failed in (Failure.SILENT, Failure.GONE):
            if failed is Failure.SILENT:
                self._worker.kill(1e-3 * e.numbers[Slot.PATIENCE])
            text = f"{self._name} {self._worker.ending()} {at}"
        else:
            text = f"{self._name} failed {at}: {failure_reason(e, self.coupling)}"
        return text + self._log_tail()

    def _start(
        self, memory: str, coupling: Coupling, feeds: npt.NDArray[np.float64], steps: int = 0
    ) -> tuple[Worker, ExternalSprings, npt.NDArray[np.float64]]:
        """Initialize the FMU in a worker process. Return the worker, its shared memory, and the durations (s) of
        trial ``steps``.
        """
        path = self._runner.folder / memory
        e = shared(path, coupling, create=True)
        worker = self._runner.start()
        durations = worker.request(
            StartOrder(coupling, self._runner.unpacked, path, feeds, steps),
            timeout=_START_TIMEOUT,
            where=lambda: where(e, coupling) + (", in a trial before the start" if steps else ""),
        )
        return worker, e, durations

    def _try(self, coupling: Coupling, feeds: npt.NDArray[np.float64], steps: int = _TRIED) -> Budget:
        worker, _, durations = self._start("trial", coupling, feeds, steps)
        worker.close()
        return Budget.of(coupling.ticks * TICK, durations)

    def _time_notes(self, feeds: npt.NDArray[np.float64]) -> tuple[str, ...]:
        """Return sentences on whether the FMU is fast enough for real time. If it is not, they recommend a longer
        step.
        """
        rate = f"{1e-3 / TICK:g} kHz"
        if self.budget.in_a_tick:
            return (f"{self._name}: {self.budget}: {rate} is kept",)
        lines = [f"{self._name}: {self.budget}: {rate} is not kept in every tick"]
        if self.budget.on_average:
            return (*lines, 'the rig catches up after late ticks, except with late_ticks = "fault"')
        for ticks in _OTHERS:
            if ticks > self.coupling.ticks:
                other = self._try(replace(self.coupling, ticks=ticks), feeds, _TRIED // ticks + 20)
                if other.on_average:
                    step = f"{ticks * TICK * 1e3:g} ms"
                    return (*lines, f'use step = "{step}": {other}; the rig catches up after late ticks')
        return (*lines, "no step up to 20 ms is fast enough: use the FMU in virtual time")

    @property
    def too_slow(self) -> bool:
        """Whether a rig in real time could not catch up after late ticks."""
        return not self.budget.on_average

    def _log_tail(self) -> str:
        return self._worker.log_tail() if self._worker else log_tail("; ".join(self._log[-4:]))


def first_feeds(plant: Plant) -> npt.NDArray[np.float64]:
    """Return the inputs of springs (`Feed`) for a plant at rest."""
    feeds = np.zeros(FEEDS)
    truth, par = plant.truth(), plant.parameters
    for side in range(SIDES):
        feeds[Feed.HEIGHT + side] = truth[f"height[{side}]"]
        feeds[Feed.NOMINAL_PRELOAD + side] = par.nominal_preload[side]
        feeds[Feed.ORIFICE_DIAMETER + side] = par.orifice_diameter[side]
    feeds[Feed.LATERAL], feeds[Feed.ROLL] = truth["lateral[0]"], truth["roll[0]"]
    feeds[Feed.SUPPLY : Feed.DPV + 1] = plant.inputs[Input.SUPPLY : Input.DPV_CONNECTED + 1]
    return feeds
