"""A campaign as a page and as a workbook: cases by checks with failures first, and the distribution of each check."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from markupsafe import Markup

from astb.campaigns.findings import (
    FAILED,
    Distribution,
    Kind,
    Row,
    by_plan,
    distributions,
    failures_first,
    in_unit,
    kind_of,
    name_of,
    names_of,
    reason_of,
    verdict_of,
)
from bench_records.check_table import SIGNS
from bench_records.disk import kept
from bench_records.document import (
    NUMBER,
    Cell,
    Document,
    TableRow,
    caption,
    element,
    section,
    table,
)
from bench_records.typography import primed, significant, unit
from bench_records.workbook import workbook, write_row

#: Size of a distribution's drawing (px).
WIDTH, HEIGHT = 260.0, 18.0
_STYLE: Final = """\
body { max-width: 92rem; }
.cases { width: auto; font-size: .82rem; }
.cases th.check { padding: 0 .1rem .3rem; vertical-align: bottom; }
.cases th.check span { writing-mode: vertical-rl; transform: rotate(180deg); max-height: 12.6rem; overflow: hidden;
  white-space: nowrap; text-overflow: ellipsis; }
.cases td.cell { text-align: center; padding: .2rem .3rem; background: none; } .cases td { white-space: nowrap; }
.cases td.reason { white-space: normal; min-width: 16rem; max-width: 30rem; }
.cases .cell.fail { background: var(--fail); color: var(--on); }
.cases .cell.error { background: var(--error); color: var(--on); }
.cases .cell.marginal { background: #f3d28a; color: #1c2126; } .cases .cell.pass { color: var(--pass); }
"""
_COLORS: Final = {"fail": "#a8201a", "pass": "#00694e"}


class Case(NamedTuple):
    """A case in the table of a plan: its properties, its verdict, and a cell for each check, None if the case lacks
    this check.
    """

    kind: Kind
    seed: Any
    verdict: str
    reason: str
    cells: list[Cell | None]


class PlanTable(NamedTuple):
    """All cases of a plan, failures first."""

    plan: str
    checks: list[str]
    cases: list[Case]


class Spread(NamedTuple):
    """A distribution as text, with its picture."""

    of: Distribution
    drawing: Any
    mean: str
    scatter: str


def write_page(rows: Sequence[Row], path: Path, name: str) -> None:
    """Write the page of a campaign to ``path``, as one self-contained HTML file. Raises NotKept if the disk fails."""
    counted = Counter(map(verdict_of, failures_first(rows)))
    page = Document(
        f"Campaign {name}",
        "Campaign",
        [
            *map(_plan_section, plan_tables(rows)),
            _spread_section([_spread(one) for one in distributions(rows)]),
        ],
        heading=name,
        circumstances=("SIMULATED", "VIRTUAL TIME"),
        facts=(("cases", len(rows)), *counted.items()),
        style=_STYLE,
    )
    with kept(path):
        path.write_text(page.html(), encoding="utf-8", newline="\n")


def _plan_section(one: PlanTable) -> Markup:
    checks = [Cell(element("span", primed(name), title=name), "check") for name in one.checks]
    heads: list[str | Cell] = ["verdict", "case", Cell("seed", NUMBER), *checks, Cell("reason", "reason")]
    rows = [
        (
            Cell(case.verdict, f"verdict {case.verdict}"),
            case.kind.words,
            case.seed,
            *(cell or Cell("", "cell") for cell in case.cells),
            case.reason,
        )
        for case in one.cases
    ]
    return section(
        f"{one.plan}: cases by checks, failures first",
        element("div", table(heads, rows, "cases"), "wide", tabindex="0"),
        caption(
            "✓ pass, ▲ marginal (close to a limit), ✕ fail, ? no value, ∅ not available. An empty cell means that the "
            "case does not have this check. Point at a cell for its value and limits."
        ),
    )


def _spread_section(spreads: Sequence[Spread]) -> Markup:
    rows = [
        TableRow(
            (
                one.of.kind.plan,
                one.of.kind.words,
                primed(one.of.check),
                f"{one.of.failed} of {one.of.cases}",
                one.mean,
                one.scatter,
                unit(one.of.unit),
                one.drawing,
            ),
            "fail" if one.of.failed else "",
        )
        for one in spreads
    ]
    heads = (
        "plan | case | check | failed :n | mean :n value | st. dev. :n | unit :u | all values, limits in grey"
    )
    return section(
        "Distributions, most frequent failures first",
        element("div", table(heads, rows), "wide", tabindex="0"),
        caption("Each row is one check over all random seeds of a case. St. dev. is the standard deviation."),
    )


def plan_tables(rows: Sequence[Row]) -> list[PlanTable]:
    """Return a table for each plan: its cases, each with a cell for every check."""
    return [
        PlanTable(plan, checks, [_case(row, checks) for row in own])
        for plan, own in by_plan(rows).items()
        for checks in [names_of(own)]
    ]


def _case(row: Row, checks: Sequence[str]) -> Case:
    by_name = {name_of(one): one for one in row.get("checks") or ()}
    cells = [_cell(by_name[name]) if name in by_name else None for name in checks]
    return Case(kind_of(row), row["seed"], verdict_of(row), reason_of(row), cells)


def _cell(check: Mapping[str, Any]) -> Cell:
    def shown(what: str) -> str:
        return "" if (number := in_unit(check, what)) is None else significant(number, 4)

    limits = " … ".join(filter(None, (shown("low"), shown("high"))))
    text = f"{check['name']}: {shown('value') or 'no value'} {unit(check['unit'] or '')} ({limits})"
    verdict = check["verdict"]
    return Cell(SIGNS[verdict], f"cell {verdict.replace(' ', '-')}", primed(text))


def _spread(one: Distribution) -> Spread:
    return Spread(one, _drawing(one), significant(one.mean, 4), significant(one.scatter, 2))


def _drawing(one: Distribution) -> Any:
    """Draw every value as a stroke over the permitted band; overlapping strokes are darker."""
    ends = [*one.values, *(n for n in (one.low, one.high) if n is not None)]
    low, high = min(ends, default=0.0), max(ends, default=1.0)
    room = 0.06 * (high - low or abs(high) or 1.0)
    low, high = low - room, high + room

    def place(value: float) -> float:
        return WIDTH * (value - low) / (high - low)

    left = 0.0 if one.low is None else place(one.low)
    right = WIDTH if one.high is None else place(one.high)
    band = f'<rect x="{left:.1f}" width="{max(right - left, 1):.1f}" y="5" height="8" fill="#e3e8ec"/>'
    strokes = "".join(
        f'<path d="M{place(n):.1f} 2v14" stroke="{_COLORS["pass" if _within(n, one) else "fail"]}" '
        'stroke-width="1.6" stroke-opacity=".55"/>'
        for n in one.values
    )
    size = f'width="{WIDTH:g}" height="{HEIGHT:g}" viewBox="0 0 {WIDTH:g} {HEIGHT:g}"'
    return Markup(f'<svg class="bar" {size} aria-hidden="true">{band}{strokes}</svg>')


def _within(value: float, one: Distribution) -> bool:
    return (one.low is None or value >= one.low) and (one.high is None or value <= one.high)


def write_workbook(rows: Sequence[Row], path: Path) -> None:
    """Write the rows as an Excel file: a sheet for each plan with cases by checks, and one with the distributions.
    Raises NotKept if the disk fails. This needs the extra `excel`.
    """
    with kept(path), workbook(path) as book:
        head = book.add_format({"bold": True, "text_wrap": True, "valign": "top"})
        bad = book.add_format({"bg_color": "#fcd9d6"})
        for number, (plan, own) in enumerate(by_plan(rows).items(), 1):
            _plan_sheet(book.add_worksheet(f"{number} {plan}"[:31]), own, head, bad)
        sheet = book.add_worksheet("distributions")
        columns = (
            "plan",
            *Kind._fields[1:],
            "check",
            "unit",
            "low",
            "high",
            "mean",
            "scatter",
            "failed",
            "cases",
        )
        sheet.write_row(0, 0, columns, head)
        for place, one in enumerate(distributions(rows), 1):
            numbers = (one.check, one.unit, one.low, one.high, one.mean, one.scatter, one.failed, one.cases)
            write_row(sheet, place, (*one.kind, *numbers))
        sheet.freeze_panes(1, 0)


def _plan_sheet(sheet: Any, own: Sequence[Row], head: Any, bad: Any) -> None:
    checks = names_of(own)
    units = {name_of(one): one["unit"] for row in own for one in row.get("checks") or ()}
    first = (*Kind._fields[1:], "seed", "verdict", "reason")
    sheet.write_row(0, 0, [*first, *(f"{name}, {units[name]}".rstrip(", ") for name in checks)], head)
    for place, row in enumerate(own, 1):
        write_row(sheet, place, (*kind_of(row)[1:], row["seed"], verdict_of(row), reason_of(row)))
        for one in row.get("checks") or ():
            column = len(first) + checks.index(name_of(one))
            form = [bad] if one["verdict"] in FAILED else []
            if (value := in_unit(one, "value")) is not None:
                sheet.write_number(place, column, value, *form)
            else:
                sheet.write_string(place, column, one["verdict"], *form)
    sheet.freeze_panes(1, len(first))
    sheet.autofilter(0, 0, len(own), len(first) + len(checks) - 1)
