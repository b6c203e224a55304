"""Counts the false alarms, delays and named causes of the twin: ``python -m astb_studies.benchmarks.twin``.

Every run uses the real encoders and its own seed, and virtual time except in ``realtime``. Each run adds one line of
JSON to the file of results, so an interrupted count resumes. ``page`` writes the page of results.
"""

import tempfile
from itertools import islice
from pathlib import Path
from typing import Final

import click
import msgspec

from astb_studies.benchmarks.twin.best import WatchedWith
from astb_studies.benchmarks.twin.cases import Case, faulty, harder, live, sound
from astb_studies.benchmarks.twin.live import count_live
from astb_studies.benchmarks.twin.page import write
from astb_studies.benchmarks.twin.rigs import bench_of
from astb_studies.benchmarks.twin.tables import Counted, shortened
from bench_records.record import read
from bench_sim.parameters import load
from test_plans.discovery import plans
from test_plans.execution import execute

_CASES: Final = {"sound": sound, "faulty": faulty, "harder": harder, "realtime": live}
_COUNTED: Final = Path(__file__).with_name("counted")


def count(case: Case) -> Counted:
    """Run a case, and return the results of its twin."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / case.plan
        with bench_of(case) as bench:
            execute(plans()[case.plan].given(case.values), bench, place, rig="virtual", seed=case.seed)
        twin = WatchedWith(read(place), load("astb"), case)
        story = twin.look()
    return Counted(case, round(story.judged_for, 1), shortened(story, case), twin.best)


def kept(file: Path) -> list[Counted]:
    """Return the contents of a file of results."""
    lines = file.read_bytes().splitlines() if file.exists() else []
    return [msgspec.json.decode(line, type=Counted) for line in lines]


def all_counted() -> list[Counted]:
    """Return all stored results."""
    return [one for name in _CASES for one in kept(_COUNTED / f"{name}.jsonl")]


@click.command()
@click.argument("what", type=click.Choice([*_CASES, "page"]))
@click.option("--count", "wanted", default=40, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="File of results, else the one that is kept.",
)
def main(what: str, wanted: int, seed: int, out: Path | None) -> None:
    """Count fault-free or faulty rigs (the latter also in real time), or write the page of all results."""
    if what == "page":
        write(all_counted())
        return
    out = out or _COUNTED / f"{what}.jsonl"
    for case in islice(_CASES[what](wanted, seed), len(kept(out)), None):
        line = msgspec.json.encode((count_live if what == "realtime" else count)(case))
        with out.open("ab") as file:
            file.write(line + b"\n")


if __name__ == "__main__":
    main()
