"""`astb export` and `astb import`: conversion between runs and files of other programs."""

from pathlib import Path
from typing import Literal

import click

from astb.exit_codes import misuse
from bench_protocol.os_errors import reason
from bench_records.layout import RecordError

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("export")
@click.argument("directory", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("target", type=_FILE)
@click.option("--rate", type=float, default=100.0, show_default=True, help="Rows per second of a table.")
@click.option("--signal", "names", multiple=True, metavar="NAME", help="Export only this signal; repeatable.")
def export_command(directory: Path, target: Path, rate: float, names: tuple[str, ...]) -> None:
    """Export a run to CSV, Excel, Parquet, MDF 4 or a CAN log.

    DIRECTORY is the folder of a run. The ending of TARGET selects the format:

    \b
      .csv .parquet .arrow    table of the signals at a constant rate
      .xlsx                   the same, with checks and curves
      .mf4                    MDF 4 with all samples
      .blf .asc .log .trc     CAN frames, if the run recorded them (--keep-frames)
    """
    from astb.exchange import export_run
    from drivers.can_files.frames import CanLogError

    try:
        click.echo(f"{target}: {export_run(directory, target, rate, names)}")
    except (RecordError, CanLogError) as error:
        misuse(error)
    except OSError as error:
        misuse(f"{target} cannot be written: {reason(error)}")


@click.command("import")
@click.argument("source", type=_FILE)
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--dbc",
    type=_FILE,
    help="DBC file with the messages of a CAN log.  [default: the messages of ASTB]",
)
@click.option("--charset", help="Character set of the DBC.  [default: UTF-8 if it is valid, else cp1252]")
@click.option("--channel", help="Read only frames of this channel of a CAN log, such as can0 or 1.")
@click.option(
    "--stamps",
    type=click.Choice(["absolute", "delta"]),
    help="Time stamps of a candump: absolute, or since the last frame.  [default: detected]",
)
@click.option(
    "--table",
    multiple=True,
    metavar="KEY=VALUE",
    help='Format of a table, if it is not detected, such as "decimal=," and "time=t"; repeatable.',
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
    """Import measured data or a CAN log as a run.

    SOURCE is a table (.csv, .txt, .parquet, .arrow), an MDF 4 file (.mf4) or a CAN log (.blf, .asc, .log, .trc).
    DIRECTORY is a new folder. Columns and channels need the names that `astb export` writes. An imported run has no
    verdict. The command prints how many values or frames it skipped.
    """
    from astb.exchange import import_file
    from astb.frames_import import LogKeys

    try:
        keys = LogKeys(dbc, charset, channel, stamps)
        click.echo(f"{directory}: {import_file(source, directory, keys, table)}")
    except RecordError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{directory} cannot be written: {reason(error)}")
