"""The commands of `astb`: our own, and those of other packages, by their entry points of the group `astb.commands`.

Here, and only here, imports are put off: a command's module is imported when the command is called or its own help is
asked for. What `astb --help` says of the commands of this distribution is generated, and imports none of them.
"""

import sys
from collections.abc import Mapping
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP: Final = "astb.commands"
#: Name and first paragraph of the help, a line for each command of this distribution: `make generate` writes them.
SUMMARIES: Final = Path(__file__).parent / "commands" / "summaries.txt"


class PluginError(click.ClickException):
    """A command of another package cannot be used; the text names package, entry point and reason."""


class UnusableCommand(click.Command):
    """Stands for a command that could not be loaded: not listed among the others; running it raises the error."""

    def __init__(self, name: str, error: PluginError) -> None:
        super().__init__(name, hidden=True)
        self.error = error

    def make_context(self, *_: Any, **__: Any) -> NoReturn:
        raise self.error


class CommandLine(click.Group):
    """Our commands, each in its module of ``homes`` as ``NAME_command``, and after them those of installed packages."""

    def __init__(self, *args: Any, homes: Mapping[str, str], **others: Any) -> None:
        super().__init__(*args, **others)
        self.homes: Final = homes

    @cached_property
    def _offered(self) -> "dict[str, list[EntryPoint]]":
        # It takes as long to import as click itself, and is asked only for what is not ours.
        from importlib.metadata import entry_points

        offered: dict[str, list[EntryPoint]] = {}
        for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
            offered.setdefault(point.name, []).append(point)
        return offered

    @cached_property
    def _summaries(self) -> dict[str, str]:
        """What is known of the commands of this distribution without importing them."""
        lines = SUMMARIES.read_text(encoding="utf-8").splitlines()
        return dict(line.split(": ", 1) for line in lines)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of our commands in their order, then the others' in that of the alphabet."""
        offered = self._offered if _others_may_offer() else self._summaries
        return [*self.homes, *sorted(offered.keys() - self.homes.keys())]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, or None where nobody has one of this name; ours go before those of others."""
        if cmd_name in self.homes:
            return getattr(import_module(self.homes[cmd_name]), f"{cmd_name}_command")
        if cmd_name not in self._offered:
            return None
        try:
            return _load(self._offered[cmd_name])
        except PluginError as error:
            return UnusableCommand(cmd_name, error)

    def _listed(self, ctx: click.Context) -> dict[str, click.Command]:
        """Return what stands in a list of the commands: of those of this distribution, their summaries alone."""
        listed = {}
        for name in self.list_commands(ctx):
            ours = name in self.homes or not _others_may_offer() or _is_ours(self._offered[name])
            summary = self._summaries.get(name) if ours else None
            command = click.Command(name, help=summary) if summary else self.get_command(ctx, name)
            if command is not None:
                listed[name] = command
        return listed

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the commands that begin so, each with its summary, and options."""
        items = [
            CompletionItem(name, help=command.get_short_help_str())
            for name, command in self._listed(ctx).items()
            if name.startswith(incomplete) and not command.hidden
        ]
        return items + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, then which packages offer something that cannot be used, and why."""
        listed = self._listed(ctx)
        shown = {name: command for name, command in listed.items() if not command.hidden}
        width = formatter.width - 6 - max(map(len, shown))
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(width)) for name, command in shown.items()])
        complaints = [
            (name, command.error.message)
            for name, command in listed.items()
            if isinstance(command, UnusableCommand)
        ]
        if _others_may_offer():
            complaints += [
                (point.name, f"{_described(point)}: `astb` has a command of this name")
                for name in self._offered.keys() & self.homes.keys()
                for point in self._offered[name]
            ]
        if complaints:
            with formatter.section("Commands that cannot be used"):
                formatter.write_dl(sorted(complaints))


@cache
def _others_may_offer() -> bool:
    """Whether there may be a package beside this distribution that offers commands, by a look at the files of metadata.

    Without `importlib.metadata`, for whose import alone `astb --help` would take twice as long.
    """
    for place in map(Path, sys.path):
        if place.is_file() or place.suffix == ".egg":
            return True  # packed: let the library look
        for points in place.glob("*-info/entry_points.txt"):
            ours = points.parent.name.startswith(("astb-", "astb.egg-info"))
            if not ours and f"[{GROUP}]".encode() in points.read_bytes():
                return True
    return False


def _is_ours(offers: "list[EntryPoint]") -> bool:
    """Whether this distribution, and nobody else, offers a command."""
    return all(offer.dist is not None and offer.dist.name == "astb" for offer in offers)


def _load(offers: "list[EntryPoint]") -> click.Command:
    """Import the one package that offers a command; PluginError if it fails, or if there are several."""
    offer, *others = offers
    if others:
        raise PluginError(
            f"{' and '.join(map(_described, offers))} have the same name: uninstall all but one"
        )
    try:
        command = offer.load()
    except (Exception, SystemExit) as error:  # whatever somebody's module does when it is imported
        raise PluginError(
            f"{_described(offer)} cannot be loaded ({type(error).__name__}: {error}): mend or uninstall that package"
        ) from error
    if not isinstance(command, click.Command):
        raise PluginError(
            f"{_described(offer)} is of type {type(command).__name__}: its entry point has to name a click.Command"
        )
    return command


def _described(point: "EntryPoint") -> str:
    package = (
        f"package {point.dist.name} {point.dist.version}" if point.dist else "a package without metadata"
    )
    return f"{point.value} of {package}"
