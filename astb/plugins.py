"""Commands that other packages add to `astb`: their entry points of the group `astb.commands`.

Metadata is read only where a command is not one of ours. A module is imported only for its own command, or for the one
line that `astb --help` shows of it.
"""

from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP: Final = "astb.commands"


class PluginError(click.ClickException):
    """A command of another package cannot be used; the text names package, entry point and reason."""


class UnusableCommand(click.Command):
    """Stands for a command that could not be loaded: not listed among the others; running it raises the error."""

    def __init__(self, name: str, error: PluginError) -> None:
        super().__init__(name, hidden=True)
        self.error = error

    def make_context(self, *_: Any, **__: Any) -> NoReturn:
        raise self.error


class ExtensibleGroup(click.Group):
    """A group with the commands that it is given and, after them, those that installed packages offer."""

    @cached_property
    def _offered(self) -> "dict[str, list[EntryPoint]]":
        from importlib.metadata import entry_points

        offered: dict[str, list[EntryPoint]] = {}
        for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
            offered.setdefault(point.name, []).append(point)
        return offered

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of our commands in their order, then the others' in that of the alphabet."""
        return [*self.commands, *sorted(self._offered.keys() - self.commands.keys())]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, or None where nobody has one of this name; ours go before those of others."""
        if cmd_name in self.commands or cmd_name not in self._offered:
            return self.commands.get(cmd_name)
        try:
            return _load(self._offered[cmd_name])
        except PluginError as error:
            return UnusableCommand(cmd_name, error)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, then which packages offer something that cannot be used, and why."""
        super().format_commands(ctx, formatter)
        complaints = [
            (point.name, f"{_described(point)}: `astb` has a command of this name")
            for name in self._offered.keys() & self.commands.keys()
            for point in self._offered[name]
        ]
        for name in self._offered.keys() - self.commands.keys():
            command = self.get_command(ctx, name)
            if isinstance(command, UnusableCommand):
                complaints.append((name, command.error.message))
        if complaints:
            with formatter.section("Commands that cannot be used"):
                formatter.write_dl(sorted(complaints))


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
