"""`astb wiring new`: a first wiring file for a rig that speaks otherwise."""

from pathlib import Path
from typing import Literal

import click

from astb.exit_codes import misuse
from drivers.errors import WiringError

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.group("wiring")
def wiring_command() -> None:
    """Describe a rig that speaks otherwise."""


@wiring_command.command("new")
@click.option("--dbc", type=_FILE, help="What is on its CAN bus: a DBC, or another file that cantools reads.")
@click.option(
    "--registers", type=_FILE, help="Its Modbus registers (CSV): name, table, address; type, scale, unit."
)
@click.option("--charset", help="Of the DBC.  [default: UTF-8 if all of it is, else cp1252]")
@click.option(
    "--addresses",
    type=click.Choice(["wire", "one", "modicon"]),
    help="How the list counts: as on the wire, from 1, or 30001 and 40001.  [default: as it looks, or refused]",
)
@click.option("--out", type=_FILE, help="Where to write the file.  [default: standard output]")
def new_command(
    dbc: Path | None,
    registers: Path | None,
    charset: str | None,
    addresses: Literal["wire", "one", "modicon"] | None,
    out: Path | None,
) -> None:
    """Write a first wiring file: what is clear by name and unit filled in, what may be as comments.

    Signs, offsets and states nobody can know from names: read every line, then let `astb check-rig` look.
    """
    from astb.acceptance.skeleton.writing import skeleton

    if dbc is None and registers is None:
        misuse("there is nothing to describe: --dbc, --registers or both would be right")
    if out is not None and out.exists():
        misuse(f"{out} is there already, and somebody may have worked on it")
    try:
        text = skeleton(dbc, registers, out.parent if out else Path(), charset, addresses)
    except WiringError as error:
        misuse(error)
    if out is None:
        click.echo(text, nl=False)
    else:
        out.write_text(text, encoding="utf-8", newline="\n")
