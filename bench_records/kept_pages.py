"""HTML pages of stored runs: the comparison of two runs, and the trend of checks of a specimen over many runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from markupsafe import Markup
from msgspec.structs import replace

from bench_records.disk import kept
from bench_records.document import (
    Document,
    TableRow,
    caption,
    drawing,
    facts_table,
    pairs,
    paragraph,
    section,
    table,
)
from bench_records.plots import ALARM, PALETTE, SOFT, heading, number, panel, style, svg
from bench_records.result import Check
from bench_records.typography import THIN_SPACE, fixed, primed, significant, unit, with_uncertainty

if TYPE_CHECKING:
    from bench_records.comparison import CheckPair, Comparison
    from bench_records.index import KeptCheck
    from bench_records.trend import Trend

#: Larger relative changes are not shown, because A was near zero.
_TIMES = 10.0
#: Up to these limits the time axis is in hours (days ≤ 3), and in minutes (hours ≤ 3).
_FEW_DAYS = 3.0
_FEW_HOURS = 3.0


class Row(NamedTuple):
    """The texts of a check in a comparison of two runs."""

    phase: str
    name: str
    a: str
    b: str
    change: str
    uncertainty: str  #: of the change
    remark: str
    tone: str


def write_comparison(comparison: Comparison, path: Path) -> None:
    """Write the comparison of two runs as one self-contained page. Raises NotKept if it cannot be written."""
    from bench_records.report_plots import curve_panel

    ends = zip("AB", comparison.verdicts, comparison.circumstances, strict=True)
    facts = [(fact.what.replace("_", " "), fact.a or "–", fact.b or "–") for fact in comparison.facts]
    drawings = [
        curve_panel(
            f"curve{number}",
            " · ".join(filter(None, (pair.group, pair.name))),
            [replace(pair.a, name="A"), replace(pair.b, name="B")],
        )
        for number, pair in enumerate(comparison.curves)
        if pair.a.xs
    ]
    bars = any(one.expanded for pair in comparison.curves for one in (pair.a, pair.b))
    rows = [comparison_row(pair) for pair in comparison.checks]
    sections = [
        section(
            "Differences of the conditions",
            table("condition | A | B", facts)
            if facts
            else paragraph("None in the records: same plan, parameters, specimen, rig and software."),
        ),
        section(
            "Results",
            table(
                "phase | check | A :n | B :n | B − A :n | ± U :n | remark",
                [TableRow(row[:-1], row.tone) for row in rows],
            ),
            caption(
                "± U is the expanded uncertainty of the change. It assumes that the errors of A and B are "
                "independent; errors of the same instruments cancel in a change, so the true uncertainty may be "
                "smaller. It is empty where the uncertainty of A or B is not known."
            ),
        ),
    ]
    if drawings or comparison.lonely_curves:
        notes = ["The line through a point is its expanded uncertainty."] if bars else []
        notes += ["; ".join(comparison.lonely_curves)] if comparison.lonely_curves else []
        sections.append(section("Curves", pairs(drawings), *map(caption, notes)))
    a, b = comparison.names
    page = Document(
        f"{a} compared with {b}",
        "Comparison of two runs",
        sections,
        heading=Markup("A: {}<br>B: {}").format(a, b),
        facts=[
            (f"verdict of {name}", ", ".join(filter(None, (verdict, circumstances))))
            for name, verdict, circumstances in ends
        ],
    )
    with kept(path):
        path.write_text(page.html(), encoding="utf-8", newline="\n")


def comparison_row(pair: CheckPair) -> Row:
    """Return the texts for a pair of checks: values with unit, change with sign, and other differences."""
    known = pair.a or pair.b
    assert known is not None
    remarks = ["changed by more than its uncertainty"] if pair.exceeds else []
    if pair.a is None or pair.b is None:
        remarks.append(f"only in {'A' if pair.a else 'B'}")
    if pair.verdict_changed and pair.a and pair.b:
        remarks.append(f"{pair.a.verdict} → {pair.b.verdict}")
    if pair.limits_changed and pair.a and pair.b:
        remarks.append(f"limits {_limits(pair.a)} → {_limits(pair.b)}")
    change = ""
    if pair.change is not None:
        change = _figure(pair.change, known, sign=True)
        if pair.share is not None and abs(pair.share) < _TIMES:
            change += f" ({'+' if pair.share >= 0 else ''}{fixed(100 * pair.share, 1)}{THIN_SPACE}%)"
    worse = pair.b is not None and not pair.b.passed and pair.verdict_changed
    return Row(
        pair.phase,
        pair.name,
        _figure(pair.a.number, pair.a) if pair.a else "",
        _figure(pair.b.number, pair.b) if pair.b else "",
        change,
        ""
        if pair.change_expanded is None
        else f"± {significant(pair.change_expanded / known.scale, 2)}{THIN_SPACE}{unit(known.unit)}".rstrip(),
        "; ".join(remarks),
        "fail" if worse else "marginal" if remarks else "",
    )


def _figure(value: float, one: Check, *, sign: bool = False) -> str:
    """Return an SI value as text in the unit of the check. With its decimals, the largest of the value and the limits
    has four digits.
    """
    if not math.isfinite(value):
        return "–"
    sizes = [abs(n / one.scale) for n in (one.number, one.low, one.high) if n and math.isfinite(n)]
    decimals = min(6, max(0, 4 - math.ceil(math.log10(max(sizes))))) if sizes else 0
    text = fixed(value / one.scale, decimals)
    return f"{'+' if sign and value >= 0 else ''}{text}{THIN_SPACE}{unit(one.unit)}".rstrip()


def _limits(one: Check) -> str:
    low, high = ("" if n is None else _figure(n, one) for n in (one.low, one.high))
    return f"{low} … {high}".strip()


class Part(NamedTuple):
    """The section for one check on a page of trends."""

    name: str
    words: list[str]
    section: Markup


def write_trends(trends: Sequence[Trend], specimen: str, path: Path) -> None:
    """Write a page with the trends of one or more checks of a specimen. Raises NotKept if it cannot be written."""
    parts = [_trend_part(place, trend) for place, trend in enumerate(trends)]
    sections = [part.section for part in parts]
    if parts[1:]:
        links = (
            Markup('<a href="#trend{}">{}</a>').format(place, one.name) for place, one in enumerate(parts)
        )
        texts = [" ".join(part.words) for part in parts]
        sections.insert(0, section("Summary", facts_table(zip(links, texts, strict=True))))
    checks = [one for trend in trends for one in trend.checks]
    if any(one.expanded is not None for one in checks):
        sections.append(
            caption(
                "± U, and the line through a point, is the expanded uncertainty. It includes errors that are "
                "equal in every run, which the scatter does not show. Dashed red lines are the limits at each time."
            )
        )
    what = parts[0].name if len(parts) == 1 else f"{len(parts)} checks"
    page = Document(
        f"{what}, specimen {specimen}",
        "Trend of a check" if len(parts) == 1 else "Trend of checks",
        sections,
        circumstances=sorted({one.run.circumstances for one in checks if one.run.circumstances}),
    )
    with kept(path):
        path.write_text(page.html(), encoding="utf-8", newline="\n")


def _trend_part(place: int, trend: Trend) -> Part:
    name, words = primed(trend.name), trend_words(trend)
    rows = [
        TableRow(
            (
                one.run.began.replace("T", " ").removesuffix("Z"),
                one.run.directory,
                one.run.plan,
                one.phase,
                one.run.rig,
                _kept_figure(one),
                _uncertainty(one),
                one.verdict,
            ),
            one.verdict if one.verdict in {"fail", "marginal", "error"} else "",
        )
        for one in trend.checks
    ]
    heads = "when (UTC) | run | plan | phase | rig | value :n | ± U :n | verdict"
    picture = drawing(_over_time(trend, f"trend{place}"))
    shown = section(name, *map(paragraph, words), picture, table(heads, rows), anchor=f"trend{place}")
    return Part(name, words, shown)


def trend_words(trend: Trend) -> list[str]:
    """Return sentences on the requirement and on mean, scatter and drift of the values."""
    last = trend.checks[-1]
    requirement = [f"Requirement {last.requirement}."] if last.requirement else []
    return requirement + _figures(trend, last)


def _figures(trend: Trend, last: KeptCheck) -> list[str]:
    if trend.mean is None:
        return [f"None of {len(trend.checks)} runs gave a value."]
    in_unit = f"{THIN_SPACE}{unit(last.unit)}".rstrip()
    mean, scatter = with_uncertainty(trend.mean / last.scale, (trend.scatter or 0.0) / last.scale)
    if len(trend.checks) == 1:
        return [f"One run: {mean}{in_unit}. A second run shows the scatter, a third the drift."]
    words = [f"{len(trend.checks)} runs; mean {mean}{in_unit}."]
    if trend.scatter is not None:
        shown = scatter if trend.scatter else "0"
        words.append(f"They scatter by {shown}{in_unit} (one standard deviation).")
    if trend.drift is None:
        words.append("The runs are too few or too close in time to determine a drift.")
    else:
        # The drift is given over the observed time, because an extrapolation to a day would be uncertain.
        span = (max(trend.days) - min(trend.days)) / last.scale
        change, half = with_uncertainty(span * trend.drift.per_day, span * trend.drift.half_width)
        seen = "It drifts" if trend.drift.is_seen else "No drift is seen"
        words.append(f"{seen}: {change}{in_unit} from the first to the last, ± {half}{in_unit} (95 %).")
    return words


def _kept_figure(one: KeptCheck) -> str:
    return (
        "–"
        if one.value is None
        else f"{significant(one.value / one.scale, 5)}{THIN_SPACE}{unit(one.unit)}".rstrip()
    )


def _uncertainty(one: KeptCheck) -> str:
    return "" if one.expanded is None else f"± {significant(one.expanded / one.scale, 2)}"


def _time_axis(days: float) -> tuple[str, float]:
    """Return the unit of the time axis for a duration of ``days``, and how many of these units a day has."""
    return (
        ("days", 1.0)
        if days > _FEW_DAYS
        else ("hours", 24.0)
        if days * 24 > _FEW_HOURS
        else ("minutes", 1440.0)
    )


def _over_time(trend: Trend, name: str) -> str:
    last = trend.checks[-1]
    points = [
        (day, one.value / one.scale, one)
        for day, one in zip(trend.days, trend.checks, strict=True)
        if one.value is not None
    ]
    time, factor = _time_axis(max(trend.days))
    when = [factor * day for day in trend.days]
    with style():
        figure, axes = panel(3.2, width=9.2, right=1.35, bottom=0.55, top=0.32)
        axes.plot(
            [factor * day for day, *_ in points], [value for _, value, _ in points], color=SOFT, linewidth=0.7
        )
        for day, value, one in points:
            bad = one.verdict == "fail"
            axes.plot(
                factor * day,
                value,
                marker="X" if bad else "o",
                color=ALARM if bad else PALETTE[0],
                markersize=6,
            )
        for day, value, one in points:
            if one.expanded is not None:
                reach = one.expanded / last.scale
                axes.errorbar(factor * day, value, reach, color=SOFT, linewidth=0.9, capsize=3, zorder=1)
        for field, limit in (("low", "lower limit"), ("high", "upper limit")):
            places = [getattr(one, field) for one in trend.checks]
            levels = [math.nan if n is None else n / last.scale for n in places]
            # A limit is drawn as a step curve, because it may change between runs.
            drawn: dict[str, Any] = {"color": ALARM, "linewidth": 0.9, "linestyle": (0, (4, 2))}
            if max(when) > 0.0:
                axes.step(when, levels, where="post", **drawn)
            elif not math.isnan(levels[-1]):
                axes.axhline(levels[-1], **drawn)
            if not math.isnan(levels[-1]):
                named = f"{limit} {number(levels[-1])}"
                offset: dict[str, Any] = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
                where = (1.0, levels[-1])
                axes.annotate(
                    named, where, xycoords=("axes fraction", "data"), color=ALARM, fontsize=8, **offset
                )
        if trend.drift is not None and trend.drift.is_seen and trend.mean is not None:
            middle = sum(day for day, *_ in points) / len(points)
            ends = (min(trend.days), max(trend.days))
            line = [(trend.mean + trend.drift.per_day * (day - middle)) / last.scale for day in ends]
            axes.plot([factor * end for end in ends], line, color=PALETTE[1], linewidth=1.2)
        axes.margins(0.06)
        if not max(when) > 0.0:
            axes.set_xticks([0.0])  # no ticks before the first run
        heading(axes, primed(trend.name), unit(last.unit))
        axes.set_xlabel(f"{time} since the first run", loc="right")
        return svg(figure, name)
