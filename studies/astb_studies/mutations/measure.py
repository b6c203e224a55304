"""Measures which faults the plans detect and whether sound rigs pass: ``python -m astb_studies.mutations.measure``."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from subprocess import run
from typing import Any, Final

import click

from astb.campaigns.findings import FAILED
from astb.campaigns.plan_case import PlanCase, by_key, facts, run_plan_case, warm_up
from astb.campaigns.run import Standing, run_cases
from astb.rig_file import Simulation
from astb_studies.mutations.faults import (
    FOUND,
    HERE,
    SEED,
    SOUND,
    Cell,
    Mutation,
    judge,
    mutations,
    read_cells,
    write_cells,
)
from astb_studies.mutations.healthy import NOT_BEGUN, SoundRun, read_sound_runs, sound_rig, write_sound_runs
from astb_studies.mutations.page import PAGE, page
from test_plans.discovery import plans as all_plans
from test_plans.parameters import Parameter

#: No plan takes that long (s), even on a busy machine.
LIMIT = 600.0
#: What a precondition found, in brackets after its name.
DETAILS: Final = re.compile(r" \((?:[^()]|\([^()]*\))*\)")
#: Parameters that only make a run longer.
LENGTHS = frozenset({"duration", "cycles", "intervals", "hold", "within"})
#: Parameters that state the specimen on the bench: the virtual bench always has springs.
STANDS_THERE = frozenset({"dummy"})


def sound_case(plan: str) -> PlanCase:
    """Return the plan on a rig as drawn, with which all others are compared."""
    return PlanCase(plan=plan, simulation=Simulation(seed=SEED), variant=SOUND)


def fault_cases(plan: str, faults: Iterable[Mutation]) -> list[PlanCase]:
    """Return the plan on a rig with each of the faults."""
    return [PlanCase(plan=plan, simulation=one.simulation, variant=one.name) for one in faults]


def detectable_faults(sound: Mapping[str, Any]) -> list[Mutation]:
    """Return the faults that some check of the plan in the row ``sound`` is meant for."""
    table, names = mutations(), [check["name"] for check in sound["checks"]]
    return [one for one in table.mutation if any(table.is_right(one, name) for name in names)]


def cells_of(rows: Iterable[Mapping[str, Any]]) -> list[Cell]:
    """Return the cells of the matrix that follow from rows of `fault_cases` and of the `sound_case` of each plan.

    ValueError for a case that came to no verdict, or a sound rig that was rejected.
    """
    table = mutations()
    found = {(row["plan"], row["variant"]): row for row in rows}
    for (plan, variant), row in found.items():
        if row["error"] or (variant == SOUND and row["verdict"] != "pass"):
            raise ValueError(
                f"{plan} on a rig with {variant}: {row['error'] or row['reason'] or row['verdict']}"
            )
    return [
        judge(table, one, found[plan, one.name], found[plan, SOUND])
        for plan in sorted({plan for plan, _ in found})
        for one in table.mutation
        if (plan, one.name) in found
    ]


def sound_cases(plans: list[str], count: int, first: int = 0) -> list[PlanCase]:
    """Return ``count`` sound rigs, no two alike, under each of the plans in turn, over the ranges of its parameters."""
    return [
        PlanCase(
            plan=(plan := plans[seed % len(plans)]),
            values=drawn_values(plan, seed // len(plans)),
            simulation=sound_rig(seed),
            variant="sound rig",
        )
        for seed in range(first, first + count)
    ]


def drawn_values(plan: str, index: int) -> dict[str, str]:
    """Return the values of a plan's parameters at a point of a Halton design over their whole ranges.

    Files, parameters that only make a run longer, and parameters that state the specimen have their defaults.
    """
    from scipy.stats import qmc

    fixed = LENGTHS | STANDS_THERE
    drawn = [one for one in all_plans()[plan].parameters if not one.file and one.name not in fixed]
    if not drawn:
        return {}
    places = qmc.Halton(len(drawn), seed=0).fast_forward(index).random(1)[0]
    return {one.name: _value_text(one, float(place)) for one, place in zip(drawn, places, strict=True)}


def _value_text(one: Parameter, place: float) -> str:
    """Return the value of a parameter at a ``place`` from 0 to 1, as text."""
    if one.range is None:
        return one.choices[int(place * len(one.choices))]
    value = one.range.low + place * (one.range.high - one.range.low)
    return one.show(round(value) if one.whole else float(f"{value:.4g}"))


def sound_run(row: Mapping[str, Any]) -> SoundRun:
    """Return the result in the row of a sound rig."""
    if row["error"]:  # it has no verdict; if no case has one, the column is missing too
        verdict, message = "error", row["error"]
    else:
        failed = [check["name"] for check in row["checks"] or () if check["verdict"] in FAILED]
        verdict, message = row["verdict"], "; ".join(failed) or row["reason"]
    if message.startswith(NOT_BEGUN):  # which precondition; the values are in their own column
        message = DETAILS.sub("", message)
    values = ", ".join(f"{name} = {value}" for name, value in row.get("values", {}).items() if value)
    return SoundRun(
        plan=row["plan"],
        seed=row["seed"],
        verdict=verdict,
        told=message,
        version=row.get("version", ""),
        values=values,
    )


def _version() -> str:
    """Return commit and date of this code from git, and whether it has uncommitted changes."""

    def git(*words: str) -> str:
        return run(["git", *words], cwd=HERE, check=True, capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ":/*.py", ":/*.toml")
    return git("log", "-1", "--format=%h %cs") + (", changed" if changed else "")


def _carried_out(cases: list[PlanCase], out: Path, workers: int | None) -> list[dict[str, Any]]:
    def watch(standing: Standing) -> None:
        left = "" if standing.time_left is None else f", {standing.time_left:.0f} s left"
        click.echo(
            f"{standing.before + standing.done} of {standing.total}{left}  {standing.row.get('key', '')}"
        )

    version = _version()
    return run_cases(
        run_plan_case,
        by_key(cases),
        out,
        facts=lambda case: facts(case) | {"version": version},
        workers=workers,
        limit=LIMIT,
        prepare=warm_up,
        watch=watch,
    )


@click.group()
def main() -> None:
    """Measure which faults the plans detect. After an interruption, the same command continues."""


@main.command("faults")
@click.argument("out", type=click.Path(path_type=Path))
@click.argument("plans", nargs=-1, required=True)
@click.option(
    "--meant", is_flag=True, help="Only the faults that a check of the plan is meant for: for long plans."
)
@click.option("--workers", type=int, help="Number of processes (default: number of cores).")
def faults_command(out: Path, plans: tuple[str, ...], meant: bool, workers: int | None) -> None:
    """Run PLANS on a rig with each fault, and replace the stored results of these plans."""
    rows = _carried_out([sound_case(plan) for plan in plans], out, workers)
    faults = {row["plan"]: detectable_faults(row) if meant else mutations().mutation for row in rows}
    rows += _carried_out([case for plan in plans for case in fault_cases(plan, faults[plan])], out, workers)
    kept = [cell for cell in read_cells() if cell.plan not in plans]
    write_cells(FOUND, sorted(kept + cells_of(rows), key=lambda cell: cell.plan))


@main.command("sound")
@click.argument("out", type=click.Path(path_type=Path))
@click.argument("plans", nargs=-1, required=True)
@click.option("--rigs", type=int, default=340, help="How many sound rigs.")
@click.option(
    "--first", type=int, default=0, help="Seed of the first one; rigs with other seeds stay as they are."
)
@click.option("--workers", type=int, help="Number of processes (default: number of cores).")
def sound_command(out: Path, plans: tuple[str, ...], rigs: int, first: int, workers: int | None) -> None:
    """Run PLANS in turn on sound rigs that are drawn from their tolerances, over the ranges of their parameters."""
    found = [sound_run(row) for row in _carried_out(sound_cases(list(plans), rigs, first), out, workers)]
    seeds = {run.seed for run in found}
    write_sound_runs([run for run in read_sound_runs() if run.seed not in seeds] + found)


@main.command("page")
def page_command() -> None:
    """Write the page from the stored results."""
    PAGE.write_text(page(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
