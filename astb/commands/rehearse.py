"""`astb rehearse`: simulate a plan in virtual time before a rig moves, and print the margins to its limits."""

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec.structs import replace

from astb.commands.completion import complete_plans
from astb.commands.options import (
    RIG_OPTION,
    SEED_OPTION,
    pairs,
    read_rig,
    read_specimen,
    simulated,
    simulation_options,
)
from astb.commands.plan_values import chosen_plans, plan_value_options
from astb.exit_codes import BLOCKED, PASS, REFUSED, blocked, misuse
from astb.operators import operator_for
from astb.rig_file import RigFileError
from astb.tables import plain_console
from bench_records.layout import RecordError
from bench_records.run_folder import circumstances
from drivers.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from astb.rehearsal.again import Past
    from astb.rehearsal.rehearsing import Rehearsal
    from astb.rig_file import RigFile, Simulation
    from test_plans.plan import Plan

#: Limits that the terminal shows; the page has them all.
_SHOWN: Final = 6
#: Exit codes by how a rehearsal ended; of several plans the last in this order counts.
_EXIT: Final = {"clear": PASS, "blocked": BLOCKED, "refused": REFUSED}
_STYLE: Final = {"clear": "bold green", "blocked": "bold magenta", "refused": "bold red"}


@click.command("rehearse")
@click.argument("plans", nargs=-1, metavar="[PLAN]...", shell_complete=complete_plans)
@click.option(
    "--from",
    "kept",
    metavar="RUN@TIME",
    help="Repeat a recorded virtual run up to this time, such as runs/aw0@70s, and continue it with changes.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="FAULT",
    help='With --from: switch this fault on, as `astb rig fault on` does, such as "leak side=left area=2mm2".',
)
@click.option(
    "--change",
    "changes",
    multiple=True,
    metavar="NAME=VALUE",
    help="With --from: change this parameter, such as orifice_diameter=12mm, or orifice_diameter=12mm,18mm for left "
    "and right.",
)
@RIG_OPTION
@SEED_OPTION
@simulation_options
@plan_value_options
def rehearse_command(
    plans: tuple[str, ...],
    kept: str | None,
    faults: tuple[str, ...],
    changes: tuple[str, ...],
    rig_named: str | None,
    seed: int | None,
    model: str | None,
    effects: tuple[str, ...],
    sealed: str | None,
    specimen_name: str | None,
    settings: tuple[str, ...],
    values_path: Path | None,
    answers: str | None,
    out: Path,
) -> None:
    """Simulate test plans, and print their margins to limits.

    The plan runs on a simulated rig, and no command is sent to a real rig. The simulated rig has the limits of the rig
    file, and assumed limits where the file has none. --model takes the extended model of a diagnosis. Each plan gets a
    folder OUT/PLAN-rehearsal with rehearsal.html, rehearsal.json and the record.

    --from repeats a recorded virtual run, with the same --rig and --model. It checks that the repeated run is identical
    up to the given time. From there it continues with --fault, --effect or --change, and prints both runs.

    \b
    Exit codes:
      0  no limit trips, even if checks fail
      2  wrong usage
      3  the plan is blocked for another reason than a limit
      5  a limit would trip; step, value and time are printed
    """
    from astb.rehearsal.page import word, write_page

    past = _past(plans, kept, faults, effects, changes)
    chosen = chosen_plans(plans, settings, values_path) if past is None else (past.plan,)
    specimen = read_specimen(specimen_name)
    rig, path = read_rig(rig_named)
    simulation = _simulation(rig, path, model, () if past else effects, sealed)
    console, ends = plain_console(), []
    try:
        # Without answers a rehearsal asks nobody, because it must end by itself.
        operator = operator_for(answers, console) if answers else None
        others = {"simulation": simulation, "seed": seed, "specimen": specimen, "operator": operator}
        if past is not None:
            others |= past.again(simulation)
        for plan in chosen:
            found, directory = _rehearsed(console, plan, rig, path, out, others)
            _show(console, found, write_page(found, directory))
            ends.append(word(found))
            if past is not None:
                for line in past.report(directory):
                    console.print(line, soft_wrap=True, highlight=False)
    except (RigFileError, ValueError, RecordError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    raise click.exceptions.Exit(_EXIT[max(ends, key=list(_EXIT).index)])


def _past(
    plans: tuple[str, ...],
    kept: str | None,
    faults: tuple[str, ...],
    effects: tuple[str, ...],
    changes: tuple[str, ...],
) -> "Past | None":
    """Return the recorded run of ``--from`` with its changes, or None if plans are rehearsed.

    Contradictory options end the command.
    """
    if bool(plans) == bool(kept) or ((faults or changes) and not kept):
        misuse("name either a PLAN, or a run with --from RUN@TIME; --fault and --change need --from")
    if not kept:
        return None
    from astb.rehearsal.again import Changes, Past

    begin = pairs(effects, "has no value; write NAME=VALUE, such as leak.left=0.2mm2", option="--effect ")
    other = pairs(
        changes, "has no value; write NAME=VALUE, such as orifice_diameter=12mm", option="--change "
    )
    try:
        return Past.named(kept, Changes([_fault(text) for text in faults], begin, _by_side(other)))
    except (ValueError, RecordError) as error:
        misuse(error)


def _by_side(texts: "Mapping[str, str]") -> "dict[str, str | list[str]]":
    """Return parameter values. A text with commas becomes a list with one value for each side, actuator or branch."""
    return {name: re.split(r",\s*", text) if "," in text else text for name, text in texts.items()}


def _fault(text: str) -> tuple[str, dict[str, str]]:
    """Return name and values of a fault in the notation of `astb rig fault on`."""
    name, *values = shlex.split(text) or [""]
    return name, pairs(values, "has no value; write KEY=VALUE, such as area=2mm2", option=f"--fault {name} ")


def _rehearsed(
    console: "Console", plan: "Plan", rig: "RigFile", path: Path, out: Path, others: dict[str, Any]
) -> "tuple[Rehearsal, Path]":
    """Rehearse ``plan`` with a progress bar on the screen. ``others`` are further arguments of `rehearse`."""
    from astb.display import ProgressDisplay
    from astb.rehearsal.rehearsing import rehearse
    from test_plans.run import NullWatcher

    with ProgressDisplay(console) as display:

        class Progress(NullWatcher):
            """Receives only the progress; steps and checks are ignored."""

            def progress(self, fraction: float) -> None:
                display.progress(fraction)

        def begin(meta: dict[str, Any]) -> None:
            display.introduce(" · ".join(["REHEARSAL", *circumstances(meta)]))
            display.begin(plan.name)

        return rehearse(plan, rig, path, out, watcher=Progress(), begin=begin, **others)


def _simulation(
    rig: "RigFile", path: Path, model: str | None, effects: tuple[str, ...], sealed: str | None
) -> "Simulation":
    """Return the simulation of ``rig`` with the options of the command."""
    from astb.rehearsal.rehearsing import simulation_of

    acting = simulated(replace(rig, simulation=simulation_of(rig)), path, model, effects, sealed)
    assert acting.simulation is not None
    return acting.simulation


def _show(console: "Console", found: "Rehearsal", page: Path) -> None:
    from astb.rehearsal.page import limit_line, sentence, word

    def print_line(text: str, style: str = "") -> None:
        console.print(text, style=style, soft_wrap=True)

    for note in found.notes:
        print_line(f"  {note}", "yellow")
    for row in found.limits[:_SHOWN]:
        print_line(f"  {limit_line(row)}")
    for one in found.indicated:
        print_line(f"  warning only, the plan continues: {one}", "yellow")
    end = word(found)
    print_line(f"{found.plan}: {end.upper()}: {sentence(found)}", _STYLE[end])
    if end == "clear":
        print_line(f"  verdict on the simulated spring: {found.verdict}")
    print_line(f"  page: {page}")
