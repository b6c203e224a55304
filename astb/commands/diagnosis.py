"""`astb diagnose`, `astb investigate` and `astb identify`: errors and parameters of a model."""

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
from bench_protocol.runtime.own_process import keep_algebra_to_one_core
from bench_records.layout import RecordError
from drivers.errors import BenchError

_MAP_OPTION: Final = click.option(
    "--map",
    "map_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="TOML file that describes the columns of CSV, Parquet or MDF 4 files.",
)
_SIMULATOR_OPTION: Final = click.option(
    "--simulator",
    metavar="MODULE:FACTORY|FMU",
    help="Your own model instead of the model of ASTB, such as my_oscillator:Oscillator or my.fmu.",
)
_MODEL_OPTION: Final = click.option(
    "--model",
    default="astb",
    show_default=True,
    help="Model to examine: a parameter set, or the path of a parameter or model file.",
)
_RESULT_OPTION: Final = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for finding, report and extended model.",
)


@click.command("diagnose")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA...")
@_MAP_OPTION
@_SIMULATOR_OPTION
@_MODEL_OPTION
@click.option(
    "--effects",
    metavar="NAME,...",
    help="Consider only these effects of `astb list effects`.  [default: all]",
)
@click.option("--seed", type=SEED, default=1, show_default=True, help="Random seed.")
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
    """Find errors of a model in measured data, and extend the model.

    DATA are folders of runs, such as those of `astb run screening`, or data files with a --map. A map is not necessary
    if the columns have the signal names of the --simulator. For an FMU, a map is always necessary.

    The command compares data and model, identifies the cause of a deviation, adds it to the model and validates the
    result. It writes OUT/finding.json and OUT/report.html. If it finds a cause, it also writes extended.toml, a model
    for `astb run --model`; for an FMU it writes parameters.toml and parameters.ssv.

    Exit codes: 0 for any result of the diagnosis, 2 for wrong usage.
    """
    keep_algebra_to_one_core()
    from astb.diagnose import DiagnosisRequest, diagnose_data, show

    try:
        finding = diagnose_data(
            DiagnosisRequest(data, map_path, simulator, model, effects, seed), out, plain_console(stderr=True)
        )
    except (ValueError, RecordError) as error:
        misuse(error)
    show(finding, out, plain_console())


@click.command("investigate")
@RIG_OPTION
@click.option("--virtual", is_flag=True, help="Simulate the rig in virtual time, without sockets.")
@click.option(
    "--seed",
    type=SEED,
    help="Random seed of simulated sensors and diagnosis.  [default: from the rig file, 1 for the diagnosis]",
)
@effect_options
@click.option("--budget", default="20 min", show_default=True, help="Maximum test time on the rig.")
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
    """Run tests on a rig until the cause of a model error is clear.

    The first test is the plan screening. After each diagnosis, the next test is the one that separates the remaining
    causes best. The command ends when the cause is clear or the --budget is used.

    It writes OUT/investigation.json, the log of its decisions, a folder for each run, and the files of `astb diagnose`.

    Exit codes: 0 for any result of the diagnosis, 2 for wrong usage, 3 if the rig blocks the tests.
    """
    keep_algebra_to_one_core()
    from astb.investigate import investigate_rig

    rig, path = read_rig(rig_named)
    rig = simulated(rig, path, None, effects, sealed)
    # The tear-down runs after any end of the run.
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
    "--specimen",
    "specimen_name",
    metavar="SPECIMEN",
    help="Specimen; its drawing values replace those of --model.",
)
@click.option(
    "--model",
    default="astb",
    show_default=True,
    help="Starting values and their uncertainty (prior): a parameter set, or the path of a parameter or model file.",
)
@click.option("--expect", metavar="PLAN", help="Also predict the uncertainty after a run of this plan.")
@JSON_OPTION
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="TOML file for the identified parameters; for springs it is a model file.",
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
    """Estimate parameters from runs, with their uncertainty.

    RUN are folders of runs, such as those of `astb run identification`, or data files with a --map. --out writes a
    model for the option --model of `astb run`, `rehearse` and `diagnose`. Without RUN, --expect predicts the
    uncertainty of each parameter after a run of this plan.

    With --simulator, the parameters are those in [fmu.base] of the map of an FMU, or the nuisance parameters of your
    own simulator. For an FMU, --out also writes a parameter set (SSV).

    Exit codes: 0 for any result, 2 for wrong usage.
    """
    if out is not None and not data:
        misuse(f"--out {out} needs data: name a RUN, or remove --out")
    keep_algebra_to_one_core()
    from astb.identify import IdentificationRequest, identify_data, show

    specimen = read_specimen(specimen_name) if specimen_name else None
    try:
        answer = identify_data(
            IdentificationRequest(data, map_path, model, specimen, expect, simulator),
            out,
            plain_console(stderr=True),
        )
    except (ValueError, RecordError) as error:
        misuse(error)
    if as_json:
        print_json(answer)
    else:
        show(answer, out, open_console())
