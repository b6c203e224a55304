"""Rides of a car on measured springs in four winds, and their table: ``python -m astb_studies.benchmarks.rides``.

Each cell is the plan `ride` in virtual time, with the real encoders, for five minutes. Each cell adds one line of JSON
to the file of results, so an interrupted measurement resumes.
"""

import json
import re
import tempfile
from pathlib import Path
from typing import Any, Final

import click

from astb.rig_in_memory import RigInMemory
from astb_studies.paper.experiments import WIND_SPEEDS
from astb_studies.paper.hybrid.floor import COMFORT, COMFORT_OF_BOTH, COMFORT_UPWARD, RISES, SHAKES
from astb_studies.paper.plans.ride import AGREES
from astb_studies.paper.subject import LOADS
from astb_studies.places import PAGES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary

PAGE: Final = PAGES / "the-paper.md"
#: The table is between these two lines of the page.
BEGIN, END = "<!-- benchmarks.rides -->", "<!-- end of benchmarks.rides -->"
HEAD: Final = (
    "| | wind, m/s | a_y, m/s² | alone | U | N, W_d | alone | a_z, m/s² | alone | U | N, W_b | alone | N_MV |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
)
#: The values of both rides in the note of a check: bench, simulation, U of their difference.
_BOTH: Final = re.compile(r"bench (?P<bench>\S+), simulation (?P<alone>\S+), U of the difference (?P<U>\S+)")
#: Quantities that are compared with the simulation: name in the check, and column of the table.
HELD: Final = {
    "acceleration": "a_y",
    "comfort index": "N_y",
    "vertical acceleration": "a_z",
    "vertical comfort index": "N_z",
}


def ridden(load_case: str, wind: float, seed: int = 1) -> dict[str, Any]:
    """Return the results of one ride: values of the bench, and of both rides with the U of their difference."""
    given = {"load": load_case, "wind": f"{wind:g} m/s", "duration": "300 s"}
    with (
        tempfile.TemporaryDirectory() as folder,
        RigInMemory(Rig(load("astb"), seed=seed)).bench(seed=seed) as bench,
    ):
        bench.instruments = ordinary()
        result = execute(plans()["ride"].given(given), bench, Path(folder) / "ride", rig="virtual", seed=seed)
    checks = {one.name: one for one in result.checks}
    cell: dict[str, Any] = {"load": load_case, "wind": wind, "verdict": result.verdict.value}
    for name in (SHAKES, COMFORT, RISES, COMFORT_UPWARD, COMFORT_OF_BOTH):
        cell[str(name)] = checks[name].value
    for what, short in HELD.items():
        note = checks[AGREES.of(what=what)].note or checks[AGREES.of(what=what)].reason
        if (both := _BOTH.search(note)) is not None:
            cell[short] = [float(both[key]) for key in ("bench", "alone", "U")]
    return cell


def table(cells: list[dict[str, Any]]) -> str:
    """Return the table of all cells, a row each."""
    text = HEAD
    for one in cells:
        columns = [one["load"], f"{one['wind']:g}"]
        for a, N in (("a_y", "N_y"), ("a_z", "N_z")):
            columns += [f"{number:.4f}" for number in one[a]]
            columns += [f"{number:.3f}" for number in one[N][:2]]
        text += f"| {' | '.join([*columns, f'{one[str(COMFORT_OF_BOTH)]:.3f}'])} |\n"
    return text


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/rides.jsonl"), show_default=True)
def main(out: Path) -> None:
    """Measure the missing cells, and write the table into the page."""
    out.parent.mkdir(parents=True, exist_ok=True)
    cells = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    known = {(one["load"], one["wind"]) for one in cells}
    for load_case in LOADS:
        for wind in WIND_SPEEDS:
            if (load_case, wind) not in known:
                cells.append(ridden(load_case, wind))
                with out.open("a") as file:
                    file.write(json.dumps(cells[-1]) + "\n")
                click.echo(f"{load_case}, {wind:g} m/s: {cells[-1]['verdict']}")
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(f"{BEGIN}\n", 1)
    _, after = rest.split(END, 1)
    PAGE.write_text(f"{before}{BEGIN}\n{table(cells)}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
