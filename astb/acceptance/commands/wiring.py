"""`astb rig new`: a first wiring file for a rig with other messages or registers."""

from pathlib import Path
from typing import Literal

import click

from astb.exit_codes import misuse
from drivers.errors import WiringError

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("new")
@click.option(
    "--dbc", type=_FILE, help="CAN messages of the rig: a DBC, or another file that cantools reads."
)
@click.option(
    "--registers",
    type=_FILE,
    help="Modbus registers of the rig, a CSV file with the columns name, table, address, type, scale and unit.",
)
@click.option("--charset", help="Character set of the DBC.  [default: UTF-8 if it is valid, else cp1252]")
@click.option(
    "--addresses",
    type=click.Choice(["wire", "one", "modicon"]),
    help="Addresses in the list: as on the wire, from 1, or from 30001 and 40001.  [default: detected]",
)
@click.option("--out", type=_FILE, help="File to write.  [default: standard output]")
def new_command(
    dbc: Path | None,
    registers: Path | None,
    charset: str | None,
    addresses: Literal["wire", "one", "modicon"] | None,
    out: Path | None,
) -> None:
    """Write a first wiring file from a DBC and a list of registers.

    Signals that are clear from name and unit are filled in; other candidates are comments. Names do not show signs,
    offsets and states: read each line, then run `astb rig check`.
    """
    from astb.acceptance.skeleton.writing import skeleton

    if dbc is None and registers is None:
        misuse("no input: name --dbc, --registers or both")
    if out is not None and out.exists():
        misuse(f"{out} exists already; choose another name or remove it")
    try:
        text = skeleton(dbc, registers, out.parent if out else Path(), charset, addresses)
    except WiringError as error:
        misuse(error)
    if out is None:
        click.echo(text, nl=False)
    else:
        out.write_text(text, encoding="utf-8", newline="\n")
