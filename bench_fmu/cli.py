"""`astb fmu`: the springs as a Functional Mock-up Unit."""

from pathlib import Path
from typing import Final

import click

from astb.exit_codes import blocked, misuse

_VERSIONS: Final = ("2", "3")


@click.group("fmu")
def fmu_command() -> None:
    """Write the springs as a Functional Mock-up Unit (FMU), for simulations of others."""


@fmu_command.command("spring")
@click.option("--model", default="astb", show_default=True, help="Parameter set, or a model file.")
@click.option("--load-case", help="Such as AW3; else the first one of the set.")
@click.option("--fmi", type=click.Choice(_VERSIONS), default="3", show_default=True, help="Version of FMI.")
@click.option("--native", is_flag=True, help="For processors like this one only.")
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), default="spring.fmu", show_default=True
)
def spring_command(model: str, load_case: str | None, fmi: str, native: bool, out: Path) -> None:
    """Write both air springs with their valves as an FMU for co-simulation.

    It needs a C compiler here, and neither Python nor this project where it runs.
    """
    from bench_fmu.export import ExportError, write_springs
    from bench_sim.parameters import ParameterError, load

    try:
        parameters = load(model, load_case)
    except ParameterError as error:
        misuse(str(error))
    try:
        token = write_springs(parameters, out, fmi=int(fmi), native=native)
    except ExportError as error:
        blocked(str(error))
    except OSError as error:
        blocked(f"{out} cannot be written: {error.strerror}")
    click.echo(f"{out}: FMI {fmi}.0, {token}")
