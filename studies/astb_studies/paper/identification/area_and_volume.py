"""Effective area and volume of the bellows against height and shear, from springs shut off from their chambers.

The plant's law of an inextensible bellows, at its own displacement (ζ_b, y_b) behind the emergency spring:

    V = V_0 + A_0 ζ_b + ½ A_1 ζ_b² − ½ (κ_0 + κ_1 ζ_b) Y,  A_e = A_0 + A_1 ζ_b − ½ κ_1 Y,  Y = y_b²/(1 + (y_b/y_s)²)

and the paper's ``A = A_L0 (1 − α y²)``, ``V = V_0 (1 + β y²)`` (figure 7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from astb_studies.paper.identification.curves import Isolated
from astb_studies.paper.identification.fits import PRESSURE_ZERO, Fit, Floats, fit, in_units
from astb_studies.paper.identification.parameter_file import Known
from bench_protocol.units import ATMOSPHERE, N, mm

#: What a mean over 2 s is good for: the wire's step of 25 N a cell, friction that creeps by a tenth of its 300 N; and
#: for T/p thermometers in steps of 0.05 K, two of them.
FORCE_SCATTER: Final = 25 * N
GAS_SCATTER: Final = 1e-4
#: Zeros by the data sheets, evenly spread within: 200 N on each of four load cells (half of them a spring), and in each
#: load the vertical friction that was left.
FORCE_ZERO: Final = 200 * N / 3**0.5
FRICTION_LEFT: Final = 60 * N


def shape(y: Floats, travel: float) -> Floats:
    """Y = y²/(1 + (y/y_s)²) in m²."""
    return np.asarray(y**2 / (1 + (y / travel) ** 2))


def own_displacements(one: Isolated, known: Known) -> tuple[Floats, Floats]:
    """Return (ζ_b, y_b): what the bellows itself is lifted and sheared, without its emergency spring."""
    height = one.height + (one.vertical - one.preload) / known["emergency_stiffness_vertical"]
    return height, one.shear - one.lateral / known["emergency_stiffness_lateral"]


def fit_area_and_volume(steps: Sequence[Isolated], known: Known) -> Fit:
    """Fit A_0, κ_1, V_0 and κ_0 to force, pressure and temperature of isolated bellows under several loads.

    ``F_z = p A_e − k_z ζ_b`` where the springs were sheared, and ``p V/T = const`` everywhere. Zeros of transducers and
    load cells are fitted within their data sheets, and the mass of gas under each load freely.
    """
    travel, slope = known["membrane_travel"], known["effective_area_slope"]
    shell = known["shell_stiffness_vertical"]
    places = [own_displacements(one, known) for one in steps]
    start = {
        "effective_area": known["effective_area"],
        "bellows_volume": known["bellows_volume"],
        "membrane_length": known["membrane_length"],
        "membrane_length_slope": known["membrane_length_slope"],
        "pressure_zero": 0.0,
        "force_zero": 0.0,
        "lateral_zero": 0.0,
    }
    scale = {"pressure_zero": PRESSURE_ZERO, "force_zero": FORCE_ZERO, "lateral_zero": 1 * mm}
    for k, one in enumerate(steps):
        amount = (one.pressure[0] + ATMOSPHERE) / one.temperature[0] * start["bellows_volume"]
        start[f"gas_{k}"], start[f"friction_{k}"] = 1.0, 0.0
        scale[f"gas_{k}"], scale[f"friction_{k}"] = float(amount), FRICTION_LEFT

    def residuals(x: Mapping[str, float]) -> Floats:
        value = {name: number * scale.get(name, 1.0) for name, number in x.items()}
        parts = [np.array([x["pressure_zero"], x["force_zero"]])]
        for k, (one, (height, y)) in enumerate(zip(steps, places, strict=True)):
            Y = shape(y - value["lateral_zero"], travel)
            gauge = one.pressure - value["pressure_zero"]
            length = value["membrane_length"] + value["membrane_length_slope"] * height
            area = value["effective_area"] + slope * height - 0.5 * value["membrane_length_slope"] * Y
            volume = value["bellows_volume"] + (value["effective_area"] + 0.5 * slope * height) * height
            volume = volume - 0.5 * length * Y
            force = gauge * area - shell * height + value["force_zero"] + value[f"friction_{k}"]
            gas = (gauge + ATMOSPHERE) * volume / (one.temperature * value[f"gas_{k}"])
            parts.append((one.vertical - force)[one.sheared] / FORCE_SCATTER)
            parts.append((gas - 1.0) / GAS_SCATTER)
            parts.append(np.array([x[f"friction_{k}"]]))
        return np.concatenate(parts)

    return in_units(fit(residuals, start), scale)


def fit_paper_law(y: Floats, area: Floats, volume: Floats) -> Fit:
    """Fit the paper's A = A_L0 (1 − α y²) and V/V(0) = 1 + β y² (1/m²) to curves over lateral displacement (m).

    The scatter is what the residuals show.
    """

    def law(values: Floats, name: str, sign: float) -> Fit:
        start = {f"{name}_centre": float(values.max()), name: 1.0}

        def residuals(x: Mapping[str, float]) -> Floats:
            return np.asarray(
                (values - x[f"{name}_centre"] * (1 + sign * x[name] * y**2)) / (1e-4 * values.max())
            )

        return fit(residuals, start)

    first, second = law(area, "alpha", -1.0), law(volume, "beta", 1.0)
    size = len(first.names)
    covariance = np.zeros((2 * size, 2 * size))
    covariance[:size, :size], covariance[size:, size:] = first.covariance, second.covariance
    values = np.concatenate([first.values, second.values])
    return Fit(
        first.names + second.names,
        values,
        covariance,
        max(first.misfit, second.misfit),
        min(first.freedom, second.freedom),
    )
