"""The command `astb`: start a rig, run plans on one, show what crosses its wires, make reports.

Exit codes: 0 pass, 1 fail, 2 misuse, 3 blocked (the rig or a precondition broke, not the product).
Everything heavy is imported inside the commands: `astb --help` answers at once.
"""

import gc
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

import click

from astb.exit_codes import BLOCKED, FAIL, MISUSE, PASS
from astb.plugins import ExtensibleGroup

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from test_plans.plan import Plan

SEED: Final = click.IntRange(0, 2**32 - 1)
_EXIT: Final = {"pass": PASS, "fail": FAIL, "blocked": BLOCKED}

RIG_OPTION: Final = click.option(
    "--rig",
    "rig_path",
    type=click.Path(path_type=Path),
    help="Rig file (TOML).  [default: rigs/local.toml]",
)
_SIMULATION_OPTIONS: Final = (
    click.option("--model", help="Parameter set, or path of a parameter or model file; over the rig file."),
    click.option(
        "--effect",
        "effects",
        multiple=True,
        metavar="NAME=VALUE",
        help="Give the simulated rig an effect, such as leak.left=0.2mm2; repeatable. `astb effects` lists them.",
    ),
    click.option("--sealed", help="File with effects that are recorded and shown nowhere."),
)


def simulation_options(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command say what the simulated rig simulates, over the rig file: see `simulated`."""
    for option in reversed(_SIMULATION_OPTIONS):
        command = option(command)
    return command


def effect_options(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command give the simulated rig effects, its model being that of the rig file: see `simulated`."""
    for option in reversed(_SIMULATION_OPTIONS[1:]):
        command = option(command)
    return command


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


#: New objects before the youngest are looked through; how often that before the next older ones are, and then all.
#: Python's own numbers but for the last, which is 10 there.
GARBAGE_COLLECTED_AFTER: Final = (700, 10, 100)


def main() -> NoReturn:
    """Run the command line; errors that people can mend are one sentence, not a traceback."""
    # What imports bring stays to the end: to look through all of it for garbage took 0.16 s of a short command.
    gc.set_threshold(*GARBAGE_COLLECTED_AFTER)
    try:
        sys.exit(commands(standalone_mode=False) or PASS)
    except click.exceptions.Exit as end:
        sys.exit(end.exit_code)
    except click.Abort:
        click.echo("interrupted", err=True)
        sys.exit(BLOCKED)
    except click.ClickException as error:
        error.show()
        sys.exit(MISUSE)
    except Exception:
        # Python would end with 1, which says that the product failed.
        traceback.print_exc()
        sys.exit(BLOCKED)


def misuse(error: Exception | str) -> NoReturn:
    """End the command: the user asked for something that cannot be."""
    click.echo(f"astb: {error}", err=True)
    raise click.exceptions.Exit(MISUSE)


def blocked(error: Exception | str) -> NoReturn:
    """End the command: the rig or a precondition broke."""
    words = error.strerror if isinstance(error, OSError) and error.strerror else error
    click.echo(f"astb: {words}", err=True)
    raise click.exceptions.Exit(BLOCKED)


@click.group(cls=ExtensibleGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="astb")
def commands() -> None:
    """A virtual test bench for railway air springs that behaves like the real rig down to its wires."""


@commands.command("rig")
@RIG_OPTION
@click.option("--can", help="auto, tcp, or a SocketCAN interface such as vcan0; over the rig file.")
@click.option("--can-port", type=click.IntRange(0, 65535), help="TCP port of the CAN hub, 0 for a free one.")
@click.option("--modbus-port", type=click.IntRange(0, 65535), help="TCP port of Modbus, 0 for a free one.")
@click.option("--seed", type=SEED, help="Draws this rig's sensors and their noise.")
@simulation_options
@click.option("--beacon", is_flag=True, help="Announce the CAN hub on the loopback, for SavvyCAN.")
@click.option(
    "--allow-remote", is_flag=True, help="Open the ports to other machines; neither has a password."
)
@click.option("--until-eof", is_flag=True, hidden=True)
def rig_command(
    rig_path: Path | None,
    can: str | None,
    can_port: int | None,
    modbus_port: int | None,
    seed: int | None,
    model: str | None,
    effects: tuple[str, ...],
    sealed: str | None,
    beacon: bool,
    allow_remote: bool,
    until_eof: bool,
) -> None:
    """Run the simulated rig in real time until interrupted.

    Prints `ready can=… modbus=…` when both doors are open. SIGUSR1 presses the emergency stop, SIGUSR2 releases it.
    """
    import signal
    import threading

    from astb.session import build_rig
    from bench_sim.rig.process import Late, run_rig

    rig, path = _rig(rig_path)
    if rig.simulation is None:
        misuse(f"rig file {path} describes a real rig (no [simulation] table): there is nothing to simulate")
    rig = simulated(rig, path, model, effects, sealed)
    assert rig.simulation is not None
    try:
        bench = build_rig(rig.simulation, seed)
    except ValueError as error:
        misuse(error)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if until_eof:  # whoever started this rig holds the other end: the rig outlives nobody, however they end
        threading.Thread(target=_when_stdin_ends, args=(stop.set,), daemon=True).start()
    signal.signal(signal.SIGUSR1, lambda *_: bench.press_estop())
    signal.signal(signal.SIGUSR2, lambda *_: bench.release_estop())
    try:
        run_rig(
            bench,
            can=can or rig.can.bus,
            host=rig.can.host,
            can_port=rig.can.port if can_port is None else can_port,
            modbus_port=rig.modbus.port if modbus_port is None else modbus_port,
            allow_remote=allow_remote,
            beacon=beacon,
            policy=Late(rig.simulation.late_ticks),
            stop=stop,
            ready=lambda door, modbus: click.echo(f"ready can={door} modbus={modbus}"),
        )
    except ValueError as error:
        misuse(error)
    except OSError as error:
        blocked(error)


@commands.command("run")
@click.argument("plans", nargs=-1, required=True, metavar="PLAN...")
@RIG_OPTION
@click.option(
    "--virtual", is_flag=True, help="In virtual time, without sockets: the same plans, bytes and verdicts."
)
@click.option("--seed", type=SEED, help="Draws the simulated rig's sensors and their noise.")
@simulation_options
@click.option(
    "--out",
    "out",
    type=click.Path(path_type=Path),
    default=Path("runs"),
    show_default=True,
    help="Where records go.",
)
def run_command(
    plans: tuple[str, ...],
    rig_path: Path | None,
    virtual: bool,
    seed: int | None,
    model: str | None,
    effects: tuple[str, ...],
    sealed: str | None,
    out: Path,
) -> None:
    """Run test plans on a rig and write, for each, DIR/PLAN/ with record, result and report.

    An earlier run is never overwritten: the next one of the same plan goes to DIR/PLAN-2/, and so on. Ctrl-C and
    SIGTERM end the plan: the air is let off, and the report is written and says what the springs still hold.

    Ends with 0 if all pass, 1 if one fails, 2 for misuse, 3 if one is blocked.
    """
    import signal

    from astb.rig_file import RigFileError
    from astb.run import run_plans
    from bench_records.layout import RecordError
    from drivers.errors import BenchError

    known = _plans()
    unknown = [name for name in plans if name not in known]
    if unknown:
        misuse(f"there is no plan {unknown[0]!r}; `astb plans` lists {', '.join(known)}")
    rig, path = _rig(rig_path)
    rig = simulated(rig, path, model, effects, sealed)
    # Whoever ends the run, tear-down runs.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        verdicts = run_plans([known[name] for name in plans], rig, path, virtual=virtual, seed=seed, out=out)
    except (RigFileError, ValueError, RecordError) as error:
        misuse(error)
    except BenchError as error:
        blocked(error)
    raise click.exceptions.Exit(max(_EXIT[verdict] for verdict in verdicts))


@commands.command("plans")
def plans_command() -> None:
    """List the test plans."""
    known = _plans()
    width = max(map(len, known))
    for name, plan in known.items():
        click.echo(f"{name:<{width}}  {plan.title}")


@commands.command("effects")
def effects_command() -> None:
    """List the effects that a simulated rig can be given and a diagnosis can name."""
    from bench_sim.model.effects import CATALOGUE

    for effect in CATALOGUE.values():
        places = f".{'|'.join(effect.places)}" if effect.places else ""
        click.echo(f"{effect.name + places:<30} {effect.family:<12} {effect.title}")
        for one in effect.parameters:
            low, high, typical = (f"{value / one.scale:g}" for value in (one.low, one.high, one.typical))
            unit = "" if one.display == "1" else f" {one.display}"
            click.echo(f"    {one.name:<26} {low} to {high}{unit}, typically {typical}")


@commands.command("signals")
@click.option(
    "--dbc", type=click.Path(path_type=Path, dir_okay=False), help="Write the CAN messages as a DBC file."
)
@click.option(
    "--csv", type=click.Path(path_type=Path, dir_okay=False), help="Write the Modbus map as a CSV file."
)
def signals_command(dbc: Path | None, csv: Path | None) -> None:
    """List everything that crosses the wires, or write it for other tools."""
    generated = files("bench_protocol") / "generated"
    for target, source in ((dbc, "astb.dbc"), (csv, "modbus_map.csv")):
        if target is not None:
            try:
                target.write_bytes((generated / source).read_bytes())
            except OSError as error:
                misuse(f"{target} cannot be written: {error.strerror}")
            click.echo(target)
    if dbc is None and csv is None:
        from bench_protocol.table import TABLE

        click.echo(f"map {TABLE.map_hash:08x}")
        for row in TABLE.signals:
            click.echo(f"{row.name:<38} {row.kind:<12} {row.range_text():<28.60} {row.description}")


@commands.command("report")
@click.argument("directory", type=click.Path(path_type=Path, exists=True, file_okay=False))
def report_command(directory: Path) -> None:
    """Make the report of DIRECTORY anew; first recovers the record of a run that was killed."""
    from bench_records.layout import STREAM, RecordError
    from bench_records.recorder import recover
    from bench_records.report import write_report

    try:
        if (directory / STREAM).exists():
            click.echo(recover(directory))
        click.echo(write_report(directory))
    except RecordError as error:
        misuse(error)


@commands.command("diagnose")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA...")
@click.option(
    "--map",
    "map_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="What the columns of CSV, Parquet or MDF 4 files are (TOML).",
)
@_MODEL_OPTION
@click.option("--effects", metavar="NAME,...", help="Only these of the catalogue.  [default: all]")
@click.option("--seed", type=SEED, default=1, show_default=True, help="Of everything that is drawn.")
@_RESULT_OPTION
def diagnose_command(
    data: tuple[Path, ...], map_path: Path | None, model: str, effects: str | None, seed: int, out: Path
) -> None:
    """Find what a model gets wrong, name the cause, add it, and measure the gain.

    DATA are directories that `astb run screening` has written, or any files that --map explains. Writes
    DIR/finding.json, report.html and, for the bench, extended.toml: a model that `astb run --model` takes. Ends with 0
    whatever the verdict, 2 for misuse.
    """
    _keep_algebra_to_one_core()
    from rich.console import Console

    from astb.diagnose import Request, diagnose_data, show
    from bench_records.layout import RecordError

    try:
        finding = diagnose_data(Request(data, map_path, model, effects, seed), out, Console(stderr=True))
    except (ValueError, RecordError) as error:
        misuse(error)
    show(finding, out, Console())


@commands.command("investigate")
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
    rig_path: Path | None,
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
    _keep_algebra_to_one_core()
    import signal

    from astb.investigate import investigate_rig
    from bench_records.layout import RecordError
    from drivers.errors import BenchError

    rig, path = _rig(rig_path)
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


def _keep_algebra_to_one_core() -> None:
    """Let a diagnosis use its cores itself; numpy reads this when it is loaded.

    On a machine that has other work, two threads of OpenBLAS wait for each other: a product takes fifty times as long.
    """
    import os

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _when_stdin_ends(call: Callable[[], None]) -> None:
    sys.stdin.read()
    call()


def simulated(
    rig: "RigFile", path: Path, model: str | None, effects: Sequence[str], sealed: str | None
) -> "RigFile":
    """Return ``rig`` with what the options of `simulation_options` say over the rig file."""
    from msgspec.structs import replace

    if not (model or effects or sealed):
        return rig
    if rig.simulation is None:
        misuse(
            f"rig file {path} describes a real rig (no [simulation] table): --model, --effect and --sealed are for "
            "simulated ones"
        )
    given: dict[str, str] = {}
    for text in effects:
        name, equals, value = text.partition("=")
        if not equals:
            misuse(f"--effect {text} has no amplitude: NAME=VALUE would be right, such as leak.left=0.2mm2")
        if name in given:
            misuse(f"--effect {name} is given twice")
        given[name] = value
    return replace(
        rig,
        simulation=replace(
            rig.simulation,
            parameters=model or rig.simulation.parameters,
            effects=rig.simulation.effects | given,
            sealed=sealed or rig.simulation.sealed,
        ),
    )


def _plans() -> "dict[str, Plan]":
    from test_plans.discovery import plans
    from test_plans.run import PlanError

    try:
        return plans()
    except PlanError as error:
        misuse(error)


def _rig(path: Path | None) -> "tuple[RigFile, Path]":
    """Return the rig file's content and its path; without a path that of `rigs/local.toml`."""
    from astb.rig_file import RigFileError, read

    path = path or Path("rigs/local.toml")
    try:
        return read(path), path
    except RigFileError as error:
        misuse(error)
