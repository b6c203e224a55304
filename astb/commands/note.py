"""`astb note`: comments, photos and files added to a run afterwards."""

from pathlib import Path

import click

from astb.commands.options import JSON_OPTION
from astb.exit_codes import misuse
from astb.tables import print_json
from bench_records.layout import RecordError
from bench_records.notes import add_note, is_as_added, notes_of
from bench_records.run_folder import SIGNS


@click.command("note")
@click.argument("directory", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("text", required=False, default="")
@click.option(
    "--by",
    envvar="ASTB_OPERATOR",
    default="",
    help="Author of the note.  [default: ASTB_OPERATOR of the environment]",
)
@click.option(
    "--file",
    "files",
    multiple=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Copy a photo or another file to the run; repeatable.",
)
@JSON_OPTION
def note_command(directory: Path, text: str, by: str, files: tuple[Path, ...], as_json: bool) -> None:
    """Add a note, a photo or a file to a run, or list its notes.

    A note has time and author. It changes neither the record nor the signed report: `astb report` writes a new report
    that shows the notes after the signatures.
    """
    if not any((directory / name).exists() for name in SIGNS):
        misuse(f"{directory} is not the folder of a run: it has none of the files {', '.join(SIGNS)}")
    try:
        for number, file in enumerate(files or ([None] if text else [])):
            add_note(directory, text if number == 0 else "", by, file)
    except RecordError as error:
        misuse(error)
    notes = notes_of(directory)
    if as_json:
        print_json(notes)
        return
    for one in notes:
        changed = "" if is_as_added(directory, one) else " (removed or changed since then)"
        click.echo("  ".join(filter(None, (one.at, one.by, one.text, one.file + changed))))
    if not notes:
        click.echo("this run has no notes")
