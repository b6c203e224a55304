"""The vehicle as one object: at rest or in a steady wind, during a ride through gusts, and its natural modes."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.car import CAR, CHANNELS, Ride, car_derivative, place_bogie, ride_on
from bench_sim.model.layout import SIDES, STATES, Input, State
from bench_sim.model.plant import STEP, Plant
from bench_sim.model.quantities import PARAMETERS
from bench_sim.model.rest import fill_chamber, relax_rubber, settled_temperature
from bench_sim.model.spring import load_bellows, stretch, stretched_pressure, volume

#: Largest step (N) of the wind force when the equilibrium is computed. Each step starts from the previous result.
_PORTION: Final = 2000.0
_ITERATIONS: Final = 60
#: Residual in m at which an equilibrium is accepted: a force of 4e-11 of the car body's weight.
_BALANCED: Final = 1e-11

#: An imaginary part of an eigenvalue below this (rad/s) is a rounding error, and not an oscillation.
_SLOWEST: Final = 0.05

#: States that take part in small motions.
_GAS: Final = tuple(range(State.BELLOWS_MASS, State.BELLOWS_WALL))
_MOTION: Final = tuple(range(State.VERTICAL_DASHPOT, State.PLATFORM_LATERAL))


@dataclass(frozen=True, slots=True)
class NaturalMode:
    """One oscillating natural mode of small motions: undamped frequency in Hz, damping ratio, and shape.

    ``shape`` contains lateral, vertical and b·roll (complex; the largest is 1). b is half the distance between the
    springs.
    """

    frequency: float
    damping: float
    shape: tuple[complex, complex, complex]


class Vehicle:
    """Half a car on one bogie. The bench's parameter record describes its springs, and a record ``CAR`` describes the
    rest.

    The mass of the body is the load of the springs at their nominal preloads, m = (P_L + P_R)/g. ``state``, ``inputs``
    and ``memory`` have the same meaning as in `Plant`. The car body replaces the bolster, and the bogie the platform.
    The vehicle starts at rest without wind. Leveling valves are connected only with ``leveling``. The differential
    pressure valve is connected unless ``dpv`` is False.
    """

    def __init__(
        self, parameters: Any, car: Any, *, leveling: bool = False, dpv: bool = True, dt: float = STEP
    ) -> None:
        if np.any(parameters.pipe_length):
            raise ValueError(
                "pipe_length is not 0, but the vehicle's step of 1 ms is too long for a pipe; set it to 0"
            )
        own = np.array([parameters], PARAMETERS).view(np.recarray)
        self.car_array = np.array([car], CAR).view(np.recarray)
        self.car: Any = self.car_array[0]
        own.bolster_mass = np.sum(parameters.nominal_preload) / parameters.gravity
        own.bolster_inertia = own.bolster_mass * self.car.roll_gyration**2
        own.centre_height = self.car.centre_height
        self._plant = Plant.at_rest(own[0], dt=dt)
        self.parameter_array = self._plant.parameter_array
        self.parameters: Any = self._plant.parameters
        self.state = self._plant.state
        self.inputs = self._plant.inputs
        self.memory_array = self._plant.memory_array
        self.memory: Any = self._plant.memory
        self.dt = dt
        self.inputs[[Input.LEFT_LEVELING, Input.RIGHT_LEVELING]] = float(leveling)
        self.inputs[Input.DPV_CONNECTED] = float(dpv)
        self._slope = np.zeros(STATES)
        self._algebraic = np.zeros(ALGEBRAICS)

    @property
    def mass(self) -> float:
        """Return the mass of this half of the car body in kg."""
        return float(self.parameters.bolster_mass)

    @property
    def time(self) -> float:
        """Simulated time in s; the track begins at zero."""
        return float(self.memory.time)

    def slope(self, wind: float = 0.0) -> NDArray[np.float64]:
        """Return dx/dt of the present state under a ``wind`` force in N on this half of the car. `algebraic` returns
        the variables of this evaluation.
        """
        car_derivative(
            self.time,
            self.state,
            self.memory_array,
            self.inputs,
            self.parameter_array,
            self.car_array,
            wind,
            self._slope,
            self._algebraic,
        )
        return self._slope.copy()

    def algebraic(self, quantity: Algebraic, side: int = 0) -> float:
        """Return one algebraic variable of the last `slope` or `lean`."""
        return float(self._algebraic[quantity + side])

    def lean(self, wind: float) -> "Vehicle":
        """Set the vehicle to its equilibrium under a steady ``wind`` force in N on this half of the car. Return this
        object.

        Each spring keeps its air, at the initial temperature of its walls. The rubber is relaxed, friction has no
        force, and the emergency spring has not crept further. Leveling valves have no effect; to include them, use
        `ride` until the vehicle is at rest. Raises ValueError if there is no equilibrium, or if the differential
        pressure valve would open before it.
        """
        air = [
            float(self.state[State.BELLOWS_MASS + i] + self.state[State.AUXILIARY_MASS + i])
            for i in range(SIDES)
        ]
        bellows = np.zeros(2 * SIDES)
        for force in np.linspace(0.0, wind, 1 + max(1, int(np.ceil(abs(wind) / _PORTION))))[1:]:
            bellows = self._balance(bellows, air, float(force))
        self._misfit(bellows, air, wind)
        par = self.parameters
        difference = abs(
            self._algebraic[Algebraic.AUXILIARY_PRESSURE] - self._algebraic[Algebraic.AUXILIARY_PRESSURE + 1]
        )
        if self.inputs[Input.DPV_CONNECTED] > 0.0 and difference > par.dpv_opening:
            raise ValueError(
                f"wind = {wind / 1e3:g} kN leaves {difference / 1e5:.3g} bar between left and right, "
                f"but the differential pressure valve opens at {par.dpv_opening / 1e5:g} bar, and the "
                "car then leans further; use ride instead of lean"
            )
        return self

    def _balance(self, bellows: NDArray[np.float64], air: list[float], wind: float) -> NDArray[np.float64]:
        """Return the displacements of both bellows (ζ, ζ, y, y) in equilibrium under a ``wind`` force in N. ``air``
        (kg) is the air of each spring. Newton's method halves a step that does not reduce the residual.
        """
        misfit = self._misfit(bellows, air, wind)
        for _ in range(_ITERATIONS):
            size = float(np.max(np.abs(misfit)))
            if size < _BALANCED:
                return bellows
            jacobian = np.empty((2 * SIDES, 2 * SIDES))
            for k in range(2 * SIDES):
                moved = bellows.copy()
                moved[k] += 1e-7
                jacobian[:, k] = (self._misfit(moved, air, wind) - misfit) / 1e-7
            step = -np.linalg.solve(jacobian, misfit)
            step *= min(1.0, 0.01 / float(np.max(np.abs(step))))
            for _ in range(20):
                tried = self._misfit(bellows + step, air, wind)
                if np.max(np.abs(tried)) < size:
                    break
                step *= 0.5
            else:
                if size < 100.0 * _BALANCED:  # as close as rounding allows
                    return bellows
                break
            bellows = bellows + step
            misfit = tried
        raise ValueError(
            f"wind = {wind / 1e3:g} kN has no equilibrium: the car body rolls over or leaves the range "
            "of the model; use less wind"
        )

    def _misfit(self, bellows: NDArray[np.float64], air: list[float], wind: float) -> NDArray[np.float64]:
        """Set the vehicle to rest with these displacements of the bellows. Return the residual of equilibrium in m.
        ``air`` (kg) and ``wind`` (N) are as in `_balance`.

        The force of each spring follows from its bellows, and the deflection of the emergency spring from this force.
        """
        par, x, mem, out = self.parameters, self.state, self.memory, self._algebraic
        T = settled_temperature(par)
        top = np.empty((2, SIDES))
        for side in range(SIDES):
            zeta, y = float(bellows[side]), float(bellows[SIDES + side])
            V, V_a = volume(par, side, zeta, y), par.auxiliary_volume[side]
            p = stretched_pressure(par, side, zeta, air[side] * par.gas_constant * T, V + V_a)
            V += stretch(par, side, zeta, p)
            fill_chamber(x, par, State.BELLOWS_MASS + side, p, V, T)
            fill_chamber(x, par, State.AUXILIARY_MASS + side, p, V_a, T)
            relax_rubber(x, mem, side, zeta, y)
            load_bellows(x, mem, par, side, zeta, y, out)
            top[0, side], top[1, side] = zeta - x[State.CREEP + side], y
            if par.emergency_spring:
                top[0, side] -= (
                    out[Algebraic.STACK_VERTICAL + side] - par.nominal_preload[side]
                ) / par.emergency_stiffness_vertical[side]
                top[1, side] -= out[Algebraic.STACK_LATERAL + side] / par.emergency_stiffness_lateral[side]
        mem.solved_time = mem.time
        mem.dpv_difference = 0.0
        roll = (top[0, 0] - top[0, 1]) / (2.0 * par.spring_half_spacing)
        x[State.BOLSTER_LATERAL : State.PLATFORM_LATERAL] = 0.0
        place_bogie(0.0, self.car, x)
        x[State.PLATFORM_LATERAL_SPEED : State.PLATFORM_ROLL_SPEED + 1] = 0.0
        x[State.BOLSTER_LATERAL] = top[1].mean() - par.centre_height * roll
        x[State.BOLSTER_VERTICAL] = top[0].mean()
        x[State.BOLSTER_ROLL] = roll
        x[State.LEVER : State.LEVER + SIDES] = top[0] + par.lever_offset
        acceleration = self.slope(wind)[State.BOLSTER_LATERAL_SPEED : State.PLATFORM_LATERAL]
        # Accelerations of 1 Hz, so that residuals are in metres in every component.
        return np.array([*(acceleration / (2.0 * np.pi) ** 2), top[1, 0] - top[1, 1]])

    def ride(
        self,
        wind: ArrayLike,
        duration: float,
        *,
        interval: float = 0.0,
        every: int = 1,
        springs: bool = False,
    ) -> Ride:
        """Simulate a ride of ``duration`` s from the present state on. Return the record, with one row every
        ``every`` steps.

        ``wind`` is the force on this half of the car in N, positive to the left. It is one number, or samples
        ``interval`` s apart, linearly interpolated; the last sample stays valid. With ``springs`` the variables of
        `Algebraic` are recorded too.
        """
        force = np.atleast_1d(np.ascontiguousarray(wind, dtype=np.float64))
        if force.ndim != 1 or not len(force) or not np.isfinite(force).all():
            raise ValueError(
                f"wind has shape {force.shape} or gaps; use one force or a series of forces in N, "
                "without gaps"
            )
        if len(force) > 1 and not interval > 0.0:
            raise ValueError(
                f"interval = {interval:g} s; a series of {len(force)} forces needs its sampling time"
            )
        steps = round(duration / self.dt)
        count = -(-steps // every)
        rows = np.zeros((count, CHANNELS))
        algebraic = np.zeros((count if springs else 0, ALGEBRAICS))
        time = self.time + self.dt * every * np.arange(count, dtype=np.float64)
        ride_on(
            self.state,
            self.memory_array,
            self.inputs,
            self.parameter_array,
            self.car_array,
            self.dt,
            steps,
            force,
            float(interval) if len(force) > 1 else 1.0,
            every,
            rows,
            algebraic,
        )
        return Ride(time, rows, algebraic)

    def jacobian(self, wind: float = 0.0) -> NDArray[np.float64]:
        """Return ∂(dx/dt)/∂x at the present state under a ``wind`` force in N, by central differences.

        It contains the states of gas, rubber and car body, in the order of `State`. Friction sticks, and valves do not
        switch.
        """
        places = [*_GAS, *_MOTION]
        kept = self.state.copy()
        result = np.empty((len(places), len(places)))
        for column, place in enumerate(places):
            disturbance = 1e-6 * abs(kept[place]) if place in _GAS else 1e-6
            self.state[place] = kept[place] + disturbance
            ahead = self.slope(wind)[places]
            self.state[place] = kept[place] - disturbance
            behind = self.slope(wind)[places]
            self.state[:] = kept
            result[:, column] = (ahead - behind) / (2.0 * disturbance)
        return result

    def modes(self, wind: float = 0.0) -> list[NaturalMode]:
        """Return the oscillating natural modes about the present state under a ``wind`` force in N, in the order of
        frequency.

        They are valid for small motions: friction sticks and adds its initial stiffness F_max/x₂, and the orifice flow
        is linear.
        """
        values, vectors = np.linalg.eig(self.jacobian(wind))
        first = len(_GAS) + _MOTION.index(int(State.BOLSTER_LATERAL))
        modes = []
        for value, vector in zip(values, vectors.T, strict=True):
            size = abs(value)
            if value.imag <= 1e-3 * size or value.imag < _SLOWEST:
                continue
            shape = vector[first : first + 3] * (1.0, 1.0, self.parameters.spring_half_spacing)
            shape = shape / shape[np.argmax(np.abs(shape))]
            lateral, vertical, roll = (complex(part) for part in shape)
            modes.append(
                NaturalMode(float(size / (2.0 * np.pi)), float(-value.real / size), (lateral, vertical, roll))
            )
        return sorted(modes, key=lambda mode: mode.frequency)
