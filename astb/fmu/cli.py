"""`astb fmu`: springs, bench and car as Functional Mock-up Units."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from astb.exit_codes import blocked, misuse

_VERSIONS: Final = ("2", "3")


@click.group("fmu")
def fmu_command() -> None:
    """Write springs, bench or car as a Functional Mock-up Unit (FMU)."""


def _options(command: Callable[..., None]) -> Callable[..., None]:
    name = command.__name__.removesuffix("_command")
    for option in (
        click.option(
            "--out",
            type=click.Path(path_type=Path, dir_okay=False),
            default=f"{name}.fmu",
            show_default=True,
        ),
        click.option("--native", is_flag=True, help="For processors like this one only."),
        click.option(
            "--fmi", type=click.Choice(_VERSIONS), default="3", show_default=True, help="Version of FMI."
        ),
        click.option("--load-case", help="Such as AW3; else the first one of the set."),
        click.option("--model", default="astb", show_default=True, help="Parameter set, or a model file."),
    ):
        command = option(command)
    return fmu_command.command(name)(command)


@_options
def spring_command(**given: Any) -> None:
    """Write both air springs with their valves as an FMU for co-simulation.

    It needs a C compiler here, and neither Python nor this project where it runs.
    """
    _write("spring", **given)


@_options
def bench_command(**given: Any) -> None:
    """Write the whole bench as an FMU for co-simulation: springs, bolster, actuators and platform.

    It has no wires and no measuring chain: set-points go in, and what is true comes out.
    """
    _write("bench", **given)


@click.option(
    "--vehicle",
    default="vehicle",
    show_default=True,
    help="Parameter file of the car, or the one that is here.",
)
@_options
def car_command(**given: Any) -> None:
    """Write half a car as an FMU for co-simulation, which stands on springs of another FMU.

    It is as heavy as the springs of the model carry. Its outputs have the names of the springs' inputs.
    """
    _write("car", **given)


def _write(kind: str, *, out: Path, fmi: str, native: bool, **sets: Any) -> None:
    from astb.fmu.export import ExportError, write_unit
    from astb.fmu.models.kinds import unit_of
    from bench_sim.parameters import ParameterError

    try:
        unit = unit_of(kind, **sets)
    except ParameterError as error:
        misuse(str(error))
    try:
        token = write_unit(unit, out, fmi=int(fmi), native=native)
    except ExportError as error:
        blocked(str(error))
    except OSError as error:
        blocked(f"{out} cannot be written: {error.strerror}")
    click.echo(f"{out}: FMI {fmi}.0, {token}")
