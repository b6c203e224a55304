"""The paper's closed forms as the figures show them: diaphragm and emergency spring in series."""

from typing import Any, Final

import numpy as np

from astb_studies.paper.bench_results import BenchResults
from astb_studies.paper.closed_form import combined, diaphragm_stiffness, layered_stiffness
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.arrays import Floats
from bench_protocol.units import mm

#: Pressure ratio at which (18) is linearised where an orifice should hardly damp.
SMALL_LOSS: Final = 0.9995


def closed_stiffness(load: str, gauge: Floats, **changes: Any) -> Floats:
    """Return (10) and (16) in series, in N/m, at gauge pressures (Pa)."""
    par = Subject().spring(load, **changes)
    K = diaphragm_stiffness(0.0, gauge + par.atmospheric_pressure, par)
    return np.asarray(combined(K, layered_stiffness(par), "series"), np.float64)


def closed_secant(load: str, y: Floats) -> Floats:
    """Return (10) and (16) in series, in N/m, over lateral displacement (m) at the pressure of the load."""
    par = Subject().spring(load)
    return np.asarray(
        combined(diaphragm_stiffness(y, par.pressure, par), layered_stiffness(par), "series"), np.float64
    )


def closed_tangent(load: str, y: Floats) -> Floats:
    """Return the slope of F = K(y) y of `closed_secant`, in N/m."""
    step = 0.01 * mm
    ahead, behind = y + step, y - step
    return (closed_secant(load, ahead) * ahead - closed_secant(load, behind) * behind) / (2.0 * step)


def fitted_lateral_area(bench: BenchResults) -> float:
    """The one A_L0 (m²) with which (10) and (16) come nearest to the bench's 5 mm under both loads.

    Least squares on the diaphragm's part of the measured stiffness: K_r = n p A²/V_0.
    """
    above = below = 0.0
    for load in LOADS:
        par = Subject().spring(load)
        one = bench.lateral_stiffness(load, 5 * mm)
        K_e = float(np.asarray(layered_stiffness(par)))
        K_r = one.y * K_e / (K_e - one.y)
        p = one.x + float(np.asarray(par.atmospheric_pressure))
        slope = float(np.asarray(par.polytropic_exponent / par.bellows_volume)) * p
        above += float(np.sum(K_r * slope))
        below += float(np.sum(slope * slope))
    return float(np.sqrt(above / below))
