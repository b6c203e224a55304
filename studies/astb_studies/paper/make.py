"""Runs the whole study and writes it into one directory, with a progress bar for each kind of work."""

from pathlib import Path
from typing import Final

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from astb.campaigns.workers import executor
from astb.tables import plain_console
from astb_studies.paper import page
from astb_studies.paper.study import BENCH, CHECKED, FIGURES, MODEL, SENSITIVITY, study

_KINDS: Final = (BENCH, MODEL, CHECKED, SENSITIVITY, FIGURES)


def make(out: Path, *, quick: bool, seed: int, workers: int | None = None) -> Path:
    """Write figures, page, claims and table into ``out`` and return the page; OSError if that cannot be written to."""
    out.mkdir(parents=True, exist_ok=True)
    columns = (
        TextColumn("{task.description:<24}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=plain_console()) as bars:
        tasks: dict[str, TaskID] = {kind: bars.add_task(kind, total=None, start=False) for kind in _KINDS}

        def progress(kind: str, ready: int, total: int) -> None:
            if ready == 0:
                bars.start_task(tasks[kind])
            bars.update(tasks[kind], completed=ready, total=total)

        with executor(workers=workers) as cores:
            found = study(cores, out, quick=quick, seed=seed, progress=progress)
            return page.write(cores, found, out, progress)
