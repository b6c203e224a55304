"""`astb fmu`: springs, bench and car as Functional Mock-up Units (FMU)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from astb.exit_codes import blocked, misuse
from bench_protocol.os_errors import reason

_VERSIONS: Final = ("2", "3")


@click.group("fmu")
def fmu_command() -> None:
    """Export springs, bench or car as FMUs for co-simulation.

    The libraries for Windows are tested with Wine only. No file was tried on Windows itself, or in Simpack, Dymola or
    OMSimulator.
    """


_fmi = click.option(
    "--fmi",
    type=click.Choice(_VERSIONS),
    default="3",
    show_default=True,
    help="Version of the FMI standard.",
)
_vehicle = click.option(
    "--vehicle",
    default="vehicle",
    show_default=True,
    help="Parameter file of the car, or the name of a parameter set.",
)


def _options(out: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that makes a function an export command. The command writes the file ``out`` by default."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in (
            click.option(
                "--out",
                type=click.Path(path_type=Path, dir_okay=False),
                default=out,
                show_default=True,
                help="File to write.",
            ),
            click.option(
                "--native", is_flag=True, help="Optimise for this processor; the FMU may not run on others."
            ),
            click.option(
                "--load-case", help="Load case, such as AW3.  [default: the first one of the model]"
            ),
            click.option(
                "--model",
                default="astb",
                show_default=True,
                help="Parameter set, or the path of a parameter or model file.",
            ),
        ):
            command = option(command)
        return fmu_command.command(out.partition(".")[0])(command)

    return decorate


@_options("spring.fmu")
@_fmi
def spring_command(**given: Any) -> None:
    """Export both air springs with their valves.

    The export needs a C compiler, and mingw-w64 for Windows. The FMU needs neither Python nor ASTB.
    """
    _write(["spring"], **given)


@_options("bench.fmu")
@_fmi
def bench_command(**given: Any) -> None:
    """Export the bench: springs, bolster, actuators, platform.

    Inputs are set-points, outputs are the true values. CAN, Modbus and sensors are not part of the FMU.
    """
    _write(["bench"], **given)


@_options("car.fmu")
@_fmi
@_vehicle
def car_command(**given: Any) -> None:
    """Export half a car, to connect with the springs.

    The mass of the car fits the preload of the springs. Its outputs have the names of the inputs of the springs.
    """
    _write(["car"], **given)


@_options("springs-with-car.ssp")
@_vehicle
def system_command(**given: Any) -> None:
    """Export springs and car, connected, as one SSP 1.0 file.

    It contains both FMUs (FMI 2.0). Simulate it with communication steps of 1 ms.
    """
    _write(["spring", "car"], **given)


def _write(
    kinds: list[str],
    *,
    out: Path,
    native: bool,
    model: str,
    load_case: str | None,
    fmi: str = "",
    vehicle: str = "vehicle",
) -> None:
    from astb.fmu import export, models, system
    from bench_sim.parameters import ParameterError

    try:
        units = {kind: models.unit_of(kind, model, load_case, vehicle) for kind in kinds}
    except ParameterError as error:
        misuse(str(error))
    try:
        if fmi:
            (unit,) = units.values()
            text = f"FMI {fmi}.0, {export.write_unit(unit, out, fmi=int(fmi), native=native)}"
        else:
            system.write_system(out.stem, units, out, native=native)
            text = "SSP 1.0"
    except export.ExportError as error:
        blocked(str(error))
    except OSError as error:
        blocked(f"{out} cannot be written: {reason(error)}")
    click.echo(f"{out}: {text}")
    made = export.platforms()
    for one in made:
        click.echo(f"  {one.name}: built, not tried on this machine")
    if export.WINDOWS not in made:
        click.echo(
            f"  {export.WINDOWS.name}: missing; on an x86-64 machine, install its compiler by "
            "`apt-get install gcc-mingw-w64-x86-64` and export again"
        )
