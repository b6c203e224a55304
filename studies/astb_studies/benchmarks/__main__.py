"""``python -m astb_studies.benchmarks``: measure speed and lateness, each together with a control at the same time."""

import importlib
import sys
from typing import Final

import click
from rich.console import Console

from astb_studies.benchmarks.measure import Effort, Section, machine
from astb_studies.benchmarks.page import PAGE, show, write_json, write_page

#: In the order of the page; each is a module with ``run(effort)``.
NAMES: Final = (
    "step",
    "gas",
    "tick",
    "virtual",
    "lateness",
    "can_trip",
    "modbus_trip",
    "commander_cycles",
    "codec",
    "time_to_safe",
    "campaigns",
    "diagnosis_duration",
    "panel",
    "watch",
    "fmu",
)


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(NAMES))
@click.option("--quick", is_flag=True, help="A look in a minute: fewer repetitions, 10 s of lateness.")
def main(names: tuple[str, ...], quick: bool) -> None:
    """Run all benchmarks, or the named ones. Results are written to runs/benchmarks.json and, except for quick runs,
    to studies/docs/benchmarks.md.
    """
    console = Console() if sys.stdout.isatty() else Console(width=170)
    sections: dict[str, Section] = {}
    facts = machine()
    for name in names or NAMES:
        with console.status(f"measuring: {name}"):
            sections[name] = importlib.import_module(f"astb_studies.benchmarks.{name}").run(Effort(quick))
        show(sections[name], console)
        if not quick:
            write_page([sections[name]], facts)
    console.print(f"results: {write_json(sections, facts, quick=quick)}", highlight=False)
    if not quick:
        console.print(f"page:    {PAGE}", highlight=False)
    missed = [row.what for section in sections.values() for row in section.rows if row.met is False]
    if missed:
        console.print(f"aims missed: {'; '.join(missed)}", style="yellow", highlight=False)


if __name__ == "__main__":
    sys.exit(main())
