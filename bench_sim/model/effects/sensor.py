"""Effects of the sensors: lag, gain, zero, drift and resolution.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, adds
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import (
    BELLOWS_BY_SIDE,
    CELLS,
    CELLS_BY_SIDE,
    FORCES,
    LATERAL_CELLS,
    PRESSURES,
    VERTICAL_CELLS,
)


def _sensor_offset_forces(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[CELLS_BY_SIDE[place]] += 0.5 * values["offset"]


_MBAR_PER_HOUR: Final = 100.0 / 3600.0


def _crosstalk(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    for felt in LATERAL_CELLS:
        for cause in VERTICAL_CELLS:
            cell, other = felt - Sensor.LOAD_CELL_1, cause - Sensor.LOAD_CELL_1
            par.load_cell_crosstalk[cell, other] += 0.5 * values["share"]


EFFECTS: Final = (
    # Sensor lag: the sensors of one kind, or the tubes to them, are slow, H = 1/(1 + (τ₀+τ)s) instead of 1/(1 + τ₀s).
    #
    # Discretised for inputs along cubics through the samples (`bench_sim.model.sensors`): the readings are smooth in τ
    # however short it is against the step.
    Effect(
        name="force_lag",
        family="sensor",
        title="load cells and force transducers lag behind",
        plain="load cells and force transducers lag behind",
        amplitude=EffectParameter("lag", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=adds("sensor_lag", "lag", FORCES),
        touches=frozenset({"sensor"}),
        confusers=("force_latency", "maxwell", "fractional"),
        phenomenon="a delay of the force readings",
        equation=("τ dF_m/dt + F_m = F\nF_m: measured force, F: true force (N); t: time, τ: lag (s)"),
        source="first-order low-pass of a strain-gauge amplifier",
        separated_by="steel block or known mass instead of the spring; large sines up to 12.5 Hz",
    ),
    Effect(
        name="pressure_lag",
        family="sensor",
        title="pressure transmitters lag behind",
        plain="the pressure transmitters lag behind",
        amplitude=EffectParameter("lag", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.5),
        change=adds("sensor_lag", "lag", PRESSURES),
        touches=frozenset({"sensor"}),
        confusers=("pressure_latency", "sample_and_hold", "pipe_inertia"),
        phenomenon="a delay of the pressure readings",
        equation=("τ dp_m/dt + p_m = p\np_m: measured pressure, p: true pressure (Pa); t: time, τ: lag (s)"),
        source="first-order filter of a transmitter; a volume filled through a narrow tube",
        separated_by="5 to 12 Hz at small amplitude: the force keeps its phase, all pressures lag alike",
    ),
    # Sensor gain: the sensors of one kind have a gain error, s_m = (1+g) s.
    Effect(
        name="force_gain",
        family="sensor",
        title="wrong gain of load cells and force transducers",
        plain="load cells and force transducers have a wrong gain",
        amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
        change=adds("sensor_gain", "gain", FORCES),
        touches=frozenset({"sensor"}),
        confusers=("pressure_gain",),
        equation=("F_m = (1+g) F\nF_m: measured force, F: true force (N); g: gain error"),
        source="calibration of a strain-gauge chain",
        separated_by="a known mass: the force differs from its weight",
    ),
    Effect(
        name="pressure_gain",
        family="sensor",
        title="wrong gain of the pressure transmitters",
        plain="the pressure transmitters have a wrong gain",
        amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
        change=adds("sensor_gain", "gain", PRESSURES),
        touches=frozenset({"sensor"}),
        confusers=("force_gain", "area_slope"),
        equation=("p_m = (1+g) p\np_m: measured pressure, p: true pressure (Pa); g: gain error"),
        source="span error of a transmitter",
        separated_by="a reference gauge or a known mass: the pressure differs from the reference",
    ),
    # Sensor offset: a sensor of one spring has a zero error, s_m = s + b.
    #
    # For forces, this is one load cell, or the two load cells under a spring with half of the offset each.
    Effect(
        name="force_offset",
        family="sensor",
        title="zero error of the load cells under one spring",
        plain="the load cells under the {side} spring have a zero error",
        amplitude=EffectParameter("offset", "N", "N", 1.0, nominal=0.0, typical=1000.0, low=-2e4, high=2e4),
        change=_sensor_offset_forces,
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("pressure_offset",),
        equation=("F_m = F + b\nF_m: measured force, F: true force (N); b: offset (N)"),
        source="zero of a strain-gauge bridge, tare not taken",
        separated_by="the empty, vented bench: its reading is the offset",
    ),
    Effect(
        name="cell_offset",
        family="sensor",
        title="zero error of one load cell",
        plain="load cell {side} has a zero error",
        amplitude=EffectParameter("offset", "N", "N", 1.0, nominal=0.0, typical=300.0, low=-2e4, high=2e4),
        change=adds("sensor_bias", "offset", by_place=CELLS),
        places=tuple(str(number) for number in range(1, len(CELLS) + 1)),
        touches=frozenset({"sensor"}),
        confusers=("force_offset", "twisted_seat", "soft_support"),
        equation=("F_m = F + b at one cell\nF_m: measured force, F: true force (N); b: offset (N)"),
        source="zero of a strain-gauge bridge, tare not taken",
        separated_by="the empty, vented bench: its reading is the offset",
    ),
    Effect(
        name="pressure_offset",
        family="sensor",
        title="zero error of the pressure transmitter of one bellows",
        plain="the {side} pressure transmitter has a zero error",
        amplitude=EffectParameter(
            "offset", "Pa", "mbar", 100.0, nominal=0.0, typical=10e3, low=-1e5, high=1e5
        ),
        change=adds("sensor_bias", "offset", by_place=BELLOWS_BY_SIDE),
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("force_offset", "pressure_drift"),
        equation=("p_m = p + b\np_m: measured pressure, p: true pressure (Pa); b: offset (Pa)"),
        source="zero of a transmitter",
        separated_by="the vented bench; bellows and auxiliary chamber at rest, which have the same pressure",
    ),
    # Pressure drift: the transmitter of one bellows wanders, p_m = p + r t, with t from the start of the rig.
    Effect(
        name="pressure_drift",
        family="sensor",
        title="pressure transmitter of one bellows drifts",
        plain="the {side} pressure transmitter drifts",
        amplitude=EffectParameter(
            "rate",
            "Pa/s",
            "mbar/h",
            _MBAR_PER_HOUR,
            nominal=0.0,
            typical=100.0 * _MBAR_PER_HOUR,
            low=-3000.0 * _MBAR_PER_HOUR,
            high=3000.0 * _MBAR_PER_HOUR,
        ),
        change=adds("sensor_drift", "rate", by_place=BELLOWS_BY_SIDE),
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("leak", "leak_laminar", "heat"),
        equation=(
            "p_m = p + r t\n"
            "p_m: measured pressure, p: true pressure (Pa); r: rate (Pa/s); t: time since the start of the rig "
            "(s)"
        ),
        source="warming-up and ageing of a transmitter; assumed linear in time",
        separated_by="a long hold, with the zero checked before and after: force and auxiliary pressure do not follow",
    ),
    # Crosstalk: each of the two lateral load cells also measures half of c F_z, so F_y,m = F_y + c F_z.
    Effect(
        name="crosstalk",
        family="sensor",
        title="lateral load cells respond to the vertical force",
        plain="the lateral load cells respond to the vertical force",
        amplitude=EffectParameter("share", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.1, high=0.1),
        change=_crosstalk,
        touches=frozenset({"sensor"}),
        confusers=("coupling",),
        equation=(
            "F_y,m = F_y + c F_z\n"
            "F_y,m: measured lateral force; F_y, F_z: true lateral and vertical force (N); c: share"
        ),
        source="alignment of a load cell; data sheets state about 1 %",
        separated_by="vertical motion without lateral motion and roll, at both load cases",
    ),
)
