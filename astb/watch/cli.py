"""`astb watch`: comparison of a run with its model, during the run or afterwards."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from astb.exit_codes import FAIL, INCOMPLETE, PASS, blocked, misuse
from bench_protocol.runtime.own_process import keep_algebra_to_one_core

if TYPE_CHECKING:
    from bench_records.twin import TwinStory


@click.command("watch")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option(
    "--model",
    default="astb",
    show_default=True,
    help="Parameter set, or the path of a parameter or model file.",
)
def watch_command(directory: Path, model: str) -> None:
    """Compare a run with its model, and print deviations.

    Each deviation has start time, size and possible causes. If the run is not finished, the command follows it to its
    end, and the terminal shows measured and expected values. The deviations are written to twin.json in DIRECTORY, and
    the report shows them.

    \b
    Exit codes:
      0  the rig agrees with its model
      1  the rig deviates from its model
      2  wrong usage
      3  the run cannot be read
      4  nothing could be compared
    """
    keep_algebra_to_one_core()
    from astb.watch.screen import DiagnosisError, ParameterError, RecordError, watch_on_screen

    try:
        story = watch_on_screen(directory, model)
    except ParameterError as error:
        misuse(error)
    except (RecordError, DiagnosisError) as error:
        blocked(error)
    _conclude(story)


def _conclude(story: "TwinStory") -> None:
    for reason in dict.fromkeys(one.why for one in story.judged if one.why):
        seconds = sum(one.end - one.start for one in story.judged if one.why == reason)
        click.echo(f"not judged for {seconds:.1f} s: {reason}")
    click.echo(f"judged for {story.judged_for:.1f} of {story.until:.1f} s")
    if story.all_deviations:
        raise click.exceptions.Exit(FAIL)
    if not story.judged_for:
        raise click.exceptions.Exit(INCOMPLETE)
    click.echo("the rig agreed with its model")
    raise click.exceptions.Exit(PASS)
