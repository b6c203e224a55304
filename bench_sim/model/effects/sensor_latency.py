"""Sensor latency: what the sensors of one kind see arrives late, s_m(t) = s(t − τ).

The delay is interpolated between the outputs of the steps (`bench_sim.model.sensors`), so that the readings are smooth
in τ at 0. Readings are stamped on arrival: their time stamps do not show the delay.

The displacements are those of both springs, of all pistons and of the platform. A replay is driven by most of them, and
all else then seems to come early.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change_forces(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.force_latency += values["delay"]


def _change_pressures(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.pressure_latency += values["delay"]


def _change_displacements(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.displacement_latency += values["delay"]


EFFECTS: Final = (
    Effect(
        name="force_latency",
        family="acquisition",
        title="forces arrive late",
        plain="the forces arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=_change_forces,
        touches=frozenset({"sensor", "timing"}),
        confusers=("force_lag", "maxwell"),
        phenomenon="a delay of the force readings",
        equation="F_m(t) = F(t − τ)",
        source="queueing in a gateway or on a busy bus",
        separated_by="large sines up to 12.5 Hz: a delay turns the phase and leaves the amplitude, a lag does both",
    ),
    Effect(
        name="pressure_latency",
        family="acquisition",
        title="pressures arrive late",
        plain="the pressures arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.1),
        change=_change_pressures,
        touches=frozenset({"sensor", "timing"}),
        confusers=("pressure_lag", "sample_and_hold", "clock_skew"),
        phenomenon="a delay of the pressure readings",
        equation="p_m(t) = p(t − τ)",
        source="polling period of a fieldbus gateway",
        separated_by="large sines up to 12.5 Hz: a delay turns the phase and leaves the amplitude, a lag does both",
    ),
    Effect(
        name="displacement_latency",
        family="acquisition",
        title="displacements arrive late",
        plain="the displacements arrive late",
        amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=_change_displacements,
        touches=frozenset({"sensor", "timing"}),
        confusers=("maxwell", "platen_inertia"),
        equation="z_m(t) = z(t − τ)",
        source="averaging in the controller of a laser; a slower bus for the actuators' transducers",
        separated_by="a sudden stop of the motion: forces and pressures end before the displacement does",
    ),
)
