"""`astb fmu`: springs, bench and car as Functional Mock-up Units (FMU)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from astb.exit_codes import blocked, misuse

_VERSIONS: Final = ("2", "3")


@click.group("fmu")
def fmu_command() -> None:
    """Export springs, bench or car as FMUs for co-simulation.

    The libraries for Windows are tested with Wine only. No FMU was tried on Windows itself, or in Simpack, Dymola or
    OMSimulator.
    """


def _options(command: Callable[..., None]) -> Callable[..., None]:
    name = command.__name__.removesuffix("_command")
    for option in (
        click.option(
            "--out",
            type=click.Path(path_type=Path, dir_okay=False),
            default=f"{name}.fmu",
            show_default=True,
            help="File to write.",
        ),
        click.option(
            "--native", is_flag=True, help="Optimise for this processor; the FMU may not run on others."
        ),
        click.option(
            "--fmi",
            type=click.Choice(_VERSIONS),
            default="3",
            show_default=True,
            help="Version of the FMI standard.",
        ),
        click.option("--load-case", help="Load case, such as AW3.  [default: the first one of the model]"),
        click.option(
            "--model",
            default="astb",
            show_default=True,
            help="Parameter set, or the path of a parameter or model file.",
        ),
    ):
        command = option(command)
    return fmu_command.command(name)(command)


@_options
def spring_command(**given: Any) -> None:
    """Export both air springs with their valves.

    The export needs a C compiler, and mingw-w64 for Windows. The FMU needs neither Python nor ASTB.
    """
    _write("spring", **given)


@_options
def bench_command(**given: Any) -> None:
    """Export the whole bench: springs, bolster, actuators and platform.

    Inputs are set-points, outputs are the true values. CAN, Modbus and sensors are not part of the FMU.
    """
    _write("bench", **given)


@click.option(
    "--vehicle",
    default="vehicle",
    show_default=True,
    help="Parameter file of the car, or the name of a parameter set.",
)
@_options
def car_command(**given: Any) -> None:
    """Export half a car, to connect with the FMU of the springs.

    The mass of the car fits the preload of the springs. Its outputs have the names of the inputs of the springs.
    """
    _write("car", **given)


def _write(kind: str, *, out: Path, fmi: str, native: bool, **sets: Any) -> None:
    from astb.fmu.export import WINDOWS, ExportError, platforms, write_unit
    from astb.fmu.models import unit_of
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
    made = platforms()
    for system in made:
        click.echo(f"  {system.name}: built, not tried on this machine")
    if WINDOWS not in made:
        click.echo(
            f"  {WINDOWS.name}: missing; on an x86-64 machine, install its compiler by "
            "`apt-get install gcc-mingw-w64-x86-64` and export again"
        )
