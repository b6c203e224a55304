"""The springs as pythonfmu3 makes an FMU of them: the same compiled laws, with Python around them."""

from typing import Any

import numpy as np
from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

from astb.fmu.kernels.springs import OUTPUTS, ROWS, advance, start
from astb.fmu.models import unit_of
from astb.fmu.unit import Kind
from bench_protocol.rates import TICK
from bench_sim.model.compiled import compiled_entry
from bench_sim.model.layout import INPUTS, STATES
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.parameters import load

UNIT = unit_of("spring")
_advance, _start = compiled_entry(advance), compiled_entry(start)


class PythonSprings(Fmi3Slave):  # type: ignore[misc]
    """Motions in, all outputs out."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.time = 0.0
        varying = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=varying))
        self.motion, self.out = np.zeros(9), np.zeros(OUTPUTS)
        arrays = {Kind.MOTION: self.motion, Kind.OUTPUT: self.out}
        for one in UNIT.variables:
            if one.kind in arrays:
                self._register(one.name, arrays[one.kind], one.place, one.kind)
        self.x, self.u, self.work = np.zeros(STATES), np.zeros(INPUTS), np.zeros((ROWS, STATES))
        for one in UNIT.variables:
            if one.kind is Kind.INPUT:
                self.u[one.place] = one.start
        self.memory = np.zeros(1, MEMORY).view(np.recarray)
        self.parameters = np.array([load().record], PARAMETERS).view(np.recarray)
        given = self.x, self.memory, self.u, self.parameters, self.motion
        _start(*given, 1.0, self.work, self.out)
        self.given = given

    def _register(self, name: str, array: Any, place: int, kind: Kind) -> None:
        def get() -> float:
            return float(array[place])

        def put(value: float) -> None:
            array[place] = value

        causality = Fmi3Causality.input if kind is Kind.MOTION else Fmi3Causality.output
        self.register_variable(Float64(name, causality=causality, getter=get, setter=put))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by whole ticks."""
        _advance(*self.given, 0.0, TICK, round(step_size / TICK), self.work, self.out)
        return True
