"""The available FMUs, made from parameter sets by their names."""

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
    """Return the ``spring``, the ``bench`` or the ``car`` of these sets. Raises `ParameterError` if one does not
    fit.
    """
    parameters = load(model, load_case)
    if kind == "car":
        return car(parameters, load_vehicle(vehicle))
    return {"spring": springs, "bench": bench}[kind](parameters)
