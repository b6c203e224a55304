"""``python -m astb_studies.benchmarks.diagnosis``: hide effects, diagnose and judge many cases; then write the page of
rates.
"""

import sys
from pathlib import Path
from typing import Final

import click
from msgspec.structs import replace
from rich.console import Console

from astb_studies.benchmarks.diagnosis.campaign import (
    COUNTED,
    Case,
    cases,
    done,
    file_of,
    nulls,
    run,
    siblings,
)
from astb_studies.benchmarks.diagnosis.ground_truth import NOISES
from astb_studies.benchmarks.diagnosis.judge import Judged

#: Added to every seed of the page: no rule was chosen by these cases.
SYSTEMS: Final = {"oscillator": 41_000_000, "bench": 16_000_000}
#: So many of an oscillator's cases are cheap.
CHEAP: Final = 800
NULLS: Final = 500
COLOURED_NULLS: Final = 200
SIBLINGS: Final = 400
#: Cases of the bench, in addition to its ordinary ones.
BENCH_NULLS: Final = 80
BENCH_SIBLINGS: Final = 200


def planned_cases(system: str, count: int, white: int, coloured: int, of_another_form: int) -> list[Case]:
    """Return the cases of a system, with kinds and conditions in turn, so that an interrupted campaign has some of
    each.
    """
    lists = [
        cases(system, count),
        nulls(system, white, "white"),
        *(nulls(system, coloured, noise) for noise in NOISES[1:]),
        siblings(system, of_another_form),
    ]
    total = sum(len(one) for one in lists)
    places = [(k * total / len(one), case) for one in lists for k, case in enumerate(one)]
    return [case for _, case in sorted(places, key=lambda place: place[0])]


@click.command()
@click.option("--cases", "count", default=300, show_default=True, help="Sealed cases on the bench.")
@click.option("--small", default=CHEAP, show_default=True, help="Cases on the oscillator.")
@click.option("--systems", default=",".join(SYSTEMS), show_default=True, help="Which are counted.")
@click.option("--processes", default=2, show_default=True)
@click.option("--first-seed", default=0, help="Added to every seed: other cases than those of the page.")
@click.option(
    "--kept", default=COUNTED, type=Path, show_default="the sources", help="Where judgements are kept."
)
@click.option("--again", is_flag=True, help="Discard the kept results.")
@click.option("--page-only", is_flag=True, help="Write the page from the kept results.")
def main(
    count: int,
    small: int,
    systems: str,
    processes: int,
    first_seed: int,
    kept: Path,
    again: bool,
    page_only: bool,
) -> None:
    """Carry out the remaining cases, and write studies/docs/diagnosis-benchmark.md.

    With another first seed, cases are carried out and kept, but the page is not written.
    """
    console = Console() if sys.stdout.isatty() else Console(width=170)
    if again:
        for system in systems.split(","):
            file_of(system, kept).unlink(missing_ok=True)

    def report(judged: Judged, left: int) -> None:
        text = judged.failure or f"{judged.verdict}: {', '.join(judged.causes) or '–'}"
        if judged.rivals:
            text += f" or {', '.join(judged.rivals)}"
        hidden = ", ".join(judged.hidden) or "nothing"
        line = f"{judged.system} {judged.seed} {judged.kind}, {judged.condition}: {hidden} (λ {judged.weakest:.3g})"
        style = "red" if judged.failure or judged.wrong else ""
        console.print(f"{line} → {text}; {judged.elapsed:.0f} s, {left} left", style=style, highlight=False)

    planned = {
        "oscillator": planned_cases("oscillator", small, NULLS, COLOURED_NULLS, SIBLINGS),
        "bench": planned_cases("bench", count, BENCH_NULLS, BENCH_NULLS, BENCH_SIBLINGS),
    }
    if not page_only:
        for system in systems.split(","):
            first = SYSTEMS[system] + first_seed
            run([replace(case, seed=case.seed + first) for case in planned[system]], processes, report, kept)
    if first_seed:
        return
    from astb_studies.benchmarks.diagnosis.rate_page import write

    judgements = {system: done(system, kept) for system in SYSTEMS}
    if lacking := [system for system, judged in judgements.items() if not judged]:
        raise click.ClickException(
            f"{kept} has no results of {', '.join(lacking)}, so the page was not written; run these systems"
        )
    page = write(judgements, {system: len(cases) for system, cases in planned.items()})
    console.print(f"page: {page}", highlight=False)


if __name__ == "__main__":
    main()
