"""Investigates sealed rigs and counts the right names: ``python -m astb_studies.benchmarks.diagnosis.investigations``.

Every rig takes minutes of a core. Each result is stored at once as a line of JSON, so an interrupted count resumes.
At the end, the page is written.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Final

import click
import msgspec

from astb.campaigns.core import carried_out
from astb.campaigns.workers import cluster
from astb_studies.benchmarks.diagnosis.campaign import COUNTED
from astb_studies.benchmarks.diagnosis.investigated import Asked, Investigated, investigated
from astb_studies.benchmarks.diagnosis.investigation_page import PAGE, summary, write

ROUND: Final[tuple[Asked, ...]] = ("single", "faint", "near", "faint", "pair", "null")
BUDGET: Final = "40 min"
INVESTIGATIONS: Final = COUNTED / "investigations.jsonl"


def count(
    planned: Sequence[tuple[int, Asked]],
    processes: int,
    kept: Path,
    report: Callable[[str], None],
    budget: str = BUDGET,
) -> None:
    """Investigate the cases that ``kept`` does not have yet, and append each result at once."""
    cases = {f"{kind} {seed}": (seed, kind) for seed, kind in planned}
    left = {key: case for key, case in cases.items() if key not in {f"{o.kind} {o.seed}" for o in read(kept)}}
    if not left:
        return
    kept.parent.mkdir(parents=True, exist_ok=True)
    with (
        cluster(workers=processes) as client,
        closing(carried_out(client, partial(investigated, budget=budget), left)) as ended,
    ):
        for one in ended:
            seed, kind = left[one.key]
            what = one.value or Investigated(seed=seed, kind=kind, hidden=[], weakest=0.0, failure=one.error)
            with kept.open("ab") as file:
                file.write(msgspec.json.encode(what) + b"\n")
            report(
                f"{one.key}: {', '.join(what.hidden) or 'nothing'} → {what.failure or what.verdict} {what.causes}"
            )


def read(kept: Path) -> list[Investigated]:
    """Return the results so far."""
    if not kept.exists():
        return []
    return [msgspec.json.decode(line, type=Investigated) for line in kept.read_bytes().splitlines() if line]


@click.command()
@click.option("--count", "number", default=50, show_default=True, help="Rigs.")
@click.option("--processes", default=2, show_default=True)
@click.option("--budget", default=BUDGET, show_default=True, help="Time of the bench for each.")
@click.option("--first-seed", default=300_000, show_default=True, help="Seed of the first rig.")
@click.option("--kept", default=INVESTIGATIONS, type=click.Path(path_type=Path), help="What is known.")
@click.option(
    "--page", type=click.Path(path_type=Path), help="Where the page is written; else among the docs."
)
def main(number: int, processes: int, budget: str, first_seed: int, kept: Path, page: Path | None) -> None:
    """Investigate sealed rigs without a result yet; print and store the rates of right results."""
    planned = [(first_seed + i, ROUND[i % len(ROUND)]) for i in range(number)]
    count(planned, processes, kept, click.echo, budget)
    for line in summary(read(kept)):
        click.echo(line)
    # The page in the docs shows only the results kept in the repository.
    if page is None and (kept, budget) == (INVESTIGATIONS, BUDGET):
        page = PAGE
    if page is not None:
        write(read(kept), page, budget)


if __name__ == "__main__":
    main()
