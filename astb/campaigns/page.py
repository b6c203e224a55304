"""A campaign as a page, cases by checks with failures first and every check's distribution, and as a workbook."""

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
from bench_records.templates import template
from bench_records.typography import primed, significant, unit
from bench_records.workbook import workbook, write_row

#: Of a distribution's picture (px).
WIDTH, HEIGHT = 260.0, 18.0
_COLORS: Final = {"fail": "#a8201a", "pass": "#00694e"}


class Cell(NamedTuple):
    """One check of one case."""

    verdict: str
    sign: str
    told: str  #: value and limits


class Case(NamedTuple):
    """A case of a plan's table: what it is, how it ended, and each check, None where it has none of that name."""

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
    """A distribution in words, with its picture."""

    of: Distribution
    drawing: Any
    mean: str
    scatter: str


def write_page(rows: Sequence[Row], path: Path, name: str) -> None:
    """Write the page of a campaign; it is self-contained. NotKept if the disk refuses it."""
    text = template("campaign.html.j2", Path(__file__).parent).render(
        name=name,
        total=len(rows),
        counted=Counter(map(verdict_of, failures_first(rows))),
        tables=plan_tables(rows),
        spreads=[_spread(one) for one in distributions(rows)],
        primed=primed,
        unit=unit,
    )
    with kept(path):
        path.write_text(text, encoding="utf-8", newline="\n")


def plan_tables(rows: Sequence[Row]) -> list[PlanTable]:
    """Return for each plan its cases by its checks."""
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
    told = f"{check['name']}: {shown('value') or 'no value'} {unit(check['unit'] or '')} ({limits})"
    return Cell(check["verdict"], SIGNS[check["verdict"]], primed(told))


def _spread(one: Distribution) -> Spread:
    return Spread(one, _drawing(one), significant(one.mean, 4), significant(one.scatter, 2))


def _drawing(one: Distribution) -> Any:
    """Every value as a stroke over the permitted band; strokes on one another are darker."""
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
    """Write the same for Excel: a sheet for each plan, cases by checks, and one with the distributions.

    NotKept if the disk refuses it; it needs the extra `excel`.
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
            told = (one.check, one.unit, one.low, one.high, one.mean, one.scatter, one.failed, one.cases)
            write_row(sheet, place, (*one.kind, *told))
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
