"""Links and targets in the documentation exist, and every decision has all sections."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
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
    """A page that nobody links is a page that nobody reads."""
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
    assert set((ROOT / "docs").rglob("*.md")) <= seen


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


def test_the_glossary_has_at_most_forty_words_each_once() -> None:
    rows = re.findall(
        r"^\| (\*\*.+?) \| ", (ROOT / "docs/reference/glossary.md").read_text(), flags=re.MULTILINE
    )
    words = [word for row in rows for word in re.findall(r"\*\*(.+?)\*\*", row)]
    assert 20 < len(words) <= 40
    assert len({word.casefold() for word in words}) == len(words)
