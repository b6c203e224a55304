"""Links, targets, headings and terms of the documentation, and the summaries of commands."""

import re
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from astb.cli import commands
from astb.plugins import SUMMARIES
from bench_protocol.table import TABLE
from bench_records import result, twin
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.quantities import QUANTITIES
from bench_sim.rig.faults.catalogue import FAULTS
from diagnosis import finding

ROOT = Path(__file__).resolve().parents[2]
OWN = sorted([*(ROOT / "docs").rglob("*.md"), *(ROOT / "studies" / "docs").rglob("*.md")])
PAGES = sorted([*ROOT.glob("*.md"), *OWN])
GLOSSARY = ROOT / "docs" / "reference" / "glossary.md"
#: Names that use a replaced word and stay, because other programs read them: signals, a key of `twin.json`.
KEPT = {"air.left_reservoir", "air.right_reservoir", "partings"}
VERBS = {
    *("Add", "Check", "Compare", "Copy", "Diagnose", "Estimate", "Export", "Find", "Import", "List", "Print"),
    *("Rehearse", "Run", "Serve", "Show", "Simulate", "Switch", "Test", "Write"),
}
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("*.md"))

FENCE = re.compile(r"^( *)```.*?^\1```", flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", flags=re.MULTILINE)


def prose(page: Path) -> str:
    """The page without its code blocks."""
    return FENCE.sub("", page.read_text())


def anchors(page: Path) -> set[str]:
    """The fragments that the page's headings offer, as GitHub makes them."""
    return {
        re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-")
        for title in HEADING.findall(prose(page))
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    for link in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, fragment = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{link}: no such file"
        assert target.is_relative_to(ROOT), f"{link}: outside the repository"
        assert not fragment or fragment in anchors(target), f"{link}: {target.name} has no such heading"


def test_every_page_can_be_reached_from_the_index() -> None:
    """Every page has a link to it."""
    index = ROOT / "docs" / "index.md"
    seen, new = set(), {index}
    while new:
        page = new.pop()
        seen.add(page)
        links = (link.partition("#")[0] for link in LINK.findall(prose(page)))
        targets = {
            (page.parent / link).resolve() for link in links if link.endswith(".md") and ":" not in link
        }
        new |= targets - seen
    assert set(OWN) <= seen


@pytest.mark.parametrize("page", DECISIONS, ids=lambda page: page.stem)
def test_a_decision_is_complete(page: Path) -> None:
    number = DECISIONS.index(page) + 1
    text = page.read_text()
    assert page.name.startswith(f"{number:02}-"), "decisions are numbered without gaps"
    assert text.startswith(f"# {number}. ")
    assert HEADING.findall(text)[1:] == ["Context", "Decision", "Consequences"]
    assert f"(decisions/{page.name})" in (ROOT / "docs" / "index.md").read_text(), "the index lists decisions"


def test_make_help_lists_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text()
    phony = set(re.findall(r"^\.PHONY: (\S+)$", makefile, flags=re.MULTILINE))
    documented = set(re.findall(r"^([a-z-]+):.*## ", makefile, flags=re.MULTILINE))
    assert phony == documented
    mentioned = {
        target
        for page in PAGES
        for target in re.findall(r"(?:^|`)make ([a-z-]+)(?: {2,}|`|$)", page.read_text(), flags=re.MULTILINE)
    }
    assert mentioned <= phony, "the documentation names targets that the Makefile does not have"


def test_headings_are_short() -> None:
    long = {title: page.name for page in PAGES for title in HEADING.findall(prose(page)) if len(title) > 70}
    assert not long


def test_summaries_of_commands_begin_with_a_verb_and_fit_one_line() -> None:
    summaries = dict(line.split(": ", 1) for line in SUMMARIES.read_text().splitlines())
    assert {text.split()[0] for text in summaries.values()} <= VERBS, "add a verb to VERBS, or begin with one"
    for name in summaries:
        shown = CliRunner().invoke(commands, [*name.split()[1:], "--help"]).output.splitlines()
        assert max(map(len, shown)) <= 80, name
        cut = [line for line in shown if line.endswith("...") and not line.startswith("Usage")]
        assert not cut, f"{name} --help: a summary does not fit one line"


def glossary_column(heading: str) -> list[str]:
    """First cells of the tables below the heading that begins so."""
    section = GLOSSARY.read_text().partition(f"## {heading}")[2].partition("\n## ")[0]
    return re.findall(r"^\| ([^|]+?) \|", section, flags=re.MULTILINE)[2:]


def test_the_glossary_has_each_term_once() -> None:
    headings = HEADING.findall(GLOSSARY.read_text())[1:-1]
    rows = [cell for heading in headings for cell in glossary_column(heading)]
    terms = [term.casefold() for row in rows for term in re.findall(r"\*\*(.+?)\*\*", row)]
    assert len(terms) > 40 and len(set(terms)) == len(terms)


@pytest.mark.parametrize("word", glossary_column("Replaced words"))
def test_a_replaced_word_is_in_no_heading_key_or_name(word: str) -> None:
    used = [title for page in PAGES for title in HEADING.findall(prose(page))]
    heads = re.compile(r"^\|(.+)\|\n\|[-:| ]+\|$", flags=re.MULTILINE)
    used += [cell for page in PAGES if page.name != "CHANGELOG.md" for cell in heads.findall(prose(page))]
    used += [*TABLE.index, *CATALOGUE, *FAULTS, *(one.name for one in QUANTITIES)]
    used += re.findall(r"--[a-z-]+", (ROOT / "docs" / "reference" / "command-line.md").read_text())
    used += [
        name
        for struct in {**vars(result), **vars(twin), **vars(finding)}.values()
        if isinstance(struct, type) and issubclass(struct, msgspec.Struct)
        for name in struct.__struct_encode_fields__
    ]
    found = {name for name in used if word.replace(" ", "") in re.sub(r"[ _-]", "", name.lower())}
    assert found <= KEPT, f"{word!r} has another term in {GLOSSARY.name}"
