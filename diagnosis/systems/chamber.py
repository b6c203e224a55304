"""A chamber of constant volume that is filled, closed and observed: its pressure and, if measured, its temperature.

If it is sealed and its gas is at wall temperature, p is constant. Everything else is an effect of the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from bench_sim.model.compiled import compiled, compiled_entry
from diagnosis.contracts import (
    Array,
    Channel,
    DiagnosisError,
    Effects,
    Experiment,
    Hypothesis,
    Nuisance,
    Surface,
)
from diagnosis.systems.chamber_effects import KAPPA, R_AIR, RHO_0, T_0, chamber_effects
from diagnosis.systems.system import System, SystemSetting, SystemSignal

#: The gas is integrated in steps of at most this.
_STEP: Final = 0.1
#: Number of samples that give the pressure at the start.
_FIRST: Final = 10

_NUISANCES: Final = (
    Nuisance("start_pressure_error", "Pa", 0.0, 2e2, step=1e-2, display="mbar", scale=1e2, per_run=True),
    Nuisance("pressure_zero", "Pa", 0.0, 2e3, step=1e-2, display="mbar", scale=1e2),
)


@dataclass(frozen=True, slots=True, eq=False)
class Chamber:
    """The simulator of a closed chamber. Its only input is ``time``, seconds since the start of the file. All values
    are in SI.

    The setting ``start_pressure`` of each experiment is the gauge pressure measured at its start.
    """

    volume: float
    ambient_pressure: float
    wall_temperature: float
    channels: tuple[Channel, ...]
    catalogue: Mapping[str, Hypothesis]

    @property
    def name(self) -> str:
        return "chamber"

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        return _NUISANCES

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        return ()

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        clock = experiment.inputs["time"]
        zero = parameters.get("pressure_zero", 0.0)
        start = experiment.settings["start_pressure"] + parameters.get("start_pressure_error", 0.0) - zero
        filling = effects.get("filling_heat", {})
        warm = np.zeros(len(clock))
        if filling:
            warm = filling["excess_temperature"] * np.exp(-clock / filling["time_constant"])
        pressure, temperature = _empty(
            experiment.step,
            ceil(experiment.step / _STEP),
            start + self.ambient_pressure,
            self.volume,
            self.ambient_pressure,
            self.wall_temperature,
            _leaks(effects),
            effects.get("heat_exchange", {}).get("time_constant", 0.0),
            warm,
        )
        seen = pressure - self.ambient_pressure + zero
        drift = effects.get("sensor_drift", {}).get("rate", 0.0)
        columns = {"pressure": seen + drift * clock if drift else seen, "temperature": temperature}
        return np.column_stack([columns[channel.name] for channel in self.channels])


def _leaks(effects: Effects) -> Array:
    """Return the parameters of all leak laws as an array, in the order of `_flow`; 0 for laws that are missing."""
    orifice = effects.get("leak_orifice", {})
    opening = effects.get("leak_opening", {})
    porous = effects.get("leak_inertial", {})
    return np.array(
        [
            orifice.get("conductance", 0.0),
            orifice.get("critical_ratio", 0.5),
            effects.get("leak_linear", {}).get("conductance", 0.0),
            effects.get("leak_laminar", {}).get("conductance", 0.0),
            porous.get("conductance", 0.0),
            porous.get("transition", 1.0),
            opening.get("conductance", 0.0),
            opening.get("opening", 0.0),
        ]
    )


@compiled
def _orifice(p: float, T: float, p_a: float, b: float) -> float:
    """Return the mass flow (kg/s) of an orifice with conductance 1 m³/(s·Pa) by ISO 6358, from p to p_a."""
    if p <= p_a:
        return 0.0
    r = p_a / p
    subsonic = 1.0 if r <= b else np.sqrt(1.0 - ((r - b) / (1.0 - b)) ** 2)
    return RHO_0 * p * np.sqrt(T_0 / T) * subsonic


@compiled
def _flow(p: float, T: float, p_a: float, k: Array) -> float:
    """Return the mass flow (kg/s) out of the chamber through all leaks; ``k`` is from `_leaks`."""
    excess = p - p_a
    squares = p * p - p_a * p_a
    flow = k[2] * excess + k[3] * squares + k[6] * excess * (1.0 + k[7] * excess)
    if k[0] != 0.0:
        flow += k[0] * _orifice(p, T, p_a, k[1])
    if k[4] != 0.0:
        squares = max(squares, 0.0)
        flow += 2.0 * k[4] * squares / (1.0 + np.sqrt(1.0 + 4.0 * squares / k[5] ** 2))
    return flow


@compiled_entry
def _empty(
    step: float, parts: int, p: float, V: float, p_a: float, T_w: float, k: Array, tau: float, warm: Array
) -> tuple[Array, Array]:
    """Return pressure in Pa and temperature in K (n,) of gas that leaks and exchanges heat, by the midpoint rule.

        dm/dt = −G,   dθ/dt = −θ/τ − (κ−1)·T·G/m,   T = T_w + θ + warm,   p = m·R·T/V

    ``warm`` (n,) in K is added to the temperature. θ is integrated exactly over each step for constant G/m: at τ = 0 it
    is 0, and near τ = 0 it is proportional to τ.
    """
    n = warm.shape[0]
    pressure, temperature = np.empty(n), np.empty(n)
    h = step / parts
    a, a_half = 0.0, 0.0
    if tau > 0.0:
        a, a_half = np.exp(-h / tau), np.exp(-0.5 * h / tau)
    theta = 0.0
    T = T_w + warm[0]
    m = p * V / (R_AIR * T)
    for i in range(n):
        T = T_w + theta + warm[i]
        pressure[i] = m * R_AIR * T / V
        temperature[i] = T
        slope = (warm[i + 1] - warm[i]) / parts if i + 1 < n else 0.0
        for j in range(parts):
            T = T_w + theta + warm[i] + j * slope
            flow = _flow(m * R_AIR * T / V, T, p_a, k)
            m_half = m - 0.5 * h * flow
            theta_half = a_half * theta - tau * (1.0 - a_half) * (KAPPA - 1.0) * T * flow / m
            T = T_w + theta_half + warm[i] + (j + 0.5) * slope
            flow = _flow(m_half * R_AIR * T / V, T, p_a, k)
            theta = a * theta - tau * (1.0 - a) * (KAPPA - 1.0) * T * flow / m_half
            m -= h * flow
            m = max(m, 1e-12)
    return pressure, temperature


def _prepare(step: float, clock: Array, measured: Mapping[str, Array]) -> Mapping[str, Array]:
    return {"time": clock}


def _start_pressure(measured: Mapping[str, Array]) -> Mapping[str, float]:
    """Return the pressure at the start of a record. It is read from a line through the first samples, because it may
    fall fast.
    """
    pressure = measured["pressure"][:_FIRST]
    known = np.flatnonzero(np.isfinite(pressure))
    if len(known) < 2:
        raise DiagnosisError(
            f"the first {_FIRST} samples of the pressure hold {len(known)} measured values; use a file or a time.start "
            "with at least two"
        )
    return {"start_pressure": float(np.polynomial.Polynomial.fit(known, pressure[known], 1)(0.0))}


def _simulator(settings: Mapping[str, float], channels: tuple[Channel, ...]) -> Chamber:
    return Chamber(
        settings["volume"],
        settings["ambient_pressure"],
        settings["ambient_temperature"],
        channels,
        chamber_effects(settings["volume"]),
    )


CHAMBER: Final = System(
    name="chamber",
    title="a closed chamber: its pressure is predicted",
    inputs=(),
    outputs=(
        SystemSignal("pressure", "Pa", "pressure in the chamber", gauge=True, display="bar", scale=1e5),
        SystemSignal("temperature", "K", "temperature of the gas", required=False, display="K"),
    ),
    settings=(
        SystemSetting("volume", "m3", "volume of the chamber", 1e-9, 1e3),
        SystemSetting("ambient_pressure", "Pa", "pressure of the air around", 5e4, 1.2e5, default=101_325.0),
        SystemSetting(
            "ambient_temperature", "K", "temperature of wall and air around", 200.0, 400.0, default=T_0
        ),
    ),
    simulator=_simulator,
    prepare=_prepare,
    begin=_start_pressure,
)
