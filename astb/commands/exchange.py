"""`astb export` and `astb import`: records to and from the files of other programs."""

from pathlib import Path
from typing import Literal

import click

from astb.exit_codes import misuse
from bench_records.layout import RecordError

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("export")
@click.argument("directory", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("target", type=_FILE)
@click.option("--rate", type=float, default=100.0, show_default=True, help="Rows a second of a table, in Hz.")
@click.option("--signal", "names", multiple=True, metavar="NAME", help="Only this signal; repeatable.")
def export_command(directory: Path, target: Path, rate: float, names: tuple[str, ...]) -> None:
    """Write the run in DIRECTORY as TARGET, whose ending says what it becomes.

    .csv, .parquet and .arrow are tables at one rate, .xlsx has checks and curves beside it, .mf4 is MDF 4 with every
    sample; .blf, .asc, .log (candump) and .trc hold the CAN frames of a run that kept them.
    """
    from astb.exchange import export_run
    from drivers.can_files.frames import CanLogError

    try:
        click.echo(f"{target}: {export_run(directory, target, rate, names)}")
    except (RecordError, CanLogError) as error:
        misuse(error)
    except OSError as error:
        misuse(f"{target} cannot be written: {error.strerror or error}")


@click.command("import")
@click.argument("source", type=_FILE)
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--dbc",
    type=_FILE,
    help="The messages of another rig, for a file of CAN frames; without it they are ours.",
)
@click.option("--charset", help="Of the DBC.  [default: UTF-8 if all of it is, else cp1252]")
@click.option("--channel", help="Only the frames of this channel of a log, as the log calls it: can0, 1.")
@click.option(
    "--stamps",
    type=click.Choice(["absolute", "delta"]),
    help="How the time stamps of a candump are meant.  [default: as they look, or refused]",
)
@click.option(
    "--table",
    multiple=True,
    metavar="KEY=VALUE",
    help="How a table is to be read where it does not tell, such as decimal=, or time=t; repeatable.",
)
def import_command(
    source: Path,
    directory: Path,
    dbc: Path | None,
    charset: str | None,
    channel: str | None,
    stamps: Literal["absolute", "delta"] | None,
    table: tuple[str, ...],
) -> None:
    """Make a run in the new DIRECTORY of SOURCE, for reports and diagnosis.

    Tables (.csv, .txt, .parquet, .arrow), MDF files (.mf4) and files of CAN frames (.blf, .asc, .log, .trc) are read.
    Columns and channels are called as `astb export` calls them. Nothing is judged. What was left out is told, counted.
    """
    from astb.exchange import import_file
    from astb.frames_import import LogKeys

    try:
        keys = LogKeys(dbc, charset, channel, stamps)
        click.echo(f"{directory}: {import_file(source, directory, keys, table)}")
    except RecordError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{directory} cannot be written: {error.strerror or error}")
