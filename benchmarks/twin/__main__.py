"""``python -m benchmarks.twin``: how often a twin is wrong, how soon it tells what begins, and which causes it names.

Every run is made through the wires, with a seed of its own, and in virtual time but for ``realtime``. One line of JSON
a run goes to the file of results, so that counting goes on where it was cut off. ``--page`` prints what all files
together say.
"""

import tempfile
from itertools import islice
from pathlib import Path
from typing import Final

import click
import msgspec

from bench_records.record import read
from bench_sim.parameters import load
from benchmarks.twin.best import WatchedWith
from benchmarks.twin.cases import Case, faulty, harder, live, sound
from benchmarks.twin.live import count_live
from benchmarks.twin.rigs import bench_of
from benchmarks.twin.tables import Counted, page, shortened
from test_plans.discovery import plans
from test_plans.execution import execute

_CASES: Final = {"sound": sound, "faulty": faulty, "harder": harder, "realtime": live}


def count(case: Case) -> Counted:
    """Run a case, and return what its twin said."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / case.plan
        with bench_of(case) as bench:
            execute(plans()[case.plan].given(case.values), bench, place, rig="virtual", seed=case.seed)
        twin = WatchedWith(read(place), load("astb"), case)
        story = twin.look()
    return Counted(case, round(story.judged_for, 1), shortened(story, case), twin.best)


def kept(file: Path) -> list[Counted]:
    """Return what a file of results holds."""
    lines = file.read_bytes().splitlines() if file.exists() else []
    return [msgspec.json.decode(line, type=Counted) for line in lines]


@click.command()
@click.argument("what", type=click.Choice(list(_CASES)), required=False)
@click.option("--count", "wanted", default=40, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="File of results; it may hold some already.")
@click.option(
    "--page", "pages", type=click.Path(path_type=Path), multiple=True, help="Files to print the page of."
)
def main(
    what: str | None,
    wanted: int,
    seed: int,
    out: Path | None,
    pages: tuple[Path, ...],
) -> None:
    """Count sound or faulty rigs, these also in real time, or print what was counted."""
    if what and out:
        out.parent.mkdir(parents=True, exist_ok=True)
        for case in islice(_CASES[what](wanted, seed), len(kept(out)), None):
            line = msgspec.json.encode((count_live if what == "realtime" else count)(case))
            with out.open("ab") as file:
                file.write(line + b"\n")
    if pages:
        click.echo(page([one for file in pages for one in kept(file)]))


if __name__ == "__main__":
    main()
