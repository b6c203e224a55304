"""`astb watch`: the model beside a run, while it goes on or afterwards."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from astb.exit_codes import FAIL, INCOMPLETE, PASS, blocked, misuse
from bench_protocol.runtime.one_core import keep_algebra_to_one_core

if TYPE_CHECKING:
    from bench_records.twin import TwinStory


@click.command("watch")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option("--model", default="astb", show_default=True, help="Parameter set, or a model file.")
def watch_command(directory: Path, model: str) -> None:
    """Compare the run in DIRECTORY with its model and print deviations.

    Each has its start, its size and its possible causes.

    A run that goes on is followed to its end; meanwhile a terminal shows every reading beside what the model expects
    of it. What is found is kept as twin.json beside the record, and stands in the report.

    Ends with 0 if the rig agrees with its model, 1 if it deviates, 2 for misuse, 3 if there is no run that can be
    read, 4 if nothing could be judged.
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
    if story.partings:
        raise click.exceptions.Exit(FAIL)
    if not story.judged_for:
        raise click.exceptions.Exit(INCOMPLETE)
    click.echo("the rig agreed with its model")
    raise click.exceptions.Exit(PASS)
