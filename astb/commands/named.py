"""`astb rigs`, `specimens`, `instruments`, `wirings`, `parameters` and `demos`: files that come with the bench."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shutil import copytree
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

from astb.commands.completion import complete_from
from astb.commands.options import JSON_OPTION, read_rig, read_specimen
from astb.exit_codes import misuse
from astb.rig_file import rigs
from astb.tables import print_json
from bench_protocol.dimensions import NAMES, DimensionsError, read_dimensions
from bench_protocol.named_files import named_files, named_folders, place_of
from bench_protocol.units import kN
from drivers.errors import WiringError

if TYPE_CHECKING:
    from test_plans.instruments import Instruments


_COPY_OPTION: Final = click.option(
    "--copy",
    "target",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write a copy of NAME, to begin one of your own with.",
)


class Listed(NamedTuple):
    """What is told of one file: to people, and to programs."""

    line: str
    facts: Mapping[str, Any]


def _listing(
    command: str,
    known: Callable[[], Mapping[str, Path]],
    tell: Callable[[str], Listed],
    text: str,
    new: Callable[..., None] | None = None,
    options: Sequence[Callable[[Any], Any]] = (),
) -> click.Command:
    """Return the command that lists the ``known`` files of a kind, as ``tell`` has them, and copies one.

    ``new`` makes one, with ``options``, where the first name is "new".
    """

    def body(names: tuple[str, ...], target: Path | None, as_json: bool, **rest: Any) -> None:
        if new is not None and names[:1] == ("new",):
            new(names[1:], **rest)
            return
        if any(rest.values()):
            misuse(
                f"--base, --preload, --set and --plan go with a file, as in astb {command} new mine.toml …"
            )
        if target is not None:
            _copy(command, known(), names, target)
            return
        listed = {name: tell(name) for name in names or known()}
        if as_json:
            print_json([{"name": name, **one.facts} for name, one in listed.items()])
            return
        for name, one in listed.items():
            click.echo(f"{name}  {one.line}")

    body = JSON_OPTION(_COPY_OPTION(body))
    for option in reversed(options):
        body = option(body)
    names = click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=complete_from(known))
    return click.command(command, help=text)(names(body))


def _copy(command: str, known: Mapping[str, Path], names: tuple[str, ...], target: Path) -> None:
    if len(names) != 1 or names[0] not in known:
        misuse(
            f"--copy takes one NAME: {', '.join(known)}, as in astb {command} {next(iter(known))} --copy {target}"
        )
    if target.exists():
        misuse(f"{target} is there already, and somebody may have worked on it")
    source = known[names[0]]
    if source.is_file() and target.suffix != ".toml":
        misuse(f"{target} would be taken for a name: a file that ends in .toml would do")
    try:
        if source.is_dir():
            copytree(source, target)
        else:
            target.write_bytes(source.read_bytes())
    except OSError as error:
        misuse(f"{target} cannot be written: {error.strerror}")
    click.echo(target)


def _rigs() -> Mapping[str, Path]:
    return rigs()


def _rig(name: str) -> Listed:
    rig, path = read_rig(name)
    kind = "simulated" if rig.simulation else "described by a wiring" if rig.wiring else "real"
    return Listed(
        f"{kind}, {rig.time} time: {rig.description}",
        {
            "description": rig.description,
            "simulated": rig.simulation is not None,
            "time": rig.time,
            "file": str(path),
        },
    )


def _named(package: str) -> Callable[[], Mapping[str, Path]]:
    def known() -> Mapping[str, Path]:
        return named_files(package)

    return known


def _specimen(name: str) -> Listed:
    one = read_specimen(name)
    loads = {load.name: load.preload for load in one.loads.values()}
    carried = ", ".join(f"{load} {preload / kN:g} kN" for load, preload in loads.items())
    return Listed(
        f"{one.type}, no. {one.serial_number}, drawing: {one.drawing}; {carried}",
        {**one.facts, "preload_N": loads},
    )


def _new_specimen(
    names: tuple[str, ...],
    base: str | None,
    preload: tuple[str, ...],
    values: tuple[str, ...],
    measured_by: tuple[str, ...],
) -> None:
    from astb.specimen_new import new_specimen

    if len(names) != 1 or not names[0].endswith(".toml") or not (preload or values):
        misuse(
            "one FILE.toml and what is different are needed, as in "
            'astb specimens new mine.toml --preload AW0="45 kN"'
        )
    target = Path(names[0])
    if target.exists():
        misuse(f"{target} is there already, and somebody may have worked on it")
    try:
        new_specimen(target, base, preload, values, measured_by, lambda line: click.echo(line, err=True))
    except (ValueError, OSError) as error:
        misuse(error)
    click.echo(target)


def _instruments(name: str) -> Listed:
    one = _read_instruments(name)
    types = sorted({piece.instrument.type for piece in one.pieces.values()})
    return Listed(f"{len(one.pieces)} readings: {'; '.join(types)}", {**one.facts})


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
    from bench_sim.parameters import SETS

    return {name: named_files("bench_sim.parameters")[name] for name in SETS}


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
    folder = (
        _demos()[name]
        if name in _demos()
        else misuse(f"there is no demo {name!r}; there is {', '.join(_demos())}")
    )
    (mapped,) = folder.glob("*.toml")
    title = mapped.read_text(encoding="utf-8").partition(":")[0].lstrip("# ")
    files = sorted(path.name for path in folder.iterdir() if path != mapped)
    return Listed(f"{title}; {len(files)} files", {"title": title, "map": mapped.name, "files": files})


rigs_command = _listing(
    "rigs",
    _rigs,
    _rig,
    """List the rigs that have a name, for --rig: those that come with the bench, and the files in rigs/.

    Without NAMEs all of them. A rig of your own is a file: astb rigs local --copy mine.toml, then --rig mine.toml.
    """,
)
specimens_command = _listing(
    "specimens",
    _named("specimens"),
    _specimen,
    """List the specimens that come with the bench, or what the file of each NAME says.

    `astb specimens new FILE --preload AW0="45 kN"` writes a specimen with other loads or another drawing, with limits
    derived from the model of the spring. Limits that no plan measures are left out and printed.
    """,
    _new_specimen,
    [
        click.option("--base", metavar="NAME", help="With new: the specimen to begin with.  [default: astb]"),
        click.option(
            "--preload", multiple=True, metavar="CASE=VALUE", help='With new: of a load case, as AW0="45 kN".'
        ),
        click.option(
            "--set",
            "values",
            multiple=True,
            metavar="NAME=VALUE",
            help="With new: a property of the drawing.",
        ),
        click.option(
            "--plan",
            "measured_by",
            multiple=True,
            metavar="PLAN",
            help="With new: run this plan beside aw0 and aw3.",
        ),
    ],
)
instruments_command = _listing(
    "instruments",
    _named("instruments"),
    _instruments,
    """List the instruments that come with the bench, or those of each NAME, for a rig file.""",
)
dimensions_command = _listing(
    "dimensions",
    _named("dimensions"),
    _dimensions,
    """List the files of dimensions that come with the bench, or what each NAME states, for a rig file.""",
)
wirings_command = _listing(
    "wirings",
    _named("wirings"),
    _wiring,
    """List the wirings that come with the bench, or each NAME: examples, as every rig needs one of its own.

    `astb wiring new` makes a first one from a DBC and a list of registers.
    """,
)
parameters_command = _listing(
    "parameters",
    _sets,
    _parameters,
    """List the parameter sets that come with the bench, for --model, or what each NAME is.""",
)
demos_command = _listing(
    "demos",
    _demos,
    _demo,
    """List the measured data that come with the bench, each a folder with its map, to try a diagnosis on.

    astb demos chamber --copy chamber, then astb diagnose chamber/*.csv --map chamber/chamber.toml --out found.
    """,
)
