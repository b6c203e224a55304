"""FMUs of springs and bench, compared with the plant itself and with the same laws in an FMU of pythonfmu3."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from astb.fmu.export import ExportError, compile_code, write_unit
from astb.fmu.models import unit_of
from astb_studies.benchmarks.measure import Effort, Section, Skipped, compare, cpu, interleaved
from bench_protocol.rates import TICK
from bench_sim.model.plant import Plant
from bench_sim.parameters import load

#: Simulated in one call of a subject, s.
SPAN: Final = 1.0
_PYTHON: Final = Path(__file__).parent / "models" / "PythonSprings.py"
_MOTION: Final = ("left.height", "right.height", "left.height_speed", "right.height_speed")
_READ: Final = ("left.vertical_force", "right.vertical_force", "left.bellows_pressure")


class Opened:
    """One instance of an FMU in FMPy, ready to step."""

    def __init__(self, path: Path) -> None:
        import fmpy
        from fmpy.fmi3 import FMU3Slave

        model = fmpy.read_model_description(str(path))
        numbers = {one.name: one.valueReference for one in model.modelVariables}
        self.fmu = FMU3Slave(
            guid=model.instantiationToken,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.fmu.instantiate()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.motion = [numbers[name] for name in _MOTION if name in numbers]
        self.read = [numbers[name] for name in _READ]
        self.ticks = 0

    def step(self, ticks: int) -> None:
        """Take one communication step of a number of ticks."""
        self.fmu.doStep(self.ticks * TICK, ticks * TICK)
        self.ticks += ticks

    def drive(self, ticks: int) -> Callable[[], None]:
        """Return a function that drives the FMU through `SPAN` in steps of ``ticks`` ticks, and reads it after each."""

        def driven() -> None:
            for n in range(round(SPAN / TICK / ticks)):
                self.fmu.setFloat64(self.motion, [1e-6 * n, 1e-6 * n, 1e-3, 1e-3])
                self.step(ticks)
                self.fmu.getFloat64(self.read)

        return driven


def _make_fmus(folder: Path) -> dict[str, Path]:
    """Return the FMUs; Skipped without a C compiler."""
    made = {}
    try:
        for name, native in (("spring", False), ("bench", False), ("bench", True)):
            place = folder / f"{name}{int(native)}"
            place.mkdir()
            unit = unit_of(name)
            compile_code(unit.code, place, native=native)
            made[place.name] = place / f"{name}.fmu"
            write_unit(unit, made[place.name], fmi=3, compiled=place)
    except ExportError as error:
        raise Skipped(str(error)) from None
    from pythonfmu3.builder import FmuBuilder

    FmuBuilder.build_FMU(_PYTHON, dest=folder)
    made["python"] = folder / "PythonSprings.fmu"
    return made


def run(effort: Effort) -> Section:
    """Measure all of them in turn."""
    with tempfile.TemporaryDirectory() as text:
        fmus: dict[str, Any] = {name: Opened(path) for name, path in _make_fmus(Path(text)).items()}
        plant = Plant.at_rest(load().record)
        ticks = round(SPAN / TICK)

        def plant_by_ticks() -> None:
            for _ in range(ticks):
                plant.step(1)

        def bench_by_ticks() -> None:
            for _ in range(ticks):
                fmus["bench0"].step(1)

        found = interleaved(
            effort.repetitions,
            {
                "plant": lambda: cpu(lambda: plant.step(ticks), ticks),
                "bench": lambda: cpu(lambda: fmus["bench0"].step(ticks), ticks),
                "native": lambda: cpu(lambda: fmus["bench1"].step(ticks), ticks),
                "plant, 1": lambda: cpu(plant_by_ticks, ticks),
                "bench, 1": lambda: cpu(bench_by_ticks, ticks),
                "springs, 1": lambda: cpu(fmus["spring0"].drive(1), ticks),
                "python, 1": lambda: cpu(fmus["python"].drive(1), ticks),
                "springs, 20": lambda: cpu(fmus["spring0"].drive(20), ticks),
                "python, 20": lambda: cpu(fmus["python"].drive(20), ticks),
            },
        )
    rows = [
        compare(
            "bench FMU, a tick", found["bench"], "the plant, its measuring chain included", found["plant"]
        ),
        compare("bench FMU with --native, a tick", found["native"], "the plant", found["plant"]),
        compare(
            "bench FMU in steps of 1 ms, a tick",
            found["bench, 1"],
            "the plant, a call from Python for each tick",
            found["plant, 1"],
        ),
        compare(
            "springs FMU in steps of 1 ms, a tick", found["springs, 1"], "by pythonfmu3", found["python, 1"]
        ),
        compare(
            "springs FMU in steps of 20 ms, a tick",
            found["springs, 20"],
            "by pythonfmu3",
            found["python, 20"],
        ),
    ]
    notes = (
        f"Bench and plant take {SPAN:g} s in one call, at rest, unless it is said. The springs are driven by FMPy: "
        "each communication step sets four inputs and reads three outputs, which is most of a step of 1 ms. What "
        "pythonfmu3 has made calls the same compiled laws, from Python. Processor time of one thread.",
    )
    return Section("FMUs", rows, notes)
