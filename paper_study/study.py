"""Everything that the figures, the table and the claims need, computed over all cores and put side by side."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from itertools import count
from os import cpu_count
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.units import Hz, mm
from paper_study import plant_curves, sensitivity
from paper_study.bench_results import PLANS, BenchResults, gather, measure
from paper_study.checks.catalogue import CHECKS, select
from paper_study.checks.evaluation import entry
from paper_study.experiments import paper_ride, plant_ride
from paper_study.sensitivity import Indices
from paper_study.subject import LOADS, Subject
from test_plans.by_frequency import SMALL_FREQUENCIES
from test_plans.by_offset import DITHER, DITHER_FREQUENCY, OFFSETS, STAIRS
from test_plans.by_pressure import AMPLITUDES
from test_plans.by_ratio import NATURAL
from test_plans.by_roll import ROLL_AMPLITUDE, ROLL_FREQUENCY, ROLL_SHEAR
from test_plans.damping_ratio import PLATES
from test_plans.identification.parameter_file import write_parameters
from test_plans.identification.spring import Identified, identify

Floats = npt.NDArray[np.float64]
Curves = dict[str, npt.NDArray[Any]]

#: Called with a kind of work, how many parts of it are ready, and how many there are.
Progress = Callable[[str, int, int], None]

BENCH, CHECKED, MODEL, SENSITIVITY, FIGURES = (
    "bench experiments",
    "claims and checks",
    "model beside the bench",
    "global sensitivity",
    "figures and page",
)

_BASE: Final = files("bench_sim.parameters") / "astb.toml"
#: The frequency sweeps of the bench: direction, and what stands between bellows and auxiliary chamber.
SWEEPS: Final = (
    ("Vertical", "orifice"),
    ("Lateral", "orifice"),
    ("Vertical", "pipe"),
    ("Lateral", "pipe"),
    ("Vertical", "pipe, 0.5 mm"),
)
#: What `astb paper` writes beside the page.
IDENTIFIED: Final = "identified.toml"


@dataclass(frozen=True, slots=True)
class ComfortRow:
    """One cell of the comfort table: a_y (m/s² rms) and N with half widths of their 95 % intervals (nan: none)."""

    layer: str
    load: str
    wind_speed: float
    acceleration: float
    acceleration_width: float
    peak: float
    comfort: float
    comfort_width: float
    displacement: float
    bump_stop_time: float


@dataclass(frozen=True, slots=True)
class Study:
    """The results, all of them plain numbers: the same ones for the same seed, whatever the number of cores."""

    quick: bool
    seeds: tuple[int, ...]
    realisations: int
    bench: BenchResults
    identified: Identified
    model: dict[str, Curves]
    rides: list[ComfortRow]
    sensitivity: dict[str, Indices]
    entries: list[dict[str, Any]]

    @property
    def fitted(self) -> dict[str, float]:
        """The identified parameters of the plant, SI."""
        return {name: one.value for name, one in self.identified.parameters.items()}


def pool(workers: int | None = None) -> Executor:
    """Return spawned processes, one for each core unless told otherwise: numba and a fork do not go together."""
    return ProcessPoolExecutor(
        workers or min(cpu_count() or 1, 16), mp_context=multiprocessing.get_context("spawn")
    )


@contextmanager
def _given_up_on_error(executor: Executor) -> Iterator[None]:
    """Do not begin what nobody will look at."""
    try:
        yield
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise


def study(executor: Executor, out: Path, *, quick: bool, seed: int, progress: Progress) -> Study:
    """Run everything and return it; the bench's records lie below ``out``.

    ``quick`` measures on one rig instead of three, with one realisation of the wind instead of ten and a small sample
    of the sensitivity. NoBenchResult if a plan was blocked.
    """
    seeds = (seed,) if quick else (seed, seed + 1, seed + 2)
    with _given_up_on_error(executor):
        groups = claim_groups()
        tables = _sensitivity_tables(quick)
        # The rides are one long piece: they come first. Then the bench, for which the next stage waits.
        checked: list[Future[Any]] = [executor.submit(check_group, groups[0], quick)]
        measured = [executor.submit(measure, plan, one, out) for plan in PLANS for one in seeds]
        checked += [executor.submit(check_group, ids, quick) for ids in groups[1:]]
        spread = {
            layer: [executor.submit(sensitivity.evaluate, layer, part) for part in parts]
            for layer, (parts, _) in tables.items()
        }
        confused = executor.submit(confusable, quick)
        _watch(BENCH, measured, progress)
        _watch(CHECKED, checked, progress)
        _watch(SENSITIVITY, [future for futures in spread.values() for future in futures], progress)
        for future in measured:
            future.result()
        bench = gather(out, seeds)
        identified = _identify(bench, seeds, out)
        fitted = {name: one.value for name, one in identified.parameters.items()}
        modelled = {
            name: executor.submit(job, fitted, *args) for name, job, args in _beside(bench, identified)
        }
        modelled["confusable"] = confused
        _watch(MODEL, [*modelled.values()], progress)
        for future in as_completed(
            [*checked, *modelled.values(), *(f for fs in spread.values() for f in fs)]
        ):
            future.result()

    entries: dict[int, dict[str, Any]] = {}
    rides: list[ComfortRow] = []
    for one in checked:
        found, of_the_table = one.result()
        entries |= found
        rides += of_the_table
    return Study(
        quick,
        seeds,
        1 if quick else 10,
        bench,
        identified,
        {name: future.result() for name, future in modelled.items()},
        rides,
        {
            layer: sensitivity.indices(
                layer, np.concatenate([f.result() for f in futures], axis=1), tables[layer][1]
            )
            for layer, futures in spread.items()
        },
        [entries[place] for place in sorted(entries)],
    )


def _watch(kind: str, futures: Sequence[Future[Any]], progress: Progress) -> None:
    """Tell how many are ready, from whichever thread the news comes."""
    ready = count(1)
    progress(kind, 0, len(futures))
    for future in futures:
        future.add_done_callback(lambda _: progress(kind, next(ready), len(futures)))


# -- claims and checks, and the rides of the table -----------------------------------------------------------------


def claim_groups() -> list[list[str]]:
    """Group the ids whose checks share experiments, so that one process measures them once; the rides come first."""
    groups: list[tuple[set[str], set[str]]] = []
    for check in CHECKS:
        names, ids = {check.shares} - {""}, {check.id}
        apart = []
        for known_names, known_ids in groups:
            if known_names & names or known_ids & ids:
                names, ids = names | known_names, ids | known_ids
            else:
                apart.append((known_names, known_ids))
        groups = [*apart, (names, ids)]
    ordered = sorted(groups, key=lambda group: ("ride" not in group[0], sorted(group[1])))
    return [sorted(ids) for _, ids in ordered]


def check_group(ids: Sequence[str], quick: bool) -> tuple[dict[int, dict[str, Any]], list[ComfortRow]]:
    """Evaluate some checks; with the rides among them also return the cells of the table, which they have measured."""
    subject = Subject(quick=quick)
    entries = {place: entry(CHECKS[place], subject) for place in select(ids)}
    return entries, _rides(subject) if "A27" in ids else []


def _rides(subject: Subject) -> list[ComfortRow]:
    nan = float("nan")
    table = []
    for (load, speed), cell in plant_ride(subject).items():
        a, N = cell.estimate("acceleration"), cell.estimate("weighted", 6.0)
        table.append(
            ComfortRow(
                "plant",
                load,
                speed,
                a.mean,
                a.half_width,
                cell.estimate("peak_acceleration").mean,
                N.mean,
                N.half_width,
                cell.estimate("mean_lateral").mean,
                cell.estimate("bump_stop_time").mean,
            )
        )
    for (load, speed), (rms, index) in paper_ride(subject).items():
        table.append(ComfortRow("paper", load, speed, rms, nan, nan, index, nan, nan, nan))
    return table


# -- identification, and the model beside the bench ----------------------------------------------------------------


def _identify(bench: BenchResults, seeds: Sequence[int], out: Path) -> Identified:
    """Identify from the first rig's curves and leave the parameter file."""
    base = _BASE.read_text(encoding="utf-8")
    curves = [
        bench.results[plan][0].curves
        for plan in ("lateral_offset", "lateral_pressure_aw0", "lateral_pressure_aw3")
    ]
    identified = identify(curves[0], curves[1], curves[2], base)
    write_parameters(out / IDENTIFIED, base, identified.parameters, f"astb paper, bench/lateral_*-{seeds[0]}")
    return identified


_Job = tuple[str, Callable[..., Curves], tuple[Any, ...]]


def _beside(bench: BenchResults, identified: Identified) -> Iterator[_Job]:
    """The experiments that the model repeats at what the first rig measured: name, function, arguments.

    The model stands at the pressure that the bench read, less the transducers' zero: `preload` is what it then carries.
    """
    zero = identified.area_and_volume["pressure_zero"]
    area = identified.area_and_volume["effective_area"]

    def preload(plan: str, phase: str, skip: int = 0, count: int | None = None) -> float:
        return area * (bench.pressure(plan, phase, skip, count) - zero)

    for k, load in enumerate(LOADS):
        plan = f"lateral_pressure_{load.lower()}"
        found = [
            bench.points(plan, f"Lateral amplitude per spring, {load}", f"{a / mm:g} mm", first=True)
            for a in sorted(AMPLITUDES)
        ]
        yield f"lateral {load}", lateral, ([one.x - zero for one in found], [one.y for one in found])
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
    over_f = plant_curves.impostors(subject, "AW0", np.array(5 * mm), f)
    over_a = plant_curves.impostors(subject, "AW0", a, np.array(NATURAL))
    rest = plant_curves.residuals(subject, "AW0", 5 * mm, f)
    return (
        {"f": f, "a": a}
        | {f"{name} over f": K for name, K in over_f.items()}
        | {f"{name} over a": K for name, K in over_a.items()}
        | {f"{name} left": K for name, K in rest.items()}
    )


# -- sensitivity ---------------------------------------------------------------------------------------------------


def _sensitivity_tables(quick: bool) -> dict[str, tuple[list[Floats], int]]:
    """For each layer the parameter sets in parts for the processes, and the size of the sample."""
    subject = Subject()
    tables = {}
    for layer, n, parts in (("plant", 32 if quick else 256, 4 if quick else 24), ("paper", 1024, 1)):
        whole = sensitivity.sets(sensitivity.nominal(subject, layer), n)
        tables[layer] = (np.array_split(whole, parts, axis=1), n)
    return tables
