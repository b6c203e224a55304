"""Pages with one look: title, facts, and sections of text, tables and drawings; all text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from markupsafe import Markup

#: Of a column: left-aligned text (""), numbers, the main number, a unit.
NUMBER, VALUE, UNIT = "n", "n value", "u"

_PAGE: Final = Markup("""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<main>
<header>
<div class="masthead"><span><b>ASTB</b>&ensp;Air spring test bench</span><span>{kind}</span></div>
<h1>{heading}</h1>
{head}</header>
{sections}</main>
</body>
</html>
""")


class Cell(NamedTuple):
    """A cell with its own CSS class, and a text that appears under the pointer."""

    text: str
    kind: str = ""
    hint: str = ""


class TableRow(NamedTuple):
    """The cells of a row of a table, and its class."""

    cells: Sequence[Any]
    tone: str = ""


class Banner(NamedTuple):
    """The result of a page: a word, why, and a smaller line; ``tone`` is its class."""

    word: str
    why: str
    tally: str = ""
    tone: str = ""

    def __html__(self) -> Markup:
        text = '<div class="banner {}"><div class="word">{}</div><div class="why">{}{}</div></div>\n'
        tally = element("span", self.tally, "tally") if self.tally else ""
        return Markup(text).format(self.tone or self.word, self.word, self.why, tally)


class Document(NamedTuple):
    """A page in a single file; ``kind`` is its name at the right of the head, ``style`` extends the common style."""

    title: str
    kind: str
    sections: Sequence[Markup]
    heading: str = ""  #: the title where it is empty
    circumstances: Sequence[str] = ()
    banner: Banner | None = None
    facts: Iterable[tuple[str, Any]] = ()
    style: str = ""

    def html(self) -> str:
        """Return the page."""
        marks = joined(element("span", one) for one in self.circumstances)
        facts = joined(Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(*fact) for fact in self.facts)
        head = [
            element("p", marks, "circumstances") if marks else "",
            self.banner or "",
            element("dl", facts, "key") if facts else "",
        ]
        return _PAGE.format(
            title=self.title,
            kind=self.kind,
            heading=self.heading or self.title,
            style=Markup(_style() + self.style),
            head=joined(head),
            sections=joined(self.sections),
        )


def joined(parts: Iterable[Any], by: str = "") -> Markup:
    """Return the concatenated texts; texts that are not markup are escaped."""
    return Markup(by).join(parts)


def element(name: str, content: Any, kind: str = "", **attributes: str) -> Markup:
    """Return an element with its content and, where they are not empty, its class and attributes."""
    known = ({"class": kind} | attributes).items()
    told = joined(Markup(' {}="{}"').format(key, value) for key, value in known if value)
    return Markup("<{0}{1}>{2}</{0}>").format(name, told, content)


def section(heading: str, *parts: Any, anchor: str = "") -> Markup:
    """Return a section of a page."""
    return element("section", joined(["\n", element("h2", heading), "\n", *parts]), id=anchor) + "\n"


def paragraph(text: Any) -> Markup:
    """Return a paragraph."""
    return element("p", text) + "\n"


def caption(text: str) -> Markup:
    """Return a note under a table or a drawing."""
    return element("p", text, "caption") + "\n"


def bullets(texts: Iterable[Any]) -> Markup:
    """Return a list."""
    return element("ul", joined(element("li", one) for one in texts)) + "\n"


def drawing(svg: str) -> Markup:
    """Return a drawing (SVG), which scrolls on a narrow screen."""
    return element("div", Markup(svg), "wide", tabindex="0") + "\n"


def pairs(drawings: Iterable[str]) -> Markup:
    """Return drawings (SVG) of half the width of the page."""
    return element("div", joined(element("figure", Markup(one)) for one in drawings), "pair") + "\n"


def table(columns: Iterable[str | Cell], rows: Iterable[TableRow | Sequence[Any]], kind: str = "") -> Markup:
    """Return a table; the class of a column holds for its cells."""
    heads = [one if isinstance(one, Cell) else Cell(one) for one in columns]
    top = element("tr", joined(element("th", one.text, one.kind.split(" ")[0]) for one in heads))
    lines = (one if isinstance(one, TableRow) else TableRow(one) for one in rows)
    body = joined(
        (element("tr", joined(map(_cell, line.cells, heads)), line.tone) + "\n" for line in lines),
    )
    return element("table", element("thead", top) + "\n" + element("tbody", body), kind, tabindex="0") + "\n"


def facts_table(facts: Iterable[tuple[Any, Any]]) -> Markup:
    """Return a table of names with their values, without a head."""
    body = joined(element("tr", element("td", name) + element("td", value)) + "\n" for name, value in facts)
    return element("table", element("tbody", body), "facts") + "\n"


def _cell(told: Any, head: Cell) -> Markup:
    if isinstance(told, Cell):
        return element("td", told.text, told.kind, title=told.hint)
    return element("td", told, head.kind)


@cache
def _style() -> str:
    return (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
