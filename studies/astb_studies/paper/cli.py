"""The command `astb paper`, which `astb` finds by its entry point."""

from pathlib import Path

import click

from astb.commands.options import SEED
from astb.exit_codes import blocked, misuse
from bench_protocol.extras import installed, lacking
from bench_records.layout import RecordError


@click.command("paper")
@click.option(
    "--quick", is_flag=True, help="Use one rig and one wind history only: four minutes of processor time."
)
@click.option(
    "--seed", type=SEED, default=0, show_default=True, help="Random seed of the sensors of the first rig."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for figures, page and claims.",
)
def paper_command(quick: bool, seed: int, out: Path) -> None:
    """Compute the paper's figures, its table and its claims again.

    The results are from the simulated rig and from closed forms. It writes OUT/index.html, figures as SVG and PNG,
    claims.json, comfort.csv, identified.toml and the records. A claim that does not hold is a result, not an error.
    """
    from astb_studies.paper.bench_results import NoBenchResult
    from astb_studies.paper.make import make

    if not installed("campaign"):
        misuse(lacking("campaign", "the paper's bench runs"))
    try:
        click.echo(make(out, quick=quick, seed=seed))
    except NoBenchResult as error:
        blocked(error)
    except RecordError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{out} cannot be written: {error.strerror or error}")
