"""`astb diagnose`, `astb investigate` and `astb identify`: what a model gets wrong, and what springs are."""

import signal
from pathlib import Path
from typing import Final

import click

from astb.commands.options import (
    JSON_OPTION,
    RIG_OPTION,
    SEED,
    effect_options,
    read_rig,
    read_specimen,
    simulated,
)
from astb.exit_codes import BLOCKED, blocked, misuse
from astb.tables import open_console, plain_console, print_json
from bench_protocol.runtime.one_core import keep_algebra_to_one_core
from bench_records.layout import RecordError
from drivers.errors import BenchError

_MAP_OPTION: Final = click.option(
    "--map",
    "map_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="What the columns of CSV, Parquet or MDF 4 files are (TOML).",
)
_SIMULATOR_OPTION: Final = click.option(
    "--simulator",
    metavar="MODULE:FACTORY|FMU",
    help="One of your own, such as my_oscillator:Oscillator or my.fmu, in place of the bench.",
)
_MODEL_OPTION: Final = click.option(
    "--model",
    default="astb",
    show_default=True,
    help="The model in doubt: a parameter set, or path of a parameter or model file.",
)
_RESULT_OPTION: Final = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Where finding, report and extended model go.",
)


@click.command("diagnose")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA...")
@_MAP_OPTION
@_SIMULATOR_OPTION
@_MODEL_OPTION
@click.option("--effects", metavar="NAME,...", help="Only these of the catalogue.  [default: all]")
@click.option("--seed", type=SEED, default=1, show_default=True, help="Of everything that is drawn.")
@_RESULT_OPTION
def diagnose_command(
    data: tuple[Path, ...],
    map_path: Path | None,
    simulator: str | None,
    model: str,
    effects: str | None,
    seed: int,
    out: Path,
) -> None:
    """Find what a model gets wrong, name the cause, add it, and measure the gain.

    DATA are directories that `astb run screening` has written, or any files that --map explains; files whose columns
    are named like the signals of a --simulator need no map, unless it is an FMU. Writes DIR/finding.json, report.html
    and, where something was found on the bench, extended.toml: a model that `astb run --model` takes; of an FMU
    parameters.toml and parameters.ssv. Ends with 0 whatever the verdict, 2 for misuse.
    """
    keep_algebra_to_one_core()
    from astb.diagnose import Request, diagnose_data, show

    try:
        finding = diagnose_data(
            Request(data, map_path, simulator, model, effects, seed), out, plain_console(stderr=True)
        )
    except (ValueError, RecordError) as error:
        misuse(error)
    show(finding, out, plain_console())


@click.command("investigate")
@RIG_OPTION
@click.option("--virtual", is_flag=True, help="In virtual time, without sockets.")
@click.option(
    "--seed", type=SEED, help="Draws the simulated rig's sensors and their noise, and the diagnosis."
)
@effect_options
@click.option("--budget", default="20 min", show_default=True, help="Of the bench's time.")
@_MODEL_OPTION
@_RESULT_OPTION
def investigate_command(
    rig_named: str | None,
    virtual: bool,
    seed: int | None,
    effects: tuple[str, ...],
    sealed: str | None,
    budget: str,
    model: str,
    out: Path,
) -> None:
    """Screen a rig, diagnose, and run what would decide, until there is a verdict or the budget is spent.

    Writes DIR/investigation.json, the log of decisions; a directory for each record; finding, report and extended
    model as `astb diagnose` does. Ends with 0 whatever the verdict, 2 for misuse, 3 if the rig keeps it from one.
    """
    keep_algebra_to_one_core()
    from astb.investigate import investigate_rig

    rig, path = read_rig(rig_named)
    rig = simulated(rig, path, None, effects, sealed)
    # Whoever ends the run, tear-down runs.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        done = investigate_rig(rig, path, virtual=virtual, seed=seed, budget=budget, model=model, out=out)
    except (ValueError, RecordError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    if not done:
        raise click.exceptions.Exit(BLOCKED)


@click.command("identify")
@click.argument("data", nargs=-1, type=click.Path(path_type=Path), metavar="[RUN]...")
@_MAP_OPTION
@_SIMULATOR_OPTION
@click.option(
    "--specimen", "specimen_name", metavar="SPECIMEN", help="The drawing of the springs, over --model."
)
@click.option(
    "--model",
    default="astb",
    show_default=True,
    help="What is believed beforehand: a parameter set, or path of a parameter or model file.",
)
@click.option("--expect", metavar="PLAN", help="Say what is known after this plan, too, before it is run.")
@JSON_OPTION
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File for what was identified (TOML): of springs a model file.",
)
def identify_command(
    data: tuple[Path, ...],
    map_path: Path | None,
    simulator: str | None,
    specimen_name: str | None,
    model: str,
    expect: str | None,
    as_json: bool,
    out: Path | None,
) -> None:
    """Identify springs or any simulator: every parameter from records, with its uncertainty.

    RUN are records of `astb run identification`, or of any plan that a model can replay, from whatever rig; other files
    need --map. --out writes a model that `astb run`, `rehearse` and `diagnose` take as --model. Without a RUN it says
    how well the plan of --expect would tell each parameter, before it is run. With --simulator the parameters are those
    that the map of an FMU names in [fmu.base], or the nuisances of a simulator of your own; of an FMU --out also writes
    a parameter set (SSV). Ends with 0, or 2 for misuse.
    """
    if out is not None and not data:
        misuse(f"--out {out}: without a record nothing is identified; name a RUN, or leave --out out")
    keep_algebra_to_one_core()
    from astb.identify import Request, identify_data, show

    specimen = read_specimen(specimen_name) if specimen_name else None
    try:
        answer = identify_data(
            Request(data, map_path, model, specimen, expect, simulator), out, plain_console(stderr=True)
        )
    except (ValueError, RecordError) as error:
        misuse(error)
    if as_json:
        print_json(answer)
    else:
        show(answer, out, open_console())
