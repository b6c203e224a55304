"""Global sensitivity: which geometric parameter moves stiffness and damping, by Sobol indices in both layers.

Every parameter is spread evenly over ± 10 % of its value, independent of the others (assumed: the paper gives none).
The estimator is that of `scipy.stats.sobol_indices`; the samples are Sobol's, scrambled with a fixed seed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import qmc, sobol_indices

from astb_studies.paper.closed_form import (
    combined,
    coupling_stiffness,
    diaphragm_stiffness,
    layered_stiffness,
    orifice_damping,
)
from astb_studies.paper.subject import Subject
from bench_protocol.arrays import Floats
from bench_protocol.units import Hz, mm
from bench_sim.model.experiments import LATERAL, dynamic_stiffness

SPREAD: Final = 0.1
LOAD: Final = "AW0"
_SEED: Final = 1
_RESAMPLES: Final = 400
_AMPLITUDE: Final = 5 * mm
_NATURAL: Final = 1.2 * Hz

#: Geometric parameters by name, as they are called on the page.
PAPER: Final = {
    "lateral_area": "lateral area",
    "bellows_volume": "bellows volume V₀",
    "auxiliary_volume": "auxiliary volume",
    "lateral_area_decay": "area decay α",
    "volume_growth": "volume growth β",
    "effective_area": "effective area A₀",
    "column_height": "column height",
    "rubber_area": "rubber area",
    "rubber_layer_thickness": "rubber layer",
    "orifice_diameter": "orifice",
}
PLANT: Final = {
    "effective_area": "effective area A₀",
    "effective_area_slope": "area slope A₁",
    "bellows_volume": "bellows volume V₀",
    "auxiliary_volume": "auxiliary volume",
    "membrane_length": "membrane length κ₀",
    "membrane_travel": "membrane travel",
    "orifice_diameter": "orifice",
}

PAPER_OUTPUTS: Final = (
    "lateral K at 0 mm",
    "lateral K at 60 mm",
    "coupling with roll",
    "vertical c at 1.2 Hz",
)
PLANT_OUTPUTS: Final = ("lateral K′ at 5 mm", "vertical K′ at 1.2 Hz", "vertical c at 1.2 Hz")


@dataclass(frozen=True, slots=True)
class Indices:
    """Sobol indices of one layer, arrays (outputs, parameters), with 95 % intervals from a bootstrap."""

    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    first: Floats
    first_low: Floats
    first_high: Floats
    total: Floats
    total_low: Floats
    total_high: Floats
    samples: int  #: evaluations of the model


def paper_outputs(subject: Subject, x: Mapping[str, Floats]) -> Floats:
    """(10), (16), (12), (19) for arrays of parameters: shape (outputs, n)."""
    par = subject.spring(LOAD, **x)
    p, omega = par.pressure, 2.0 * np.pi * _NATURAL
    rubber = layered_stiffness(par)
    K = [combined(diaphragm_stiffness(y, p, par), rubber, "series") for y in (0.0, 60 * mm)]
    coupling = coupling_stiffness(diaphragm_stiffness(0.0, p, par), par.nominal_preload, par.column_height)
    c = orifice_damping(omega, par.pressure_ratio, par.orifice_diameter, p, par)
    return np.array(np.broadcast_arrays(*K, coupling, c), np.float64)


def plant_outputs(subject: Subject, x: Mapping[str, Floats]) -> Floats:
    """First harmonics of the plant for each set of parameters: shape (outputs, n)."""
    rows = []
    for k in range(len(next(iter(x.values())))):
        changes = {name: float(values[k]) for name, values in x.items()}
        K_y, _ = dynamic_stiffness(
            subject.resting(LOAD, **changes), _AMPLITUDE, 0.5 * Hz, 3, direction=LATERAL, longest_step=4e-3
        )
        K_z, _ = dynamic_stiffness(
            subject.resting(LOAD, **changes), _AMPLITUDE, _NATURAL, 8, longest_step=2e-3
        )
        rows.append((K_y.real, K_z.real, K_z.imag / (2.0 * np.pi * _NATURAL)))
    return np.array(rows).T


def nominal(subject: Subject, layer: str) -> dict[str, float]:
    """Return the values around which a layer's parameters are spread, SI."""
    if layer == "paper":
        spring = subject.spring(LOAD)
        return {name: float(getattr(spring, name)) for name in PAPER}
    record = subject.parameters(LOAD).record
    return {name: float(np.atleast_1d(record[name]).flat[0]) for name in PLANT}


def sets(values: Mapping[str, float], n: int) -> Floats:
    """Sobol's sample as one table of parameter sets, shape (parameters, n (parameters + 2)): A, B, then every AB."""
    d = len(values)
    sample = qmc.Sobol(2 * d, seed=np.random.default_rng(_SEED)).random(n).T
    A, B = sample[:d], sample[d:]
    tables = [A, B]
    for i in range(d):
        mixed = A.copy()
        mixed[i] = B[i]
        tables.append(mixed)
    centre = np.array(list(values.values()))[:, None]
    return np.asarray(centre * (1.0 + SPREAD * (2.0 * np.concatenate(tables, axis=1) - 1.0)))


def evaluate(layer: str, table: Floats) -> Floats:
    """Put one layer to parameter sets (parameters, n): shape (outputs, n)."""
    names, outputs = _LAYERS[layer]
    return outputs(Subject(), dict(zip(names, table, strict=True)))


_Outputs = Callable[[Subject, Mapping[str, Floats]], Floats]
_LAYERS: Final[dict[str, tuple[dict[str, str], _Outputs]]] = {
    "paper": (PAPER, paper_outputs),
    "plant": (PLANT, plant_outputs),
}


def indices(layer: str, values: Floats, n: int) -> Indices:
    """Return the indices of outputs (outputs, n (parameters + 2)) at the sets that `sets` made of a sample of ``n``."""
    parameters, outputs = (PAPER, PAPER_OUTPUTS) if layer == "paper" else (PLANT, PLANT_OUTPUTS)
    d = len(parameters)
    f_A, f_B, *f_AB = (values[:, k * n : (k + 1) * n] for k in range(d + 2))
    first, total = _sobol(f_A, f_B, np.array(f_AB))
    rng = np.random.default_rng(_SEED)
    drawn = [rng.integers(0, n, n) for _ in range(_RESAMPLES)]
    again = np.array([_sobol(f_A[:, i], f_B[:, i], np.array(f_AB)[:, :, i]) for i in drawn])
    low, high = np.percentile(again, (2.5, 97.5), axis=0)
    return Indices(
        tuple(parameters), outputs, first, low[0], high[0], total, low[1], high[1], values.shape[1]
    )


def _sobol(f_A: Floats, f_B: Floats, f_AB: Floats) -> tuple[Floats, Floats]:
    found = sobol_indices(func={"f_A": f_A, "f_B": f_B, "f_AB": f_AB}, n=f_A.shape[1])
    shape = f_A.shape[0], f_AB.shape[0]  # which scipy squeezes
    return found.first_order.reshape(shape), found.total_order.reshape(shape)
