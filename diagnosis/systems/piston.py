"""A pneumatic actuator on a test bench: the force that holds its piston, from measured pressure and motion.

    F = A·p + b,   A = (1 + a)·π/4·D²

p is the gauge pressure, b the zero of the force. The number a includes a wrong bore, a wrong gain of either sensor, and
friction proportional to p that differs between the two directions. The number b includes the zero of the pressure, a
weight, and a constant difference between the directions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import lfilter, savgol_filter

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
from diagnosis.systems.piston_effects import FORCES, PISTON_EFFECTS, Stroke
from diagnosis.systems.splines import SplineAxis, TensorSplines
from diagnosis.systems.system import System, SystemSetting, SystemSignal

#: Motion slower than this for half a second is rest.
_REST_SPEED: Final = 0.1e-3
#: Signals are smoothed over this time (s), so that the noise of a laser makes no reversals.
_SMOOTHING: Final = 0.1
#: v_0 of asinh(v/v_0), the coordinate of speed: linear below, logarithmic above.
_SLOW: Final = 1e-3

_NUISANCES: Final = (
    Nuisance("area_error", "1", 0.0, 0.01, low=-0.2, high=0.2, step=1e-5, display="%", scale=0.01),
    Nuisance("force_zero", "N", 0.0, 2.0, low=-50.0, high=50.0, step=1e-3, display="N"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Piston:
    """The simulator of the actuator. Its inputs are ``displacement``, ``speed``, ``pressure``, ``pressure_rate`` and
    ``time``.

    The output is the force in N. ``middle`` is x_m in the equations of the effects.
    """

    bore: float
    middle: float
    splines: tuple[TensorSplines, ...]
    channels: tuple[Channel, ...]

    @property
    def name(self) -> str:
        return "piston"

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        return _NUISANCES

    @property
    def catalogue(self) -> Mapping[str, Hypothesis]:
        return PISTON_EFFECTS

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        return tuple(splines.surface for splines in self.splines)

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        inputs = experiment.inputs
        x, v, p, clock = (inputs[name] for name in ("displacement", "speed", "pressure", "time"))
        if "pressure_lag" in effects:
            p = p + effects["pressure_lag"]["lag"] * inputs["pressure_rate"]
        area = 0.25 * pi * self.bore**2 * (1.0 + parameters.get("area_error", 0.0))
        force = area * p + parameters.get("force_zero", 0.0)
        stroke = Stroke(x, v, p, clock, x - self.middle, area)
        for name, values in effects.items():
            if name in FORCES:
                force = force + FORCES[name](stroke, values)
        states = {"displacement": x, "speed": np.arcsinh(v / _SLOW), "pressure": p}
        for splines in self.splines:
            if splines.name in effects:
                force = force + splines.value(states, effects[splines.name])
        if "force_lag" in effects:
            force = lagged(force, effects["force_lag"]["lag"], experiment.step)
        return force[:, np.newaxis]


def _surfaces(low: float, high: float) -> tuple[TensorSplines, ...]:
    """Return the possible surfaces of an unknown force, for a stroke from ``low`` to ``high`` in m."""
    x = SplineAxis("displacement", "displacement in mm", tuple(np.linspace(low, high, 6)), 1e-3)
    v = SplineAxis("speed", "speed in mm/s", tuple(np.linspace(-3.6, 3.6, 5)), 1e-3, _SLOW)
    p = SplineAxis("pressure", "gauge pressure in bar", tuple(np.linspace(0.0, 8e5, 4)), 1e5)
    force = frozenset({"force"})
    return (
        TensorSplines(
            "force_over_x_and_v", "unknown force over displacement and speed", x, v, "N", 5.0, force
        ),
        TensorSplines("force_over_v_and_p", "unknown force over speed and pressure", v, p, "N", 5.0, force),
    )


def lagged(signal: Array, lag: float, step: float) -> Array:
    """Return ``signal`` (n,) after a first-order lag in s, exact for linear interpolation between samples.

    At the first sample it is settled. Near lag 0 it is linear in the lag; exp(−step/lag) alone would have no slope
    there.
    """
    if lag <= 0.0:
        return signal
    a = np.exp(-step / lag)
    mean = lag / step * (1.0 - a)  # mean over the step of e^(−t/lag)
    b = np.array([1.0 - mean, mean - a])
    return lfilter(b, [1.0, -a], signal, zi=mean * signal[:1])[0]


def _smooth(step: float, values: Array, derivative: int) -> Array:
    """Return ``values`` (n,) or their derivative, smoothed by local parabolas (Savitzky-Golay) after single outliers
    are removed.
    """
    window = min(2 * max(round(0.5 * _SMOOTHING / step), 2) + 1, (len(values) - 1) // 2 * 2 + 1)
    return savgol_filter(median_filter(values, 3, mode="nearest"), window, 2, deriv=derivative, delta=step)


def _prepare(step: float, clock: Array, measured: Mapping[str, Array]) -> Mapping[str, Array]:
    return {
        "displacement": _smooth(step, measured["displacement"], 0),
        "speed": _smooth(step, measured["displacement"], 1),
        "pressure": measured["pressure"],
        "pressure_rate": _smooth(step, measured["pressure"], 1),
        "time": clock,
    }


def _at_rest(step: float, clock: Array, measured: Mapping[str, Array]) -> NDArray[np.bool_]:
    moving = np.abs(_smooth(step, measured["displacement"], 1)) > _REST_SPEED
    around = round(0.5 / step)
    near = np.convolve(moving, np.ones(2 * around + 1), mode="full")[around : around + len(moving)]
    return np.asarray(near < 0.5)


def _simulator(settings: Mapping[str, float], channels: tuple[Channel, ...]) -> Piston:
    low, high = settings["stroke_from"], settings["stroke_to"]
    if not low < high:
        raise DiagnosisError(f"stroke_from = {low:g} m must be below stroke_to = {high:g} m")
    return Piston(settings["bore"], 0.5 * (low + high), _surfaces(low, high), channels)


PISTON: Final = System(
    name="piston",
    title="a pneumatic actuator: displacement and pressure are measured, the force is predicted",
    inputs=(
        SystemSignal("displacement", "m", "displacement that compresses the gas", display="mm", scale=1e-3),
        SystemSignal("pressure", "Pa", "pressure in the actuator", gauge=True, display="bar", scale=1e5),
    ),
    outputs=(SystemSignal("force", "N", "force that holds the piston", display="N"),),
    settings=(
        SystemSetting("bore", "m", "inner diameter", 1e-3, 1.0),
        SystemSetting("stroke_from", "m", "least displacement", -10.0, 10.0),
        SystemSetting("stroke_to", "m", "largest displacement", -10.0, 10.0),
        SystemSetting("ambient_pressure", "Pa", "pressure of the air around", 5e4, 1.2e5, 101_325.0, True),
    ),
    simulator=_simulator,
    prepare=_prepare,
    rest=_at_rest,
    forgets=True,
    passive=(("force", "displacement"),),
)
