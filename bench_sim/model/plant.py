"""The plant as one object, with its state, steps, readings and snapshots, and with two possible initial states."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_protocol.runtime.binding import bind
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bench_rest import rest_forces, seated_height, settle_bench
from bench_sim.model.kernel import advance_plant, measure_plant, observe
from bench_sim.model.layout import (
    ACTUATORS,
    INPUTS,
    SENSORS,
    SIDES,
    STATES,
    Input,
    Mode,
    Sensor,
    State,
)
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.model.rest import settle_sensors
from bench_sim.model.spring import resting_gauge

#: Length of the fixed step in s.
STEP = 1e-3


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Copies of all variables of a plant. They can also be restored in another plant."""

    state: NDArray[np.float64]
    inputs: NDArray[np.float64]
    memory: NDArray[np.void]
    counter: int


class Plant:
    """The bench with one parameter record (``bench_sim.parameters.Parameters.record``).

    ``state`` (`State`), ``inputs`` (`Input`) and ``memory`` are the complete state. ``inputs`` may be written at any
    time, and keep their values. The plant is deterministic: ``seed`` determines the noise. ``dt`` is the step in s.
    """

    def __init__(self, parameters: Any, *, seed: int = 0, dt: float = STEP) -> None:
        if not 0.0 < dt <= 2.5e-3:
            raise ValueError(
                f"dt = {dt * 1e3:g} ms is outside 0 to 2.5 ms, the range in which the step is stable"
            )
        self.parameter_array = np.array([parameters], PARAMETERS).view(np.recarray)
        self.parameters: Any = self.parameter_array[0]
        self.dt = dt
        self.state = np.zeros(STATES)
        self.inputs = np.zeros(INPUTS)
        self.memory_array = np.zeros(1, MEMORY).view(np.recarray)
        self.memory: Any = self.memory_array[0]
        self.memory.seed = seed
        #: Number of readings of the sensors, which selects the noise of the next reading.
        self.counter = 0
        self._slope = np.zeros(STATES)
        self._algebraic = np.zeros(ALGEBRAICS)
        self._values = np.zeros(SENSORS)

    # Bound when first called: the rig's tick contains the step, and a rig needs neither of these.
    @cached_property
    def _advance(self) -> Callable[..., Any]:
        everything = (self.state, self.memory_array, self.inputs, self.parameter_array)
        return bind(advance_plant, *everything, self.dt, 1)

    @cached_property
    def _measure(self) -> Callable[..., Any]:
        everything = (self.state, self.memory_array, self.inputs, self.parameter_array)
        return bind(measure_plant, *everything, 0, self._values)

    @classmethod
    def depressurised(cls, parameters: Any, *, seed: int = 0, dt: float = STEP) -> "Plant":
        """Return a bench without air: atmospheric pressure in all chambers, bolster on the emergency springs,
        actuators off.
        """
        plant = cls(parameters, seed=seed, dt=dt)
        seated = [seated_height(parameters, side) for side in range(SIDES)]
        bellows, height = (np.array(one) for one in zip(*seated, strict=True))
        plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE, Input.DPV_CONNECTED]] = 1.0
        atmosphere = parameters.atmospheric_pressure
        plant._settle(bellows, height, np.full(SIDES, atmosphere), atmosphere)
        return plant

    @classmethod
    def at_rest(cls, parameters: Any, *, seed: int = 0, dt: float = STEP) -> "Plant":
        """Return a bench at design height under its load case, with p = P/A_e + p_atm and actuators in force control.

        The leveling valves are isolated. Supply, orifices and differential pressure valve are open.
        """
        plant = cls(parameters, seed=seed, dt=dt)
        par = parameters
        force = rest_forces(par)
        plant.inputs[
            [Input.SUPPLY, Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE, Input.DPV_CONNECTED]
        ] = 1
        for j in range(ACTUATORS):
            plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.FORCE
            plant.inputs[Input.VERTICAL_LEFT_COMMAND + j] = force[j]
            plant.memory.mode[j] = Mode.FORCE
            plant.state[State.ACTUATOR + j] = force[j]
        pressure = par.atmospheric_pressure + np.array([resting_gauge(par, side) for side in range(SIDES)])
        supply = par.sawtooth_high if par.supply_sawtooth else par.supply_pressure
        plant._settle(np.zeros(SIDES), np.zeros(SIDES), pressure, supply + par.atmospheric_pressure)
        return plant

    def _settle(
        self,
        bellows: NDArray[np.float64],
        height: NDArray[np.float64],
        pressure: NDArray[np.float64],
        supply: float,
    ) -> None:
        """Set the state to rest at the given spring heights (`settle_bench`), with sensors in steady state."""
        par, x, mem = self.parameters, self.state, self.memory
        settle_bench(x, mem, par, bellows, height, pressure, supply)
        observe(x, mem, self.inputs, par, self._slope, self._algebraic, self._values)
        settle_sensors(mem, par, self._values, self.dt)

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return float(self.memory.time)

    def step(self, n: int = 1) -> None:
        """Advance by ``n`` fixed steps with the present inputs."""
        self._advance(self.state, self.memory_array, self.inputs, self.parameter_array, self.dt, n)

    def measure(self) -> NDArray[np.float64]:
        """Return one reading of every sensor as a new array, in SI units and in the order of `Sensor`."""
        readings = np.empty(SENSORS)
        self._measure(
            self.state, self.memory_array, self.inputs, self.parameter_array, self.counter, readings
        )
        self.counter += 1
        return readings

    def ideal(self) -> NDArray[np.float64]:
        """Return the readings of sensors without faults and lags, in the order of `Sensor`."""
        observe(
            self.state, self.memory, self.inputs, self.parameters, self._slope, self._algebraic, self._values
        )
        return self._values.copy()

    def truth(self) -> dict[str, float]:
        """Return every algebraic variable and ideal reading by name, such as ``volume[0]`` or ``left_height``."""
        values = self.ideal()
        names = list(Algebraic)
        ends = [*(int(name) for name in names[1:]), ALGEBRAICS]
        result = {}
        for name, end in zip(names, ends, strict=True):
            for place in range(name, end):
                result[f"{name.name.lower()}[{place - name}]"] = float(self._algebraic[place])
        return result | {sensor.name.lower(): float(values[sensor]) for sensor in Sensor}

    def snapshot(self) -> Snapshot:
        """Return copies of all variables. `restore` sets the variables to exactly these values."""
        return Snapshot(self.state.copy(), self.inputs.copy(), self.memory_array.copy(), self.counter)

    def restore(self, snapshot: Snapshot) -> None:
        """Set the variables to those of a snapshot, which may be of another plant."""
        self.state[:] = snapshot.state
        self.inputs[:] = snapshot.inputs
        self.memory_array[:] = snapshot.memory
        self.counter = snapshot.counter
