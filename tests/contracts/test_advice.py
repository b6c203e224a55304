"""The advice of a message is valid: its commands, options, and libraries for pip exist."""

import ast
import re
from pathlib import Path

import click
import pytest

from astb.cli import commands
from astb.plugins import CommandGroup
from tests.contracts.test_imports import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
ENDINGS = (".py", ".j2", ".js", ".html", ".toml")
#: Not commands: the first words of the format of a record.
FORMAT = "record"


def texts():
    """Every text of the product with its file: the strings of Python, help texts included."""
    folders = [ROOT / name for name in PACKAGES.values()]
    for path in sorted(path for folder in folders for path in folder.rglob("*") if path.suffix in ENDINGS):
        if path.suffix != ".py":
            yield path, path.read_text()
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
                yield path, "".join(map(str, parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield path, node.value


def command(words):
    """Return the command that the first of ``words`` name, and those that are left; None where there is none."""
    found, rest = commands, list(words)
    while isinstance(found, click.Group) and rest and re.fullmatch("[a-z][a-z-]*", rest[0]):
        inner = found.get_command(click.Context(found), rest[0])
        if inner is None:
            return (found, rest) if found is not commands else None
        found, rest = inner, rest[1:]
    if isinstance(found, CommandGroup) and found.default:
        found = found.get_command(click.Context(found), found.default)
    return found, rest


def wrong(text):
    """Return what ``text`` names and does not exist."""
    for match in re.finditer(r"(?<![\w.-])astb ((?:[a-z][a-z-]*)(?: [^`\n]*)?)", text):
        words = match[1].split()
        words[0] = words[0].rstrip(",.;:")
        if words[0] == FORMAT:
            continue
        if (found := command(words)) is None:
            yield f"astb {words[0]}"
            continue
        if match.start() and text[match.start() - 1] == "`":
            known = {
                one for parameter in found[0].params for one in (*parameter.opts, *parameter.secondary_opts)
            }
            options = (re.split("[=,.;]", word)[0] for word in found[1] if word.startswith("--"))
            yield from (f"astb {words[0]} {option}" for option in options if option not in known)
    # The bench is in no index: `bench_protocol.extras` names libraries, which are in one.
    yield from re.findall(r"pip install ['\"]?(astb\[\w+\])", text)


@pytest.mark.slow
def test_every_command_that_a_message_names_exists():
    found = [(str(path.relative_to(ROOT)), what) for path, text in texts() for what in wrong(text)]
    assert not found
    assert sum("astb " in text for _, text in texts()) > 50  # the messages were found


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("`recover` saves it, as `astb recover` does", ["astb recover"]),
        ("`astb run --keep-it` keeps it", ["astb run --keep-it"]),
        ("`astb rig fault list` and `astb plans`", []),
        ("`astb rig --seed 3` and `astb rig --sede 3`", ["astb rig --sede"]),
        ("astb rig fault on leak side=left", []),
        ("`astb check-rig` checks it", ["astb check-rig"]),
        ("pip install 'astb[mdf]'", ["astb[mdf]"]),
        ("pip install 'asammdf>=8,<9'", []),
    ],
)
def test_missing_names_in_advice_are_found(text, told):
    assert list(wrong(text)) == told
