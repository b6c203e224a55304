"""``python -m benchmarks.diagnosis``: hide, diagnose, judge, many times; then write the page of rates."""

import sys
from typing import Final

import click
from rich.console import Console

from benchmarks.diagnosis.campaign import cases, done, file_of, nulls, run
from benchmarks.diagnosis.ground_truth import CONDITIONS
from benchmarks.diagnosis.judge import Judged

SYSTEMS: Final = ("oscillator", "bench")
#: So many of an oscillator's cases are cheap.
CHEAP: Final = 800
NULLS: Final = 500
COLOURED_NULLS: Final = 200


@click.command()
@click.option("--cases", "count", default=40, show_default=True, help="Sealed cases on the bench.")
@click.option("--small", default=CHEAP, show_default=True, help="Cases on the oscillator.")
@click.option(
    "--nulls", "null_count", default=NULLS, show_default=True, help="Oscillators without anything hidden."
)
@click.option("--processes", default=2, show_default=True)
@click.option("--again", is_flag=True, help="Forget what is kept.")
@click.option("--page-only", is_flag=True, help="Write the page from what is kept.")
def main(count: int, small: int, null_count: int, processes: int, again: bool, page_only: bool) -> None:
    """Carry out the cases that are not kept yet in runs/diagnosis, and write docs/reference/diagnosis-benchmark.md."""
    console = Console() if sys.stdout.isatty() else Console(width=170)
    if again:
        for system in SYSTEMS:
            file_of(system).unlink(missing_ok=True)

    def tell(judged: Judged, left: int) -> None:
        text = judged.failure or f"{judged.verdict}: {', '.join(judged.causes) or '–'}"
        if judged.rivals:
            text += f" or {', '.join(judged.rivals)}"
        hidden = ", ".join(judged.hidden) or "nothing"
        line = f"{judged.system} {judged.seed} {judged.kind}, {judged.condition}: {hidden} (λ {judged.weakest:.3g})"
        style = "red" if judged.failure or judged.wrong else ""
        console.print(f"{line} → {text}; {judged.elapsed:.0f} s, {left} left", style=style, highlight=False)

    if not page_only:
        coloured = min(null_count, COLOURED_NULLS)
        run(
            [
                *cases("oscillator", small),
                *nulls("oscillator", null_count, "white"),
                *(case for condition in CONDITIONS[1:] for case in nulls("oscillator", coloured, condition)),
            ],
            processes,
            tell,
        )
        run(cases("bench", count), processes, tell)
    from benchmarks.diagnosis.rate_page import write

    console.print(f"page: {write({system: done(system) for system in SYSTEMS})}", highlight=False)


if __name__ == "__main__":
    main()
