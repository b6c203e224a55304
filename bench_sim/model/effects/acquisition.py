"""Effects of the data acquisition: latency, clocks and held samples.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_sim.model.effects.effect import Effect, EffectParameter, adds
from bench_sim.model.wiring import FORCES, PRESSURES


def _sample_and_hold(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.pressure_hold += values["hold"]
    if values["hold"] > 0.0:
        par.pressure_hold_period = values["period"]


def _quantisation(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    channels = [*FORCES, *PRESSURES]
    span = par.sensor_high[channels] - par.sensor_low[channels]
    par.sensor_resolution[channels] = np.maximum(par.sensor_resolution[channels], values["step"] * span)


EFFECTS: Final = (
    # Sensor latency: the readings of one kind of sensor arrive late, s_m(t) = s(t − τ).
    #
    # The delay is interpolated between the outputs of the steps (`bench_sim.model.sensors`). So the readings
    # are smooth in τ at 0. Readings are stamped on arrival: their time stamps do not show the delay.
    #
    # The displacements are those of both springs, of all pistons and of the platform. A replay is driven by most of
    # them, and all else then seems to come early.
    Effect(
        name="force_latency",
        family="acquisition",
        title="forces arrive late",
        plain="the forces arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=adds("force_latency", "delay"),
        touches=frozenset({"sensor", "timing"}),
        confusers=("force_lag", "maxwell"),
        phenomenon="a delay of the force readings",
        equation=("F_m(t) = F(t − τ)\nF_m: measured force, F: true force (N); t: time, τ: delay (s)"),
        source="queueing in a gateway or on a busy bus",
        separated_by="large sines up to 12.5 Hz: a delay changes only the phase, a lag also the amplitude",
    ),
    Effect(
        name="pressure_latency",
        family="acquisition",
        title="pressures arrive late",
        plain="the pressures arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.1),
        change=adds("pressure_latency", "delay"),
        touches=frozenset({"sensor", "timing"}),
        confusers=("pressure_lag", "sample_and_hold", "clock_skew"),
        phenomenon="a delay of the pressure readings",
        equation=("p_m(t) = p(t − τ)\np_m: measured pressure, p: true pressure (Pa); t: time, τ: delay (s)"),
        source="polling period of a fieldbus gateway",
        separated_by="large sines up to 12.5 Hz: a delay changes only the phase, a lag also the amplitude",
    ),
    Effect(
        name="displacement_latency",
        family="acquisition",
        title="displacements arrive late",
        plain="the displacements arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=adds("displacement_latency", "delay"),
        touches=frozenset({"sensor", "timing"}),
        confusers=("maxwell", "platen_inertia"),
        equation=(
            "z_m(t) = z(t − τ)\nz_m: measured displacement, z: true displacement (m); t: time, τ: delay (s)"
        ),
        source="averaging in the controller of a laser; a slower bus for the actuators' transducers",
        separated_by="a sudden stop of the motion: forces and pressures end before the displacement does",
    ),
    # Clock skew: the pressures have a separate clock that is slow, so their delay grows, p_m(t) = p(t − εt).
    #
    # Time t begins at the start of the rig. Only past readings are possible: a fast clock is equivalent to a slow one
    # of all other channels. The rig keeps 255 steps, 0.25 s at 1 ms; beyond that the pressures fall behind no
    # further.
    Effect(
        name="clock_skew",
        family="acquisition",
        title="clock of the pressures is slow",
        plain="the clock of the pressures is slow",
        amplitude=EffectParameter("skew", "1", "ppm", 1e-6, nominal=0.0, typical=1e-4, low=0.0, high=2e-3),
        change=adds("pressure_clock_skew", "skew"),
        touches=frozenset({"sensor", "timing"}),
        confusers=("pressure_latency", "pressure_lag"),
        equation=(
            "p_m(t) = p(t − εt)\n"
            "p_m: measured pressure, p: true pressure (Pa); t: time since the start of the rig (s); ε: skew"
        ),
        source="crystals differ by 20 to 100 ppm",
        separated_by="the same motion at the start and at the end of a long recording",
    ),
    # Sample and hold: pressures are refreshed only every T, p_m(t) = p(t − a (t mod T)); with a = 1 they are held
    # between.
    #
    # Between 0 and 1 the age of the readings grows more slowly than time, so they are smooth in a at 0.
    Effect(
        name="sample_and_hold",
        family="acquisition",
        title="pressures are held between infrequent samples",
        plain="the pressures are held between infrequent samples",
        amplitude=EffectParameter("hold", "1", "%", 0.01, nominal=0.0, typical=1.0, low=0.0, high=1.0),
        change=_sample_and_hold,
        shapes=(
            EffectParameter(
                "period", "s", "ms", 1e-3, nominal=0.05, typical=0.05, low=0.01, high=0.2, logarithmic=True
            ),
        ),
        grid=((0.02,), (0.05,), (0.1,)),
        touches=frozenset({"sensor", "timing"}),
        confusers=("pressure_latency", "pressure_lag"),
        phenomenon="a delay of the pressure readings",
        equation=(
            "p_m(t) = p(t − a (t mod T))\n"
            "p_m: measured pressure, p: true pressure (Pa); t: time, T: period (s), t mod T: time since the last "
            "sample (s); a: hold (100 %: constant between samples)"
        ),
        source="a module that converts or polls more rarely than it sends",
        separated_by="a fast motion sampled at 200 Hz: the pressures have steps",
    ),
    # Quantisation: force and pressure channels have coarse converters, steps of a share of their range.
    #
    # Readings jump by the step, so they are not differentiable in its size. The rig can have this effect; a
    # diagnosis treats it as noise.
    Effect(
        name="quantisation",
        family="acquisition",
        title="coarse converters of forces and pressures",
        plain="the converters of forces and pressures are coarse",
        amplitude=EffectParameter("step", "1", "%", 0.01, nominal=0.0, typical=2.0**-12, low=0.0, high=0.01),
        change=_quantisation,
        touches=frozenset({"sensor"}),
        equation=(
            "s_m = q ⌊s/q + ½⌋,  q = step · range\n"
            "s_m: reading, s: true value, q: size of a step, range: range of the channel (in the unit of the "
            "channel); step: relative step; ⌊ ⌋: rounded down"
        ),
        source="12 bits are a step of 0.024 % of the range",
        separated_by="a histogram of the readings at rest",
        smooth=False,
    ),
)
