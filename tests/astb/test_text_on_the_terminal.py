"""Text from outside is printed as it is: no name is markup, an emoji, a colour, or a command to the terminal."""

import ast
import io
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import click
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.progress import Progress

from astb.acceptance.checking.report import CheckReport, Missing
from astb.acceptance.commands import check_rig
from astb.cli import main
from astb.display import ProgressDisplay
from astb.tables import open_console, open_table, plain_console, print_json, styled
from astb.terminal import print_safely

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = [
    "hall [/b]",
    "[bold]x[/bold]",
    "[/]",
    "a[0]",
    "\\[b]",
    "[link=x]y",
    ":smile:",
    "[red",
    "[@click=x]y[/]",
]
TEXT = st.one_of(
    st.sampled_from(HOSTILE),
    st.text(st.sampled_from("[]/\\:=@ab1é "), min_size=1, max_size=12).map(lambda text: f"<{text}>"),
)


@settings(deadline=None)  # the first example imports what draws tables
@given(TEXT, TEXT)
def test_text_comes_out_as_it_went_in(one, two):
    console = open_console()
    console.file = io.StringIO()
    table = open_table(f"t {one} t", f"<{two}>", f"n {one} n", whole=("",))
    table.add_row(one, styled(two, "bold red"))
    console.print(table)
    console.print(f"said: {one}")
    console.print(styled(one, "bold") + f", {two}")
    told = console.file.getvalue()
    assert f"t {one} t" in told and f"<{two}>" in told and f"n {one} n" in told
    assert f"said: {one}\n" in told
    assert f"{one}, {two}\n" in told


UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@settings(deadline=None)
@given(st.text(st.characters(max_codepoint=0x2070, exclude_characters="\r\n\t"), min_size=1))
def test_no_text_reaches_the_terminal_with_control_characters(text):
    received = io.StringIO()
    with redirect_stdout(received), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stderr", sys.stdout)
        print_safely()
        click.echo(f"one {text}")
        print_json([text])
        print(text, file=sys.stderr)
        console, table = open_console(), open_table(f"t {text}", text)
        assert console.file is received
        table.add_row(text)
        table.add_row(styled(text, "bold red"))
        console.print(table)
        console.print(f"said: {text}")
    assert not UNSAFE.search(received.getvalue())
    assert "red" not in received.getvalue() or "red" in text


def test_the_colours_of_a_console_stay(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    received = io.StringIO()
    with redirect_stdout(received):
        print_safely()
        console = plain_console()
        with Progress(console=console) as progress:
            progress.add_task("\x1b[2J")
            console.print(styled("\x1b]0;title\x07", "bold"))
            print("\x1b[3J")
    told = received.getvalue()
    assert "\x1b[1m" in told
    assert not any(one in told for one in ("\x1b[2J", "\x1b]0", "\x07", "\x1b[3J"))


PLAN = """
from bench_protocol.units import s
from test_plans.check_names import CheckName
from test_plans.plan import plan

CHECK = CheckName("check {evil}", "About {evil} all.")


@plan(lasts=1 * s, checks=[CHECK])
def hostile(run):
    \"\"\"Title {evil} ends.

    More {evil}.
    \"\"\"
    run.warn("warned {evil}")
    run.say("said {evil}")
    with run.phase("phase {evil}"):
        run.check(CHECK, 1.0, "1", low=0.0, high=2.0)
    raise ValueError("raised {evil}")
"""


@pytest.mark.slow
def test_names_of_plans_files_operators_and_specimens_are_printed_safely(tmp_path, monkeypatch):
    evil = "\\x1b[2J\\x1b]0;t\\x07\\x9b31m"
    raw = ast.literal_eval(f"'{evil}'")
    (tmp_path / "hostile.py").write_text(PLAN.replace("{evil}", evil))
    (tmp_path / f"broken{raw}.py").write_text("1 / 0")
    (tmp_path / f"spring{raw}.toml").write_text(f'name = "{evil}"')
    monkeypatch.chdir(tmp_path)
    for arguments in (
        ["plans"],
        ["plans", "hostile.py"],
        ["run", "hostile.py", "--virtual", "--operator", raw, "--out", "runs"],
        ["runs", "runs"],
        ["run", f"broken{raw}.py"],
        ["run", f"none{raw}.py"],
        ["run", "aw0", "--rig", f"none{raw}.toml"],
        ["run", "aw0", "--virtual", "--specimen", f"spring{raw}.toml"],
        ["run", "aw0", "--virtual", "--set", f"{raw}=1"],
    ):
        received = io.StringIO()
        with redirect_stdout(received), redirect_stderr(received), pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["astb", *arguments])
            with pytest.raises(SystemExit):
                main()
        assert received.getvalue()
        assert not UNSAFE.search(received.getvalue()), arguments


@pytest.mark.parametrize("name", HOSTILE)
def test_a_rig_may_be_called_anything(name, monkeypatch):
    report = CheckReport(rig=name, state=name, identity=name, **_rest(name))
    received = io.StringIO()
    with redirect_stdout(received):
        check_rig._show(report)
    assert f"{name}: state {name}; {name}\n" in received.getvalue()


def _rest(name):
    """Fill the other fields of a report, whatever they are, with texts as hostile as the name."""
    empty = {
        "signals": [],
        "connections": [],
        "moves": [],
        "plans": 1,
        "missing": [Missing(names=[name], plans=[name])],
        "checks": {},
        "capabilities": [name],
    }
    known = CheckReport.__struct_fields__
    return {key: value for key, value in (empty | {"remembered": [name]}).items() if key in known}


def test_a_run_shows_the_stated_data(capsys):
    from rich.console import Console

    console = Console(file=io.StringIO(), force_terminal=True, width=200)
    with ProgressDisplay(console) as display:
        display.begin("hall [/b]")
        for text in HOSTILE:
            display.warn(text)
    told = console.file.getvalue()
    assert all(text in told for text in HOSTILE)


def test_consoles_are_made_in_one_place():
    """Without this, rich would interpret text in square brackets as markup."""
    found = []
    for folder in ("astb", "bench_records", "diagnosis", "studies/astb_studies/paper", "test_plans"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.Call):
                    continue
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                markup = [one for one in node.keywords if one.arg == "markup"]
                if name == "TextColumn" and not markup and "description" in ast.unparse(node):
                    found.append(f"{path.name}: {ast.unparse(node)}")
                if name in {"Console", "from_markup"} and path.name != "tables.py":
                    found.append(f"{path.name}: {ast.unparse(node)}")
    assert not found
