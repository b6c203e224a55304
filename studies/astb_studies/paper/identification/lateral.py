"""Lateral stiffness against pressure and amplitude: membrane, shell and friction told apart (figure 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi, tau
from typing import Final

import numpy as np
import numpy.typing as npt

from astb_studies.paper.identification.curves import Sheared
from astb_studies.paper.identification.fits import PRESSURE_ZERO, Fit, Floats, fit, in_units
from astb_studies.paper.identification.parameter_file import Known
from astb_studies.paper.sweeps.pressure import SLOW

#: First harmonics: what comes back from run to run.
HARMONIC_SCATTER: Final = 0.3e3  # N/m
_PHASES: Final = (np.arange(256) + 0.5) / 256 * pi


def friction_stiffness(amplitude: Floats, limit: Floats, travel: float) -> npt.NDArray[np.complex128]:
    """Return the first harmonic (N/m) of Berg's friction in its settled loop of ``amplitude`` (m).

    The loop turns at ±F_0 with F_0 = F_max/(2 x_2) [√(x_2² + x_0² + 6 x_2 x_0) − x_2 − x_0].
    """
    a = np.asarray(amplitude)[..., None]
    F_max = np.asarray(limit)[..., None]
    level = (np.sqrt(travel**2 + a**2 + 6 * travel * a) - travel - a) / (2 * travel)
    s = a * (1 - np.cos(_PHASES))  # up from the lower turning point
    force = F_max * (-level + s / (travel * (1 + level) + s) * (1 + level))
    # x = −a cos θ, and the way down is the way up turned round.
    harmonic = 2 / pi * np.sum(force * np.exp(-1j * _PHASES), axis=-1) * (pi / _PHASES.size)
    return np.asarray(harmonic / -a[..., 0])


def lateral_stiffness(
    value: Mapping[str, float], pressure: Floats, amplitude: Floats, frequency: float, known: Known
) -> npt.NDArray[np.complex128]:
    """Return the first harmonic K (N/m) of membrane, shell and friction in series with the emergency spring."""
    stack, travel = known["emergency_stiffness_lateral"], known["membrane_travel"]
    maxwell = tau * frequency * known.all("maxwell_time")
    shell = value["shell_stiffness_lateral"] * (
        1 + np.sum(known.all("maxwell_ratio") * 1j * maxwell / (1 + 1j * maxwell))
    )
    limit = value["friction_lateral"] + value["friction_lateral_slope"] * pressure
    own = np.array(amplitude)
    K = np.zeros(own.shape, np.complex128)
    for _ in range(4):  # the bellows takes what the emergency spring leaves
        membrane = value["membrane_length"] * pressure * (1 - 1.5 * (own / travel) ** 2)
        K = membrane + shell + friction_stiffness(own, limit, value["friction_lateral_travel"])
        own = amplitude * np.abs(stack / (K + stack))
    return np.asarray(K * stack / (K + stack))


def fit_lateral_stiffness(found: Sequence[Sheared], known: Known) -> Fit:
    """Fit κ_0, shell stiffness and Berg's friction to first harmonics over pressure and amplitude, at design height.

    Membrane and friction both grow with pressure: only the amplitude tells them apart, so all amplitudes are fitted at
    once. How the shell creeps (its Maxwell branches) is known.
    """
    pressure = np.concatenate([one.pressure for one in found])
    amplitude = np.concatenate([one.amplitude for one in found])
    stiffness = np.concatenate([one.stiffness for one in found])
    names = (
        "membrane_length",
        "shell_stiffness_lateral",
        "friction_lateral",
        "friction_lateral_slope",
        "friction_lateral_travel",
    )
    start = {name: known[name] for name in names} | {"pressure_zero": 0.0}

    def residuals(x: Mapping[str, float]) -> Floats:
        gauge = pressure - x["pressure_zero"] * PRESSURE_ZERO
        miss = (lateral_stiffness(x, gauge, amplitude, SLOW, known) - stiffness) / HARMONIC_SCATTER
        return np.concatenate([miss.real, miss.imag, [x["pressure_zero"]]])

    return in_units(fit(residuals, start), {"pressure_zero": PRESSURE_ZERO})
