"""Whatever text comes from outside is shown as it stands: no name is taken for markup, an emoji or a colour."""

import ast
import io
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acceptance.checking.report import CheckReport, Missing
from acceptance.commands import check_rig
from astb.display import ProgressDisplay
from astb.tables import open_console, open_table, styled

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


@pytest.mark.parametrize("name", HOSTILE)
def test_a_rig_may_be_called_anything(name, monkeypatch):
    report = CheckReport(rig=name, state=name, identity=name, **_rest(name))
    heard = io.StringIO()
    with redirect_stdout(heard):
        check_rig._show(report)
    assert f"{name}, {name}; identity: {name}" in heard.getvalue()


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


def test_a_run_says_what_it_is_told(capsys):
    from rich.console import Console

    console = Console(file=io.StringIO(), force_terminal=True, width=200)
    with ProgressDisplay(console) as display:
        display.begin("hall [/b]")
        for text in HOSTILE:
            display.warn(text)
    told = console.file.getvalue()
    assert all(text in told for text in HOSTILE)


def test_consoles_are_made_in_one_place():
    """Elsewhere, rich would take what stands in square brackets for its own."""
    found = []
    for folder in (
        "acceptance",
        "astb",
        "bench_fmu",
        "bench_panel",
        "bench_twin",
        "campaigns",
        "paper_study",
        "diagnosis",
        "bench_records",
        "test_plans",
    ):
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
