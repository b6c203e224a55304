"""Input data on the page: tables 1 to 3, both topologies of the spring, gusts along the train."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from astb_studies.paper.closed_form import combined, diaphragm_stiffness, layered_stiffness
from astb_studies.paper.parameters import load_paper
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.wind import coherence, line_admittance
from bench_protocol.units import Hz, kN, m, s
from bench_sim.parameters import load
from bench_sim.parameters.loading import Entry
from bench_sim.parameters.vehicle import load_vehicle

#: The parameters of the bench, of the track and of the simulation, by the names of their files.
BENCH: Final = (
    "bolster_mass",
    "spring_half_spacing",
    "actuator_half_spacing",
    "actuator_stroke",
    "actuator_force_limit",
    "effective_area",
    "bellows_volume",
    "auxiliary_volume",
    "orifice_diameter",
    "dpv_opening",
    "supply_pressure",
)
TRACK: Final = (
    "train_speed",
    "track_shape",
    "track_wavelength",
    "track_vertical",
    "track_lateral",
)
SIMULATION: Final = (
    "polytropic_exponent",
    "lateral_area",
    "lateral_area_decay",
    "bellows_volume",
    "volume_growth",
    "auxiliary_volume",
    "column_height",
    "rubber_shear_modulus",
    "rubber_area",
    "rubber_layers",
    "rubber_layer_thickness",
    "orifice_diameter",
    "discharge_coefficient",
    "pressure_ratio",
)
#: A strong wind of the comfort table, where gusts along the train are looked at.
MEAN_WIND: Final = 25 * m / s
DISTANCES: Final = (5 * m, 10 * m, 20 * m)
FREQUENCIES: Final = (0.1 * Hz, 0.5 * Hz, 1.0 * Hz, 2.0 * Hz)


def tables() -> list[dict[str, Any]]:
    """Return tables 1 to 3, each with its title and its rows: name, value, unit, provenance, source."""
    bench, paper, car = load("astb"), load_paper(), load_vehicle()
    loads = [_row(f"preload, {name}", paper.load_cases[name]) for name in LOADS]
    return [
        {"title": "Table 1. The bench", "rows": [*loads, *_rows(bench.entries, BENCH)]},
        {"title": "Table 2. The track: a unilateral cosine", "rows": list(_rows(car.entries, TRACK))},
        {"title": "Table 3. The simulation", "rows": list(_rows(paper.entries, SIMULATION))},
    ]


def _rows(entries: Mapping[str, Entry], names: tuple[str, ...]) -> Iterator[dict[str, str]]:
    for name in names:
        yield _row(name, entries[name])


def _row(name: str, entry: Entry) -> dict[str, str]:
    numbers = [f"{one / entry.scale:g}" for one in np.ravel(entry.value)]
    value = numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)
    unit = "" if entry.unit == "1" else entry.unit
    return {
        "name": name,
        "value": value,
        "unit": unit,
        "provenance": entry.provenance,
        "source": entry.source,
    }


def topologies() -> list[dict[str, str]]:
    """Return by load case what emergency spring and diaphragm have together, in series and in parallel (kN/m).

    Each row also shows how much stiffer the last load case is than the first, either way.
    """
    found = {}
    for load_case in LOADS:
        spring = Subject().spring(load_case)
        K, K_e = float(diaphragm_stiffness(0.0, spring.pressure, spring)), float(layered_stiffness(spring))
        found[load_case] = {
            "diaphragm": K,
            "emergency": K_e,
            "series": combined(K, K_e, "series"),
            "parallel": combined(K, K_e, "parallel"),
        }
    first, *_, last = found.values()
    rises = {f"rise_{way}": f"+{100 * (last[way] / first[way] - 1):.0f} %" for way in ("series", "parallel")}
    return [
        {"load": load_case, **{name: f"{one / kN:.0f}" for name, one in row.items()}, **rises}
        for load_case, row in found.items()
    ]


def spatial_correlation() -> dict[str, Any]:
    """Return the coherence of the gusts along the train, and the share of their spectrum in the mean over a car."""
    wind = load_paper().wind
    return {
        "mean": f"{MEAN_WIND:g}",
        "train": f"{3.6 * wind.train_speed:g}",
        "length": f"{wind.car_length:g}",
        "decay": f"{wind.coherence_decay:g}",
        "distances": [f"{one:g}" for one in DISTANCES],
        "rows": [
            (
                f"{f:g} Hz",
                *(f"{float(coherence(f, distance, MEAN_WIND, wind)):.2f}" for distance in DISTANCES),
                f"{float(line_admittance(f, MEAN_WIND, wind)):.2f}",
            )
            for f in FREQUENCIES
        ],
    }
