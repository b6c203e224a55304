"""Runs of a simulator: their outputs, or an error that states the parameters at which it failed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from traceback import extract_tb

from diagnosis.contracts import Array, CompleteSimulator, DiagnosisError, Effects, Job, Parameter, Simulator
from diagnosis.engine.config import PARAMETERS_SHOWN


class _Completed(CompleteSimulator):
    """A simulator with default values for its missing members."""

    def __init__(self, simulator: Simulator) -> None:
        for name in (*CompleteSimulator.__annotations__, *vars(CompleteSimulator)):
            if not name.startswith("_") and hasattr(simulator, name):
                setattr(self, name, getattr(simulator, name))


def completed(simulator: Simulator) -> CompleteSimulator:
    """Return a simulator with all optional members: ``simulator`` itself if it has them, otherwise a wrapper with
    default values.
    """
    return simulator if isinstance(simulator, CompleteSimulator) else _Completed(simulator)


def simulate(simulator: Simulator, job: Job) -> Array:
    """Run a job and return its outputs (n, c).

    Raises DiagnosisError if the simulator raises an exception or returns a wrong shape. The text of the error names the
    line of code.
    """
    with _blamed(simulator, job):
        outputs = simulator.run(job.experiment, job.parameters, job.effects)
    return checked(simulator, job, outputs)


def simulate_many(simulator: CompleteSimulator, jobs: Sequence[Job]) -> Iterator[Array]:
    """Yield the outputs (n, c) of several jobs in order. Raises the same errors as `simulate`."""
    found = simulator.run_many(jobs)
    for job in jobs:
        with _blamed(simulator, job):
            outputs = next(found)
        yield checked(simulator, job, outputs)


@contextmanager
def _blamed(simulator: Simulator, job: Job) -> Iterator[None]:
    """Convert an exception of a simulator to a DiagnosisError that states the line of code and the parameters."""
    try:
        yield
    except DiagnosisError:
        raise
    except Exception as error:  # it may be anybody's code
        place = extract_tb(error.__traceback__)[-1]
        raise DiagnosisError(
            f"{simulator.name} failed in the run {job.experiment.name} at "
            f"{described(simulator, job.parameters, job.effects)}: {type(error).__name__}: {error} "
            f"({place.filename.rpartition('/')[2]}, line {place.lineno}); correct this line"
        ) from error


def checked(simulator: Simulator, job: Job, outputs: Array) -> Array:
    """Return ``outputs`` unchanged. Raises DiagnosisError unless they have one row per sample and one column per
    channel.
    """
    right = (len(job.experiment.time), len(simulator.channels))
    shape = getattr(outputs, "shape", None)
    if shape != right:
        what = (
            f"{type(outputs).__name__} is not an array"
            if shape is None
            else f"outputs have the shape {shape}"
        )
        raise DiagnosisError(
            f"{simulator.name}: in the run {job.experiment.name} its {what}, not {right}; return one row per sample "
            "and one column per channel"
        )
    return outputs


def described(simulator: Simulator, parameters: Mapping[str, float], effects: Effects) -> str:
    """Return parameters and effects as text with units. Parameters at their nominal values come last."""
    nominal = {parameter.name: parameter for parameter in simulator.nuisances}
    moved = [name for name, one in nominal.items() if parameters.get(name, one.nominal) != one.nominal]
    names = [*moved, *(name for name in nominal if name not in moved)]
    texts = [*_effects(simulator, effects)] + [
        _valued(name, parameters.get(name, nominal[name].nominal), nominal[name].unit) for name in names
    ]
    return ", ".join(texts[:PARAMETERS_SHOWN]) + (", …" if len(texts) > PARAMETERS_SHOWN else "")


def _effects(simulator: Simulator, effects: Effects) -> Iterator[str]:
    known: dict[str, tuple[Parameter, ...]] = {
        **{name: effect.parameters for name, effect in simulator.catalogue.items()},
        **{surface.name: surface.coefficients for surface in simulator.surfaces},
    }
    for name, values in effects.items():
        units = {parameter.name: parameter.unit for parameter in known.get(name, ())}
        for parameter, value in values.items():
            yield _valued(f"{name}.{parameter}", value, units.get(parameter, ""))


def _valued(name: str, value: float, unit: str) -> str:
    return f"{name} = {value:.6g} {'' if unit == '1' else unit}".rstrip()
