"""Options that several commands have, and functions that apply them to a rig."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec.structs import replace

from astb.commands.completion import complete_effects, complete_rigs
from astb.exit_codes import misuse
from astb.rig_file import ORDINARY, RigFileError, find_rig

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from test_plans.specimen import Specimen

SEED: Final = click.IntRange(0, 2**32 - 1)

RIG_OPTION: Final = click.option(
    "--rig",
    "rig_named",
    metavar="RIG",
    shell_complete=complete_rigs,
    help="Folder or file of a rig, or a name of `astb list rigs`.  [default: local]",
)
JSON_OPTION: Final = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
SEED_OPTION: Final = click.option(
    "--seed",
    type=SEED,
    help="Random seed of the simulated sensors and their noise.  [default: from the rig file]",
)


def out_option(text: str, name: str = "out") -> Callable[..., Any]:
    """Return the option for the folder of runs; ``text`` is its help text, and ``name`` the name of its argument."""
    return click.option(
        "--out", name, type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help=text
    )


_SIMULATION_OPTIONS: Final = (
    click.option(
        "--model",
        help="Model of the simulated rig: a parameter set, or the path of a parameter or model file.  "
        "[default: from the rig file]",
    ),
    click.option(
        "--effect",
        "effects",
        multiple=True,
        metavar="NAME=VALUE",
        shell_complete=complete_effects,
        help="Add an effect to the simulated rig, such as leak.left=0.2mm2; repeatable. `astb list effects` lists all.",
    ),
    click.option(
        "--sealed",
        metavar="FILE",
        help="File with effects for a blind test. Records and output only show that there are such effects.",
    ),
)


def simulation_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options for a simulated rig to a command: model, effects and sealed effects. `simulated` applies them."""
    for option in reversed(_SIMULATION_OPTIONS):
        command = option(command)
    return command


def effect_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options for effects of a simulated rig to a command. `simulated` applies them."""
    for option in reversed(_SIMULATION_OPTIONS[1:]):
        command = option(command)
    return command


def read_specimen(name: str | None) -> "Specimen":
    """Return the specimen of a file or of a name, by default the bench's own one.

    An invalid specimen ends the command.
    """
    from test_plans.loads import SpecimenError
    from test_plans.specimen import ORDINARY, read_specimen

    try:
        return read_specimen(name or ORDINARY)
    except SpecimenError as error:
        misuse(error)


def read_rig(named: str | None) -> "tuple[RigFile, Path]":
    """Return the rig of a file or of a name, by default the rig local, and the path of its file.

    An invalid rig ends the command.
    """
    try:
        return find_rig(named or ORDINARY)
    except RigFileError as error:
        misuse(error)


def simulated(
    rig: "RigFile", path: Path, model: str | None, effects: Sequence[str], sealed: str | None
) -> "RigFile":
    """Return ``rig`` with the options of `simulation_options`, which override the rig file.

    With a real rig, they end the command.
    """
    if not (model or effects or sealed):
        return rig
    if rig.simulation is None:
        misuse(
            f"rig file {path} describes a real rig (no [simulation] table): --model, --effect and "
            "--sealed need a simulated rig"
        )
    given = pairs(effects, "has no value; write NAME=VALUE, such as leak.left=0.2mm2", option="--effect ")
    return replace(
        rig,
        simulation=replace(
            rig.simulation,
            parameters=model or rig.simulation.parameters,
            effects=rig.simulation.effects | given,
            sealed=sealed or rig.simulation.sealed,
        ),
    )


def pairs(texts: Iterable[str], wrong: str, *, option: str = "") -> dict[str, str]:
    """Return the values of texts NAME=VALUE, by name.

    A text without "=" ends the command with the message ``wrong``. A repeated name also ends the command.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            misuse(f"{option}{text} {wrong}")
        if name in found:
            misuse(f"{option}{name} is given twice; give it once")
        found[name] = value
    return found
