"""The tree of commands: its size, its summaries, its old names and its completion."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from astb.cli import HEADINGS, commands
from astb.plugins import CommandGroup, own_summaries, renamed

#: Command lines of the last release, and the ones that replace them.
OLD = {
    "rigs": "list rigs",
    "specimens astb --json": "list specimens astb --json",
    "effects": "list effects",
    "rigs local --copy my.toml": "copy rig local my",
    "rigs --copy=my.toml local": "copy rig local my",
    "rigs local --copy my": "copy rigs local my",
    "demos --copy=my chamber": "copy demos chamber my",
    "specimens new my.toml --preload 'AW0=45 kN'": "copy specimen astb my.toml --preload 'AW0=45 kN'",
    "specimens new my.toml --base other --set a=1": "copy specimen other my.toml --set a=1",
    "check-rig hall --json": "rig check hall --json",
    "conform hall": "rig conform hall",
    "wiring new --dbc hall.dbc": "rig new --dbc hall.dbc",
    "limits": "rig limits",
    "signals --dbc my.dbc": "rig signals --dbc my.dbc",
    "fault on leak side=left": "rig fault on leak side=left",
}


def tree(group: click.Group, path: str) -> Iterator[tuple[str, click.Command]]:
    """Yield each own command below ``group`` with its path."""
    names = group.homes if isinstance(group, CommandGroup) else group.commands
    for name in names:
        command = group.get_command(click.Context(group), name)
        assert command is not None
        yield f"{path} {name}", command
        if isinstance(command, click.Group):
            yield from tree(command, f"{path} {name}")


TREE = dict(tree(commands, "astb"))


def completed(line: str) -> list[str]:
    """Return what bash offers for the last word of a command line."""
    words = line.split(" ")
    environment = {"_ASTB_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", "from astb.cli import commands; commands(prog_name='astb')"],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == "", done.stderr
    return [offer.partition(",")[2] for offer in done.stdout.splitlines()]


def test_there_are_at_most_22_commands() -> None:
    assert sum(map(len, HEADINGS.values())) <= 22
    assert not {old.split()[0] for old in OLD} & set(
        CommandGroup.list_commands(commands, click.Context(commands))
    )


@pytest.mark.parametrize(
    "path", ["", *(path[5:] for path, one in TREE.items() if isinstance(one, click.Group))]
)
def test_each_summary_is_one_whole_line_at_80_columns(path: str) -> None:
    words = path.split()
    said = CliRunner(env={"COLUMNS": "80"}).invoke(commands, [*words, "--help"]).output
    for below in (one for one in TREE if one.split()[1:-1] == words):
        summary = own_summaries()[below]
        assert re.fullmatch(r"[A-Z][a-z]+ .*\.", summary), below
        assert re.search(rf"^  {below.split()[-1]} +{re.escape(summary)}$", said, re.MULTILINE), below


@pytest.mark.parametrize("path", TREE)
def test_each_option_and_command_has_a_help_text(path: str) -> None:
    command = TREE[path]
    assert command.help
    assert not [
        one.name for one in command.params if isinstance(one, click.Option) and not (one.help or one.hidden)
    ]


@pytest.mark.parametrize(("old", "new"), OLD.items())
def test_an_old_name_is_replaced(old: str, new: str) -> None:
    assert renamed(shlex.split(old)) == shlex.split(new)
    assert CliRunner().invoke(commands, [*shlex.split(new), "--help"]).exit_code == 0


def test_an_old_name_works_and_the_new_one_is_printed() -> None:
    old, new = (CliRunner().invoke(commands, words.split()) for words in ("rigs --json", "list rigs --json"))
    assert old.exit_code == new.exit_code == 0
    assert old.stdout == new.stdout and new.stderr == ""
    assert len(old.stderr.splitlines()) == 1 and "`astb list rigs --json`" in old.stderr


def test_a_rig_runs_without_the_name_of_a_command() -> None:
    with_name, without = (
        CliRunner().invoke(commands, [*words, "--can-port", "x"]).output
        for words in (["rig", "run"], ["rig"])
    )
    assert "'--can-port': 'x'" in with_name
    assert with_name == without


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("astb re", ["rehearse", "report"]),
        ("astb rig ", ["run", "check", "conform", "new", "limits", "signals", "fault"]),
        ("astb rig fault o", ["off", "on"]),
        ("astb rig --can-", ["--can-port"]),
        ("astb rig --rig vir", ["virtual"]),
        ("astb list dem", ["demos"]),
        ("astb list demos ch", ["chamber"]),
        ("astb copy demo ch", ["chamber"]),
        ("astb check-rig --allow", ["--allow-motion"]),
        ("astb run aw", ["aw0", "aw3"]),
    ],
)
def test_the_shell_completes(line: str, offered: list[str]) -> None:
    assert [one for one in completed(line) if one not in line.split(" ")[-1:]] == offered
