"""HTML pages in a common style: title, facts, and sections of text, tables and drawings. All plain text is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from markupsafe import Markup, escape

from bench_records.typography import significant

#: The class of a column of numbers; that of the main numbers is "n value", of units and notes "u", of texts "".
NUMBER: Final = "n"

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
{top}<div class="masthead"><span><b>ASTB</b>&ensp;Air spring test bench</span><span>{kind}</span></div>
<h1>{heading}</h1>
{head}</header>
{sections}</main>
{scripts}</body>
</html>
""")


class Cell(NamedTuple):
    """A table cell with its own CSS class and tooltip."""

    text: str
    kind: str = ""
    hint: str = ""


class TableRow(NamedTuple):
    """The cells of a table row, and the CSS class of the row."""

    cells: Sequence[Any]
    tone: str = ""


class Banner(NamedTuple):
    """The result at the top of a page: a word, its reason, and a smaller line. ``tone`` is its CSS class."""

    word: str
    reason: str
    tally: str = ""
    tone: str = ""

    def __html__(self) -> Markup:
        text = '<div class="banner {}"><div class="word">{}</div><div class="why">{}{}</div></div>\n'
        tally = element("span", self.tally, "tally") if self.tally else ""
        return Markup(text).format(self.tone or self.word, self.word, self.reason, tally)


class Document(NamedTuple):
    """A self-contained page. ``kind`` is the text at the right of the first line; ``style`` is added to the common
    style.
    """

    title: str
    kind: str
    sections: Sequence[Markup]
    heading: str = ""  #: the title where it is empty
    circumstances: Sequence[str] = ()
    banner: Banner | Markup | None = None
    facts: Iterable[tuple[str, Any]] = ()
    style: str = ""
    top: Markup = Markup()  #: above the first line
    scripts: Markup = Markup()

    def html(self) -> str:
        """Return the page as HTML."""
        marks = joined(element("span", one) for one in self.circumstances)
        head = [paragraph(marks, "circumstances"), self.banner or "", key_facts(self.facts)]
        return _PAGE.format(
            title=self.title,
            kind=self.kind,
            heading=self.heading or self.title,
            style=Markup(_style() + self.style),
            head=joined(head),
            sections=joined(self.sections),
            top=self.top,
            scripts=self.scripts,
        )


def joined(parts: Iterable[Any], by: str = "") -> Markup:
    """Return the parts as one text, with ``by`` between them. Parts that are not markup are escaped."""
    return Markup(by).join(parts)


def element(name: str, content: Any, kind: str = "", **attributes: str) -> Markup:
    """Return an HTML element with its content. Empty class and attributes are left out."""
    known = ({"class": kind} | attributes).items()
    # Markup.format takes ten times as long, and a report has a thousand elements.
    attribute_text = "".join(f' {key}="{escape(value)}"' for key, value in known if value)
    return Markup(f"<{name}{attribute_text}>{escape(content)}</{name}>")


def key_facts(facts: Iterable[tuple[str, Any]]) -> Markup:
    """Return names with their values as a list in columns, or empty markup if there are no facts."""
    rows = joined(Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(*fact) for fact in facts)
    return element("dl", rows, "key") + "\n" if rows else rows


def section(heading: str, *parts: Any, anchor: str = "", kind: str = "") -> Markup:
    """Return a section of a page. A part that is plain text becomes a paragraph."""
    content = (one if isinstance(one, Markup) else paragraph(one) for one in parts)
    return element("section", joined(["\n", element("h2", heading), "\n", *content]), kind, id=anchor) + "\n"


def subheading(text: str) -> Markup:
    """Return a heading within a section."""
    return element("h3", text, "sub") + "\n"


def paragraph(text: Any, kind: str = "") -> Markup:
    """Return a paragraph, or empty markup if there is no text."""
    return element("p", text, kind) + "\n" if text else Markup()


def caption(text: str) -> Markup:
    """Return a note under a table or a drawing, or empty markup if there is no text."""
    return paragraph(text, "caption")


def bullets(texts: Iterable[Any], kind: str = "") -> Markup:
    """Return a bulleted list, or empty markup if there are no texts."""
    entries = joined(element("li", one) for one in texts)
    return element("ul", entries, kind) + "\n" if entries else entries


def drawing(svg: str) -> Markup:
    """Return a drawing (SVG) that scrolls on a narrow screen, or empty markup if there is none."""
    return element("div", Markup(svg), "wide", tabindex="0") + "\n" if svg else Markup()


def figure(svg: str) -> Markup:
    """Return a drawing (SVG) as a figure, or empty markup if there is none."""
    return element("figure", Markup(svg)) if svg else Markup()


def pairs(drawings: Iterable[str]) -> Markup:
    """Return drawings (SVG) with half the width of the page, or empty markup if there are none."""
    figures = joined(map(figure, drawings))
    return element("div", figures, "pair") + "\n" if figures else figures


def table(
    columns: str | Iterable[str | Cell], rows: Markup | Iterable[TableRow | Sequence[Any]], kind: str = ""
) -> Markup:
    """Return a table, or empty markup if there are no rows. The CSS class of a column applies to its cells.

    ``columns`` may be one text such as "channel | noise :n | :u". It contains the column heads, each with its class
    after a colon. Floats have three digits, and None is a dash. ``rows`` may be finished table bodies.
    """
    if isinstance(columns, str):
        parts = (one.partition(":") for one in columns.split("|"))
        columns = [Cell(name.strip(), form.strip()) for name, _, form in parts]
    heads = [one if isinstance(one, Cell) else Cell(one) for one in columns]
    top = element("tr", joined(element("th", one.text, one.kind) for one in heads))
    if not isinstance(rows, Markup):
        lines = [one if isinstance(one, TableRow) else TableRow(one) for one in rows]
        body = joined(
            element("tr", joined(map(_cell, line.cells, heads)), line.tone) + "\n" for line in lines
        )
        rows = element("tbody", body) if body else body
    return element("table", element("thead", top) + "\n" + rows, kind, tabindex="0") + "\n" if rows else rows


def facts_table(facts: Iterable[tuple[Any, Any]]) -> Markup:
    """Return a table of names and values without a head, or empty markup if there are no facts."""
    body = joined(element("tr", element("td", name) + element("td", value)) + "\n" for name, value in facts)
    return element("table", element("tbody", body), "facts") + "\n" if body else body


def _cell(content: Any, head: Cell) -> Markup:
    if isinstance(content, Cell):
        return element("td", content.text, content.kind, title=content.hint)
    if content is None or isinstance(content, float):
        content = significant(math.nan if content is None else content, 3)
    return element("td", content, head.kind)


@cache
def _style() -> str:
    return (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
