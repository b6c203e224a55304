"""A spring's FMU as the rig has it: tried beforehand in a process of its own, then run apart from the rig or in it."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from astb.spring_fmu.instances import begin, prepare, shared, told, where
from astb.spring_fmu.keys import SpringFmuError, SpringMap
from astb.spring_fmu.mapping import Plan, plan_of
from astb.spring_fmu.worker import Order
from bench_protocol.rates import TICK
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.elsewhere import FEEDS, SUPPLY_TAKEN, Elsewhere, Feed, Place
from bench_sim.model.layout import SIDES, Input
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PLANT_QUANTITIES, Lanes
from bench_sim.rig.elsewhere import Failure
from diagnosis.systems.fmu.description import read_fmu, unpack_fmu

_WORKER: Final = "astb.spring_fmu.worker"
#: Parameters of the supply before the main valve.
_SUPPLY: Final = ("supply_", "sawtooth_")
#: s that an FMU may take until it has begun, and until it has been tried.
_BEGINNING: Final = 120.0
#: ms for which a rig in real time may not answer: whoever commands it gives up after half a second.
_SILENCE: Final = 300
#: Communication steps that are tried beforehand.
_TRIED: Final = 300
#: A tick keeps its time where a step takes at most so much of it, and all ticks together where that much of them.
_OF_A_TICK: Final = 0.5
_OF_ALL: Final = 0.7
#: Steps in ticks that are looked at where one tick is too short.
_OTHERS: Final = (2, 5, 10, 20)
_LAST_WORDS: Final = 300


@dataclass(frozen=True, slots=True)
class Budget:
    """How long communication steps of ``step`` s take, in s."""

    step: float
    median: float
    slow: float  #: all but one in a hundred are faster
    longest: float

    @classmethod
    def of(cls, step: float, taken: npt.NDArray[np.float64]) -> Budget:
        """From how long some took, the first of which are not counted: memory is touched there."""
        counted = taken[len(taken) // 10 :]
        slow = float(np.quantile(counted, 0.99))
        return cls(step, float(np.median(counted)), slow, float(counted.max()))

    @property
    def in_a_tick(self) -> bool:
        """Whether every tick keeps its time."""
        return self.slow <= _OF_A_TICK * TICK

    @property
    def on_average(self) -> bool:
        """Whether ticks that are late are caught up."""
        return self.median <= _OF_ALL * self.step

    @property
    def told(self) -> str:
        """In words, with figures."""
        return (
            f"a step of {self.step * 1e3:g} ms takes {_time(self.median)}, 99 % at most {_time(self.slow)}, the "
            f"longest {_time(self.longest)}"
        )


def _time(value: float) -> str:
    return f"{value * 1e6:.3g} µs" if value < 1e-3 else f"{value * 1e3:.3g} ms"


class SpringFmu:
    """Springs that an FMU computes (`bench_sim.rig.springs.Springs`); `close` ends its process.

    Raises `SpringFmuError` or DiagnosisError for an FMU that cannot be taken, in words; it has been tried by then.
    ``budget`` is how long its steps take.
    """

    def __init__(self, path: Path, keys: SpringMap, parameters: Any) -> None:
        self.plan = plan_of(read_fmu(path), keys, float(parameters.ambient_temperature))
        self._temporary = tempfile.TemporaryDirectory(prefix="astb-spring-")
        self._folder = Path(self._temporary.name)
        self._processes: list[subprocess.Popen[bytes]] = []
        self._pipes: list[int] = []
        self.close = weakref.finalize(self, _end, self._processes, self._pipes, self._temporary)
        unpack_fmu(path, self._folder / "unpacked")
        feeds = first_feeds(Plant.depressurised(parameters))
        self.budget = self._try(self.plan, feeds)
        #: What should be known of it beforehand, in words: what it does not tell, and how long its steps take.
        self.said = (*self.plan.said, *self._of_time(feeds))
        self.arrays = shared(self._folder / "memory", self.plan, create=True)
        prepare(self.arrays, self.plan)
        self._log: list[str] = []
        if self.plan.apart:
            self._begin_apart(feeds)
        else:
            self._kept = begin(self.arrays, self.plan, self._folder / "unpacked", feeds, self._log)

    @property
    def told(self) -> frozenset[str]:
        """Parameters of the springs that hands change between runs, and of which the FMU is told."""
        fed = set(self.arrays.fed.tolist())
        names = {"nominal_preload": Feed.NOMINAL_PRELOAD, "orifice_diameter": Feed.ORIFICE_DIAMETER}
        return frozenset(name for name, place in names.items() if {place, place + 1} <= fed)

    @property
    def owned(self) -> frozenset[str]:
        """Parameters that are the FMU's."""
        e = self.arrays
        bench = Lanes.FEEDS | Lanes.JOINS if e.numbers[Place.VALVES] else Lanes(0)
        supply = SUPPLY_TAKEN in e.taken
        return frozenset(
            one.name
            for one in PLANT_QUANTITIES
            if (one.lanes is Lanes.ELSEWHERE and supply and one.name.startswith(_SUPPLY))
            or not (one.lanes & (Lanes.ELSEWHERE | bench))
        )

    def pressures(self) -> npt.NDArray[np.float64]:
        """Return the gauge pressure in all chambers, Pa."""
        e = self.arrays
        chambers = (Algebraic.PRESSURE, Algebraic.AUXILIARY_PRESSURE)
        places = [place + side for place in chambers for side in range(SIDES)]
        return np.array(e.known[1, np.isin(e.taken, places)])

    def hurry(self) -> None:
        """Be waited for no longer than the wires of a rig in real time may keep silent."""
        n = self.arrays.numbers
        n[Place.PATIENCE] = min(n[Place.PATIENCE], _SILENCE)

    def why(self) -> str:
        """Return in words why the springs are lost; a process that hangs is ended."""
        e, plan = self.arrays, self.plan
        name = plan.fmu.path.name
        match Failure(e.numbers[Place.FAILED]):
            case Failure.SILENT:
                self._processes[0].kill()
                text = f"{name} came no further for {1e-3 * e.numbers[Place.PATIENCE]:g} s {where(e, plan)}"
            case Failure.GONE:
                text = f"{name} {_ended(self._processes[0])} {where(e, plan)}"
            case _:
                text = told(e, plan)
        return text + self._last_words()

    def _try(self, plan: Plan, feeds: npt.NDArray[np.float64], steps: int = _TRIED) -> Budget:
        """Let the FMU take some steps in a process of its own, and return how long they took."""
        memory = self._folder / "trial"
        e = shared(memory, plan, create=True)
        prepare(e, plan)
        order = Order(plan, self._folder / "unpacked", memory, feeds, steps)
        process = self._start()
        try:
            output, _ = process.communicate(pickle.dumps(order), timeout=_BEGINNING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise SpringFmuError(
                f"{plan.fmu.path.name} came no further {self._at(e, plan)} when it was tried; right would be an FMU "
                f"that returns{self._last_words()}"
            ) from None
        return Budget.of(plan.ticks * TICK, self._answer(process, output, e, plan))

    def _at(self, e: Elsewhere, plan: Plan) -> str:
        return where(e, plan) if e.instances[0, 0] else "before it had begun"

    def _answer(self, process: subprocess.Popen[bytes], output: bytes, e: Elsewhere, plan: Plan) -> Any:
        try:
            good, answer = pickle.loads(output)
        except (EOFError, pickle.UnpicklingError):
            process.wait()
            raise SpringFmuError(
                f"{plan.fmu.path.name} {_ended(process)} {self._at(e, plan)} when it was tried, in its own process: "
                f"right would be an FMU that answers with a status{self._last_words()}"
            ) from None
        if not good:
            raise SpringFmuError(f"{answer}{self._last_words()}")
        return answer

    def _start(self, *, keep: tuple[int, ...] = ()) -> subprocess.Popen[bytes]:
        with (self._folder / "log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", _WORKER],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                pass_fds=keep,
                cwd=self._folder,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path),
                },
            )

    def _begin_apart(self, feeds: npt.NDArray[np.float64]) -> None:
        asked, ask = os.pipe()
        answer, answers = os.pipe()
        self._pipes += [ask, answer]
        n = self.arrays.numbers
        n[Place.APART], n[Place.ASK], n[Place.ANSWER] = 1, ask, answer
        memory, unpacked = self._folder / "memory", self._folder / "unpacked"
        order = Order(self.plan, unpacked, memory, feeds, asked=asked, answers=answers)
        process = self._start(keep=(asked, answers))
        self._processes.append(process)
        os.close(asked)
        os.close(answers)
        late = threading.Timer(_BEGINNING, process.kill)
        late.daemon = True
        late.start()
        assert process.stdin is not None and process.stdout is not None
        with contextlib.suppress(OSError):
            process.stdin.write(pickle.dumps(order))
            process.stdin.close()
        with process.stdout as answered:
            output = answered.read()
        late.cancel()
        self._answer(process, output, self.arrays, self.plan)

    def _of_time(self, feeds: npt.NDArray[np.float64]) -> tuple[str, ...]:
        """Return in words whether the FMU keeps the time of a rig in real time, and at which step else."""
        name, rate = self.plan.fmu.path.name, f"{1e-3 / TICK:g} kHz"
        if self.budget.in_a_tick:
            return (f"{name}: {self.budget.told}: {rate} is kept",)
        lines = [f"{name}: {self.budget.told}: {rate} is not kept in every tick"]
        if self.budget.on_average:
            return (*lines, "late ticks are caught up, as long as late_ticks says so")
        for ticks in _OTHERS:
            if ticks > self.plan.ticks:
                other = self._try(replace(self.plan, ticks=ticks), feeds, _TRIED // ticks + 20)
                if other.on_average:
                    step = f"{ticks * TICK * 1e3:g} ms"
                    return (*lines, f'right would be step = "{step}": {other.told}; late ticks are caught up')
        return (*lines, "no step up to 20 ms is fast enough: it runs in virtual time only")

    @property
    def too_slow(self) -> bool:
        """Whether a rig in real time could not catch up."""
        return not self.budget.on_average

    def _last_words(self) -> str:
        text = (self._folder / "log").read_text("utf-8", "replace").strip() if self._folder.exists() else ""
        text = "; ".join([*getattr(self, "_log", [])[-4:], text]).strip("; ")
        return f". Its last words: …{text[-_LAST_WORDS:]}" if text else ""


def _end(
    processes: list[subprocess.Popen[bytes]], pipes: list[int], temporary: tempfile.TemporaryDirectory[str]
) -> None:
    for process in processes:
        process.kill()
        process.wait()
    for pipe in pipes:
        with contextlib.suppress(OSError):
            os.close(pipe)
    temporary.cleanup()


def _ended(process: subprocess.Popen[bytes]) -> str:
    code = process.wait()
    return f"crashed ({signal.Signals(-code).name})" if code < 0 else f"ended its process (with {code})"


def first_feeds(plant: Plant) -> npt.NDArray[np.float64]:
    """Return what springs are told (`Feed`) where a plant stands still."""
    feeds = np.zeros(FEEDS)
    truth, par = plant.truth(), plant.parameters
    for side in range(SIDES):
        feeds[Feed.HEIGHT + side] = truth[f"height[{side}]"]
        feeds[Feed.NOMINAL_PRELOAD + side] = par.nominal_preload[side]
        feeds[Feed.ORIFICE_DIAMETER + side] = par.orifice_diameter[side]
    feeds[Feed.LATERAL], feeds[Feed.ROLL] = truth["lateral[0]"], truth["roll[0]"]
    feeds[Feed.SUPPLY : Feed.DPV + 1] = plant.inputs[Input.SUPPLY : Input.DPV_CONNECTED + 1]
    return feeds
