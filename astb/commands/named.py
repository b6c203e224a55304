"""`astb list` and `astb copy`: files and effects that have a name."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from shutil import copyfile, copytree
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click
from click.shell_completion import CompletionItem

from astb.commands.completion import complete_from
from astb.commands.options import JSON_OPTION, read_rig, read_specimen
from astb.exit_codes import misuse
from astb.rig_file import rigs
from astb.tables import print_json
from bench_protocol.dimensions import NAMES, DimensionsError, read_dimensions
from bench_protocol.named_files import named_files, named_folders, place_of, source_of
from bench_protocol.os_errors import reason
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import kN
from drivers.errors import WiringError

if TYPE_CHECKING:
    from bench_sim.model.effects.effect import Effect
    from test_plans.instruments import Instruments


class Listed(NamedTuple):
    """The output for one name: as text, and as JSON."""

    line: str
    facts: Mapping[str, Any]


class Kind(NamedTuple):
    """A kind of named things. ``known`` returns their paths by name; effects have no path."""

    singular: str
    known: Callable[[], Mapping[str, Path | None]]
    describe: Callable[[str], Listed]


def _rigs() -> Mapping[str, Path]:
    return rigs()


def _rig(name: str) -> Listed:
    rig, path = read_rig(name)
    kind = "simulated" if rig.simulation else "real, own wiring" if rig.wiring else "real"
    return Listed(
        f"{kind}, {rig.time} time: {rig.description}",
        {
            "description": rig.description,
            "simulated": rig.simulation is not None,
            "time": rig.time,
            "file": str(path),
        },
    )


def _files_of(package: str) -> Callable[[], Mapping[str, Path]]:
    def known() -> Mapping[str, Path]:
        return named_files(package)

    return known


def _specimen(name: str) -> Listed:
    one = read_specimen(name)
    loads = {load.name: load.preload for load in one.loads.values()}
    preloads = ", ".join(f"{load} {preload / kN:g} kN" for load, preload in loads.items())
    return Listed(
        f"{one.type}, serial number {one.serial_number}, drawing: {one.drawing}; {preloads}",
        {**one.facts, "preload_N": loads},
    )


def _instruments(name: str) -> Listed:
    one = _read_instruments(name)
    types = sorted({piece.instrument.type for piece in one.pieces.values()})
    return Listed(f"{len(one.pieces)} readings: {'; '.join(types) or 'none'}", {**one.facts})


def _read_instruments(name: str) -> "Instruments":
    from test_plans.instruments import InstrumentsError, read_instruments

    try:
        return read_instruments(name)
    except InstrumentsError as error:
        misuse(error)


def _dimensions(name: str) -> Listed:
    try:
        one = read_dimensions(name)
    except DimensionsError as error:
        misuse(error)
    missing = [wanted for wanted in NAMES if wanted not in one.known]
    lacking = f"; not stated: {', '.join(missing)}" if missing else ""
    return Listed(f"{len(one.known)} of {len(NAMES)} dimensions{lacking}", {**one.facts, "missing": missing})


def _wiring(name: str) -> Listed:
    from bench_protocol.table import TABLE
    from drivers.wiring.description import PACKAGE, read_description

    path = place_of(PACKAGE, name)
    try:
        one = read_description(path, TABLE)
    except WiringError as error:
        misuse(error)
    return Listed(one.text, {"description": one.text, "sha256": one.digest, "file": str(path)})


def _sets() -> Mapping[str, Path]:
    from bench_sim import parameters

    return {name: Path(parameters.__file__).with_name(f"{name}.toml") for name in parameters.SETS}


def _parameters(name: str) -> Listed:
    from bench_sim.parameters import ParameterError, load

    try:
        one = load(name)
    except ParameterError as error:
        misuse(error)
    loads = ", ".join(one.load_cases)
    return Listed(
        f"{len(one.entries)} parameters, each with its source; load cases {loads}",
        {"load_cases": list(one.load_cases), "sha256": one.digest(), "file": str(_sets()[name])},
    )


def _demos() -> Mapping[str, Path]:
    return named_folders("demos")


def _demo(name: str) -> Listed:
    folder = _demos().get(name) or misuse(f"there is no demo {name!r}; {did_you_mean(name, _demos())}")
    (mapped,) = folder.glob("*.toml")
    title = mapped.read_text(encoding="utf-8").partition(":")[0].lstrip("# ")
    files = sorted(path.name for path in folder.iterdir() if path != mapped)
    return Listed(f"{title}; {len(files)} files", {"title": title, "map": mapped.name, "files": files})


def _catalogue() -> "Mapping[str, Effect]":
    from bench_sim.model.effects import CATALOGUE

    return CATALOGUE


def _effect(name: str) -> Listed:
    effect = _catalogue().get(name) or misuse(
        f"there is no effect {name!r}; {did_you_mean(name, _catalogue())}"
    )
    places = f"; {' or '.join(f'{name}.{place}' for place in effect.places)}" if effect.places else ""
    lines, parameters = [f"{effect.family}: {effect.title}{places}"], []
    for one in effect.parameters:
        span = {end: getattr(one, end) / one.scale for end in ("low", "high", "typical")}
        low, high, typical = (f"{value:g}" for value in span.values())
        unit = "" if one.display == "1" else f" {one.display}"
        lines.append(f"    {one.name:<26} {low} to {high}{unit}, typically {typical}{unit}")
        parameters.append({"name": one.name, "unit": one.display, **span})
    facts = {
        "places": effect.places,
        "family": effect.family,
        "title": effect.title,
        "parameters": parameters,
    }
    return Listed("\n".join(lines), facts)


KINDS: Final[Mapping[str, Kind]] = {
    "rigs": Kind("rig", _rigs, _rig),
    "specimens": Kind("specimen", _files_of("specimens"), _specimen),
    "instruments": Kind("instruments", _files_of("instruments"), _instruments),
    "dimensions": Kind("dimensions", _files_of("dimensions"), _dimensions),
    "wirings": Kind("wiring", _files_of("wirings"), _wiring),
    "parameters": Kind("parameters", _sets, _parameters),
    "demos": Kind("demo", _demos, _demo),
    "effects": Kind("effect", lambda: dict.fromkeys(_catalogue()), _effect),
}


#: Kinds whose items are folders.
_FOLDERS: Final = ("rigs", "demos")


def _complete_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    kind = KINDS.get(ctx.params.get("kind", ""))
    return complete_from(kind.known)(ctx, param, incomplete) if kind else []


def _kind_argument(kinds: Iterable[str]) -> Callable[..., Any]:
    def read_kind(ctx: click.Context, param: click.Parameter, text: str) -> str:
        """Return the kind for its singular or plural, such as rigs for rig. Raises click.BadParameter otherwise."""
        for kind, one in KINDS.items():
            if text in (kind, one.singular):
                return kind
        raise click.BadParameter(f"there is no kind {text!r}; {did_you_mean(text, kinds)}", ctx, param)

    return click.argument("kind", callback=read_kind, shell_complete=complete_from(lambda: kinds))


@click.command("list")
@_kind_argument(KINDS)
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=_complete_names)
@JSON_OPTION
def list_command(kind: str, names: tuple[str, ...], as_json: bool) -> None:
    """List rigs, specimens, effects and other named data.

    Without a NAME it lists all of a KIND. The kinds are:

    \b
    rigs         rigs, for --rig: those of ASTB and those in the folder rigs/
    specimens    specimens with their limits, for --specimen
    instruments  instruments of rigs with their uncertainties
    dimensions   dimensions of rigs
    wirings      wirings of rigs
    parameters   parameter sets, for --model
    demos        measured data with a map each, for astb diagnose
    effects      model errors, for --effect; astb diagnose finds them
    """
    described = {name: KINDS[kind].describe(name) for name in names or KINDS[kind].known()}
    if as_json:
        print_json([{"name": name, **one.facts} for name, one in described.items()])
        return
    for name, one in described.items():
        click.echo(f"{name}  {one.line}")


@click.command("copy")
@_kind_argument([one.singular for kind, one in KINDS.items() if kind != "effects"])
@click.argument("name", shell_complete=_complete_names)
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--preload",
    "preloads",
    multiple=True,
    metavar="CASE=VALUE",
    help='Change the preload of a load case of a specimen, such as AW0="45 kN"; repeatable.',
)
@click.option(
    "--set",
    "drawing",
    multiple=True,
    metavar="NAME=VALUE",
    help='Change a property of the drawing of a specimen, such as bellows_volume="26 litre"; repeatable.',
)
@click.option(
    "--plan",
    "plans",
    multiple=True,
    metavar="PLAN",
    help="Run this plan, too, to derive the limits that it measures; repeatable.",
)
def copy_command(
    kind: str,
    name: str,
    target: Path,
    preloads: tuple[str, ...],
    drawing: tuple[str, ...],
    plans: tuple[str, ...],
) -> None:
    """Copy a rig, specimen or other named data, to edit it.

    KIND is one of astb list: rig, specimen, instruments, dimensions, wiring, parameters or demo. TARGET is a new file
    or, for a rig or a demo, a new folder. Use the copy by its path:

    \b
        astb copy rig local my_rig
        astb run aw0 --rig my_rig

    With --preload or --set, the limits of a specimen are derived again: plans run on the simulated rig with the changed
    springs. Limits that no plan measures are left out and printed.
    """
    if kind == "effects":
        misuse("effects are not files and cannot be copied; use them with --effect NAME=VALUE")
    if target.exists():
        misuse(f"{target} exists already; choose another name or remove it")
    folder, right = kind in _FOLDERS, target.with_suffix("" if kind in _FOLDERS else ".toml")
    if folder is (target.suffix == ".toml"):
        misuse(f"{kind} are {'folders' if folder else 'TOML files'}; use {right} instead of {target}")
    if (preloads or drawing or plans) and (kind != "specimens" or not (preloads or drawing)):
        misuse("--preload and --set are only for a specimen, and --plan needs --preload or --set")
    try:
        if preloads or drawing:
            from astb.specimen_new import new_specimen

            new_specimen(target, name, preloads, drawing, plans, lambda line: click.echo(line, err=True))
        elif not (source := KINDS[kind].known().get(name)):
            misuse(f"there is no {KINDS[kind].singular} {name!r}; {did_you_mean(name, KINDS[kind].known())}")
        else:
            source = source_of(source)
            copytree(source, target) if source.is_dir() else copyfile(source, target)
    except ValueError as error:
        misuse(error)
    except OSError as error:
        misuse(f"{error.filename or target} cannot be written: {reason(error)}")
    click.echo(target)
