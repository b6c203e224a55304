"""The bench's experiments repeated by the plant's model with identified parameters, as jobs for several processes."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from astb_studies.paper import plant_curves
from astb_studies.paper.bench_results import BenchResults, at_once_on_the_model
from astb_studies.paper.identified import Identified
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.sweeps.frequency import SMALL_FREQUENCIES
from astb_studies.paper.sweeps.offset import DITHER, DITHER_FREQUENCY, OFFSETS, STAIRS
from astb_studies.paper.sweeps.pressure import AMPLITUDES
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.arrays import Floats
from bench_protocol.units import Hz, mm
from test_plans.steps.rolled import ROLL_AMPLITUDE, ROLL_FREQUENCY, ROLL_SHEAR

Curves = dict[str, npt.NDArray[Any]]

#: The frequency sweeps of the bench: direction, and the connection between bellows and auxiliary chamber.
SWEEPS: Final = (
    ("Vertical", "orifice"),
    ("Lateral", "orifice"),
    ("Vertical", "pipe"),
    ("Lateral", "pipe"),
    ("Vertical", "pipe, 0.5 mm"),
)

#: Name of the curves, the function that computes them, and its arguments after the identified parameters.
Job = tuple[str, Callable[..., Curves], tuple[Any, ...]]


def model_jobs(bench: BenchResults, identified: Identified, file: Path) -> Iterator[Job]:
    """Yield the experiments that the model repeats at what the first rig measured: name, function, arguments.

    ``file`` has the identified parameters.
    The model has the measured pressure, corrected for the zero of the transducers; `preload` is the resulting load.
    """
    zero = identified.pressure_zero
    area = identified.parameters["effective_area"].value

    def preload(plan: str, phase: str, skip: int = 0, count: int | None = None) -> float:
        return area * (bench.pressure(plan, phase, skip, count) - zero)

    for k, load in enumerate(LOADS):
        plan = f"lateral_pressure_{load.lower()}"
        found = [
            bench.points(plan, f"Lateral amplitude per spring, {load}", f"{a / mm:g} mm", first=True)
            for a in sorted(AMPLITUDES)
        ]
        yield f"lateral {load}", lateral, ([one.x - zero for one in found], [one.y for one in found])
        yield f"at once {load}", at_once_on_the_model, (str(file), load)
        rolls = bench.points(
            f"roll_angle_{load.lower()}",
            "Lateral secant F/y at +20 mm per spring",
            f"{load}, valve isolated",
            first=True,
        )
        yield f"roll {load}", rolled, (load, np.unique(rolls.x))
        plan, before = f"frequency_sweep_{load.lower()}", {"Vertical": 0, "Lateral": 0}
        for direction, pipe in SWEEPS:
            sweep = bench.points(plan, f"{direction} amplitude per spring", f"{load}, {pipe}", first=True)
            carried = preload(plan, f"{direction.lower()} sine", before[direction], sweep.x.size)
            before[direction] += sweep.x.size + (len(SMALL_FREQUENCIES) if direction == "Lateral" else 0)
            args = direction, load, pipe, sweep.x, sweep.y, carried
            yield f"{direction.lower()} {load}, {pipe}", swept, args
        carried = preload("lateral_offset", "dither", k * len(OFFSETS), len(OFFSETS))
        yield f"offset {load}", offset, (load, carried)
    skip = 0
    for plate in PLATES:
        name = f"{plate / mm:g} mm"
        one = bench.points("damping_ratio", "Vertical damping c over amplitude, AW0", name, first=True)
        carried = preload("damping_ratio", "vertical sine", skip, one.x.size)
        skip += one.x.size
        yield f"damping {name}", damping, (plate, one.x, carried)


def lateral(fitted: dict[str, float], pressure: Sequence[Floats], amplitude: Sequence[Floats]) -> Curves:
    """Lateral stiffness at the bench's pressures (Pa) and amplitudes (m), rows by amplitude."""
    return {"K": plant_curves.lateral(Subject(fitted), np.array(pressure), np.array(amplitude))}


def rolled(fitted: dict[str, float], load: str, roll: Floats) -> Curves:
    """Secant and first harmonic at the bench's roll angles (rad)."""
    secant, K = plant_curves.rolled(Subject(fitted), load, roll, ROLL_SHEAR, ROLL_AMPLITUDE, ROLL_FREQUENCY)
    return {"roll": roll, "secant": secant, "K": K}


def swept(
    fitted: dict[str, float],
    direction: str,
    load: str,
    pipe: str,
    f: Floats,
    amplitude: Floats,
    preload: float,
) -> Curves:
    """Stiffness over the bench's frequencies (Hz) at its amplitudes (m); vertically also without rubber."""
    subject = Subject(fitted)
    as_built: dict[str, Any] = {} if pipe == "orifice" else dict(plant_curves.PIPE)
    fit = as_built | {"nominal_preload": preload}
    if direction == "Lateral":
        return {"f": f, "K": plant_curves.lateral_over_frequency(subject, load, amplitude, f, **fit)}
    return {
        "f": f,
        "K": plant_curves.vertical(subject, load, amplitude, f, **fit)[0],
        "orifice": plant_curves.vertical(subject, load, amplitude, f, "rubber", **fit)[0],
    }


def offset(fitted: dict[str, float], load: str, preload: float) -> Curves:
    """Secants and tangents over lateral displacement."""
    subject, fit = Subject(fitted), {"nominal_preload": preload}
    places = np.linspace(0.0, 60.0, 13) * mm
    sizes, stairs = plant_curves.secant_of_stairs(subject, load, STAIRS, **fit)
    return {
        "y": places,
        "secant": plant_curves.secant(subject, load, np.maximum(places, 1 * mm), **fit),
        "tangent": plant_curves.tangent(subject, load, places, DITHER, DITHER_FREQUENCY, **fit),
        "sizes": sizes,
        "stairs": stairs,
    }


def damping(fitted: dict[str, float], plate: float, amplitude: Floats, preload: float) -> Curves:
    """Vertical stiffness at 1.2 Hz with one orifice plate (m), as the plant is and with its orifice alone."""
    subject = Subject(fitted)
    fit: dict[str, Any] = {"nominal_preload": preload, "orifice_diameter": plate}
    whole, ratio = plant_curves.vertical(subject, "AW0", amplitude, np.array(NATURAL), **fit)
    orifice, _ = plant_curves.vertical(subject, "AW0", amplitude, np.array(NATURAL), "rubber", **fit)
    return {"K": whole, "orifice": orifice, "ratio": ratio}


def confusable(quick: bool) -> Curves:
    """Rubber, a lag and a wrong C_d side by side over frequency and amplitude, and in the force without the gas."""
    f = np.geomspace(0.3, 10.0, 16 if quick else 36) * Hz
    a = np.geomspace(1.0, 25.0, 12 if quick else 24) * mm
    subject = Subject()
    over_f = plant_curves.lookalikes(subject, "AW0", np.array(5 * mm), f)
    over_a = plant_curves.lookalikes(subject, "AW0", a, np.array(NATURAL))
    rest = plant_curves.residuals(subject, "AW0", 5 * mm, f)
    return (
        {"f": f, "a": a}
        | {f"{name} over f": K for name, K in over_f.items()}
        | {f"{name} over a": K for name, K in over_a.items()}
        | {f"{name} left": K for name, K in rest.items()}
    )
