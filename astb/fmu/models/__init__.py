"""FMUs of the springs, the bench and the car, made from parameter sets."""

from pathlib import Path

from astb.fmu.models.bench import bench
from astb.fmu.models.car import car
from astb.fmu.models.springs import springs
from astb.fmu.unit import Unit
from bench_sim.parameters import load
from bench_sim.parameters.vehicle import load_vehicle


def unit_of(
    kind: str, model: str | Path = "astb", load_case: str | None = None, vehicle: str | Path = "vehicle"
) -> Unit:
    """Return the FMU of a ``kind`` (``spring``, ``bench`` or ``car``) with these parameter sets.

    Raises `ParameterError` for an invalid set.
    """
    parameters = load(model, load_case)
    if kind == "car":
        return car(parameters, load_vehicle(vehicle))
    return {"spring": springs, "bench": bench}[kind](parameters)
