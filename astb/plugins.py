"""The commands of `astb`: its own, and those of other packages, by their entry points of the group `astb.commands`.

Only here imports are delayed: the module of a command is imported when the command is called or its own help is
requested. The summaries in `astb --help` are generated, so that it imports none of these modules.
"""

import re
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from shlex import join
from typing import Any, Final

import click
from click.shell_completion import CompletionItem

_KINDS: Final = "(rigs|specimens|instruments|dimensions|wirings|parameters|demos)"
#: Old beginnings of a command line and the new ones. Words are separated by `_GAP`, which no word contains.
RENAMED: Final = (
    # A rig was one file and is a folder.
    (r"rigs ([^ ]+) --copy[ =]([^ ]+)\.toml", r"copy rig \1 \2"),
    (r"rigs --copy[ =]([^ ]+)\.toml ([^ ]+)", r"copy rig \2 \1"),
    (rf"{_KINDS} ([^ ]+) --copy[ =]([^ ]+)", r"copy \1 \2 \3"),
    (rf"{_KINDS} --copy[ =]([^ ]+) ([^ ]+)", r"copy \1 \3 \2"),
    (r"specimens new (.*?)--base[ =]([^ ]+)", r"copy specimen \2 \1"),
    (r"specimens new", r"copy specimen astb"),
    (rf"{_KINDS}|effects", r"list \g<0>"),
    (r"check-rig", r"rig check"),
    (r"wiring", r"rig"),
    (r"conform|limits|signals|fault", r"rig \g<0>"),
)
_GAP: Final = "\0"


def renamed(words: Sequence[str]) -> list[str]:
    """Return a command line with the new name of its command; empty if the name is not an old one."""
    line = _GAP.join(words)
    for old, new in RENAMED:
        if match := re.match(f"(?:{old.replace(' ', _GAP)})(?={_GAP}|$)", line):
            return [
                word
                for word in (match.expand(new.replace(" ", _GAP)) + line[match.end() :]).split(_GAP)
                if word
            ]
    return []


GROUP: Final = "astb.commands"
#: Path and first line of the help of each command: `make generate` writes them.
SUMMARIES: Final = Path(__file__).parent / "commands" / "summaries.txt"


class PluginError(click.ClickException):
    """A command of another package cannot be used; the text names package, entry point and reason."""


@cache
def own_summaries() -> dict[str, str]:
    """Return the summary of each command by its path, such as ``astb rig check``."""
    return read_summaries(SUMMARIES.read_text(encoding="utf-8"))


def read_summaries(text: str) -> dict[str, str]:
    """Return the lines of a file such as `SUMMARIES` by path."""
    return dict(line.split(": ", 1) for line in text.splitlines())


class CommandGroup(click.Group):
    """Commands below headings, each in its module as ``NAME_command``.

    ``headings`` has the module of each command by heading and name. ``path`` is the command line of the group itself.
    Without the name of a command, ``default`` is called.
    """

    def __init__(
        self,
        *args: Any,
        headings: Mapping[str, Mapping[str, str]],
        path: str,
        default: str = "",
        **others: Any,
    ) -> None:
        super().__init__(*args, **others)
        self.headings: Final = headings
        self.homes: Final = {name: home for homes in headings.values() for name, home in homes.items()}
        self.path: Final = path
        self.default: Final = default

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in their order."""
        return list(self.homes)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, or None if there is none of this name."""
        if cmd_name not in self.homes:
            return None
        command: click.Command = getattr(import_module(self.homes[cmd_name]), f"{cmd_name}_command")
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Insert the default command if the arguments begin with an option, or if there are none."""
        option = bool(args) and args[0].startswith("-") and args[0] not in ctx.help_option_names
        if self.default and (option or not (args or ctx.resilient_parsing)):
            args = [self.default, *args]
        return super().parse_args(ctx, args)

    def summaries(self) -> dict[str, str]:
        """Return the summaries of the commands by name."""
        return {name: own_summaries()[f"{self.path} {name}"] for name in self.homes}

    def sections(self) -> dict[str, dict[str, str]]:
        """Return name and summary of each command by heading."""
        summaries = self.summaries()
        return {
            heading: {name: summaries[name] for name in homes} for heading, homes in self.headings.items()
        }

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the commands with this beginning, each with its summary, and options, also those of the default."""
        items = [
            CompletionItem(name, help=summary)
            for name, summary in self.summaries().items()
            if name.startswith(incomplete)
        ]
        default = self.get_command(ctx, self.default) if self.default else None
        return items + click.Command.shell_complete(default or self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands below their headings, all summaries in one column."""
        sections = self.sections()
        width = max(len(name) for rows in sections.values() for name in rows)
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), text) for name, text in rows.items()])


class CommandLine(CommandGroup):
    """The commands of `astb`, and after them those of installed packages; old names are replaced."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the own commands in their order, then the others in alphabetical order."""
        return [*self.homes, *sorted(offers().keys() - self.homes.keys())]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, or None if no package has one of this name; own commands have priority."""
        command = super().get_command(ctx, cmd_name)
        return command or (_load(cmd_name, offers()[cmd_name]) if cmd_name in offers() else None)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; an old name is replaced, and the new one is printed."""
        if new := renamed(args):
            args = new
            if not ctx.resilient_parsing:
                click.echo(f"astb: use `astb {join(args)}`; the next release removes the old form", err=True)
        return super().resolve_command(ctx, args)

    def summaries(self) -> dict[str, str]:
        """Return the summaries of the own commands, and the packages of the others."""
        return super().summaries() | {
            name: " and ".join(packages) for name, packages in offers().items() if name not in self.homes
        }

    def sections(self) -> dict[str, dict[str, str]]:
        """Return name and summary of each command by heading, those of other packages last."""
        others = {
            name: " and ".join(packages)
            + (": cannot be used, `astb` has a command of this name" if name in self.homes else "")
            for name, packages in sorted(offers().items())
        }
        return super().sections() | ({"Other packages": others} if others else {})


@cache
def offers() -> dict[str, dict[str, str]]:
    """Return the entry points of other packages: the module by command name and package.

    They are read without `importlib.metadata`, because its import alone would double the time of `astb --help`.
    """
    found: dict[str, dict[str, str]] = {}
    for place in dict.fromkeys(sys.path):
        for points in sorted(Path(place).glob("*-info/entry_points.txt")):
            package = " ".join(points.parent.stem.split("-")[:2])
            _, _, group = points.read_text(encoding="utf-8").partition(f"[{GROUP}]\n")
            for line in group.partition("\n[")[0].splitlines():
                name, equals, home = map(str.strip, line.partition("="))
                if equals and not name.startswith("#"):
                    found.setdefault(name, {}).setdefault(package, home)
    return found


def _load(name: str, homes: Mapping[str, str]) -> click.Command:
    """Import the command of the one package that offers it. Raises PluginError if it fails, or if there are several."""
    from importlib.metadata import EntryPoint

    described = " and ".join(f"{home} of package {package}" for package, home in homes.items())
    if len(homes) > 1:
        raise PluginError(f"{described} have the same command name {name}; uninstall all but one")
    (home,) = homes.values()
    try:
        command = EntryPoint(name, home, GROUP).load()
    except (Exception, SystemExit) as error:  # the import runs code of that package, which can raise anything
        raise PluginError(
            f"{described} cannot be loaded ({type(error).__name__}: {error}): repair or uninstall that package"
        ) from error
    if not isinstance(command, click.Command):
        raise PluginError(
            f"{described} is of type {type(command).__name__}: its entry point must name a click.Command"
        )
    return command
