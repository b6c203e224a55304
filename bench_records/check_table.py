"""The table of checks: each value with its limits, and a drawing of the value between its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from bench_records.conformity import percent
from bench_records.result import Check, CheckVerdict, band_width
from bench_records.typography import aligned, fixed, is_scientific, primed, scientific, unit

BAR_WIDTH, BAR_HEIGHT = 176.0, 16.0
COLORS = {
    CheckVerdict.PASS: "#00694e",
    CheckVerdict.MARGINAL: "#b87a00",
    CheckVerdict.FAIL: "#a8201a",
    CheckVerdict.ERROR: "#5b3f8c",
    CheckVerdict.NOT_AVAILABLE: "#5b6670",
}
#: Names of checks of one kind that are reported in full.
NAMED = 2
#: Smallest shares of a variance that are reported.
ALMOST_ALL, MOSTLY = 0.9, 0.5
SIGNS = {
    CheckVerdict.PASS: "\u2713",
    CheckVerdict.MARGINAL: "\u25b2",
    CheckVerdict.FAIL: "\u2715",
    CheckVerdict.ERROR: "?",
    CheckVerdict.NOT_AVAILABLE: "\u2205",
}


class CheckRow(NamedTuple):
    """The texts of one check in the table."""

    check: Check
    name: str
    sign: str
    value: str
    uncertainty: str  #: expanded, "" where it is not known
    low: str
    high: str
    unit: str
    detail: str  #: place of the measurement, remarks and certainty
    bar: Bar | None  #: none where there is no limit


class Meaning(NamedTuple):
    """The names of the checks of one kind, and a sentence on what they measure and why."""

    names: str
    about: str


class Bar(NamedTuple):
    """A range bar in drawing units: the band between the limits, its marginal zones, and the position of the value."""

    left: float
    right: float
    inner_left: float
    inner_right: float
    reach: float | None  #: of the expanded uncertainty to either side
    place: float | None
    beyond: int
    open_left: bool
    open_right: bool


def check_rows(checks: list[Check]) -> list[CheckRow]:
    """Return the rows of the table, with aligned decimal points in each column."""
    figures = [_numbers_with_limits(one) for one in checks]
    decimals = [len(text.partition(".")[2]) for row in figures for text in row if not is_scientific(text)]
    most = max(decimals, default=0)
    rows = []
    for one, texts in zip(checks, figures, strict=True):
        value, low, high = (text if is_scientific(text) else aligned(text, most) for text in texts)
        known = one.u is not None and math.isfinite(one.number)
        uncertainty = f"± {_grouped(one.written[1])}" if known else ""
        bar = None if one.low is None and one.high is None else range_bar(one)
        detail = _detail(one)
        names = (primed(one.name), SIGNS[one.verdict])
        rows.append(CheckRow(one, *names, value, uncertainty, low, high, unit(one.unit), detail, bar))
    return rows


def meanings(checks: list[Check]) -> list[Meaning]:
    """Return what the checks measure and why, each sentence once, in the order of the checks."""
    named: dict[str, dict[str, None]] = {}
    for one in checks:
        if one.about:
            named.setdefault(one.about, {})[primed(one.name)] = None
    return [Meaning(_join_names(list(names)), about) for about, names in named.items()]


def _join_names(names: list[str]) -> str:
    more = len(names) - NAMED
    return "; ".join(names) if more <= 1 else f"{'; '.join(names[:NAMED])}; and {more} like these"


def _numbers_with_limits(one: Check) -> list[str]:
    """Return value, lower and upper limit as texts in the check's unit.

    The resolution of the limits is about a hundredth of the band. More digits would show noise, and fewer could hide
    the verdict. The value has the same decimals, or those of its uncertainty if it is known.
    """
    numbers = [math.nan if n is None else n / one.scale for n in (one.number, one.low, one.high)]
    known = [n for n in numbers if math.isfinite(n)]
    largest = max((abs(n) for n in known), default=0.0)
    show = fixed
    if not one.unit and all(n == round(n) for n in known):
        decimals = 0  # a count
    elif largest and not 1e-4 <= largest < 1e7:
        show, decimals = scientific, 3
    else:
        width = band_width(one.low, one.high) / one.scale or largest or 1.0
        decimals = min(6, max(0, math.ceil(-math.log10(width / 100) - 1e-9)))
    # A failed value must not be rounded onto its limit.
    while one.verdict is CheckVerdict.FAIL and decimals < 15:
        shown = [show(n, decimals) for n in numbers]
        if shown[0] not in shown[1:]:
            break
        decimals += 1
    texts = [show(n, decimals) for n in numbers]
    if one.u is not None and math.isfinite(one.number):
        texts[0] = _grouped(one.written[0])
    return texts


def _grouped(text: str) -> str:
    """Return a number in the typography of the table, with the same number of digits."""
    return fixed(float(text), len(text.partition(".")[2]))


def _detail(one: Check) -> str:
    # The part of the run is obvious, so only the phase within it is named.
    phase = "" if one.phase in {"set-up", "main", "tear-down"} else one.phase
    requirement = f"requirement {one.requirement}" if one.requirement else ""
    return "; ".join(primed(text) for text in (requirement, phase, one.note, certainty(one)) if text)


def certainty(one: Check) -> str:
    """Return a text with the probability of conformity and the largest causes of uncertainty, or with the reason why
    there is no uncertainty. It is "" if neither is known.
    """
    if one.without and math.isfinite(one.number):
        return f"no uncertainty: {one.without}"
    if not one.u or one.conformity is None or not math.isfinite(one.number):
        return ""
    text = f"probability of conformity {percent(one.conformity)} (k = {one.k:.3g})"
    return f"{text}; uncertainty {causes}" if (causes := _causes(one.parts, one.u)) else text


def _causes(parts: Mapping[str, float], u: float) -> str:
    """Return a text with the largest causes of an uncertainty ``u``. The second cause is left out if the first one
    dominates.
    """
    shares = sorted(((part / u) ** 2, cause.replace("_", " ")) for cause, part in parts.items())[::-1]
    if not shares:
        return ""
    (first, most), *others = shares
    if first > ALMOST_ALL:
        return f"almost only from {most}"
    if first > MOSTLY:
        return f"mainly from {most}" + (f", then {others[0][1]}" if others else "")
    named = [most, *(cause for _, cause in others[:1])]
    return f"from {' and '.join(named)}" if len(others) < 2 else f"from {', '.join(named)} and others"


def range_bar(one: Check) -> Bar:
    """Return the bar of a check. The band is in the middle; on a side without a limit it continues to the edge."""
    margin = one.guard
    if one.low is not None and one.high is not None:
        width = one.high - one.low or abs(one.high) or 1.0
        start, end = one.low - 0.22 * width, one.high + 0.22 * width
    else:
        limit = one.low if one.low is not None else one.high
        assert limit is not None  # a check has a limit, or it could not have been made
        reach = max(abs(limit), abs(one.number - limit) if math.isfinite(one.number) else 0.0) or 1.0
        start, end = (
            (limit - 0.45 * reach, limit + 1.1 * reach)
            if one.low is not None
            else (limit - 1.1 * reach, limit + 0.45 * reach)
        )

    def place(value: float) -> float:
        return BAR_WIDTH * (value - start) / (end - start)

    left = 0.0 if one.low is None else place(one.low)
    right = BAR_WIDTH if one.high is None else place(one.high)
    at = place(one.number) if math.isfinite(one.number) else None
    beyond = 0 if at is None else (at > BAR_WIDTH - 5) - (at < 5)
    return Bar(
        left=left,
        right=right,
        inner_left=left if one.low is None else min(place(one.low + margin), right),
        inner_right=right if one.high is None else max(place(one.high - margin), left),
        reach=None if one.expanded is None else BAR_WIDTH * one.expanded / (end - start),
        place=None if at is None else min(max(at, 5.0), BAR_WIDTH - 5),
        beyond=beyond,
        open_left=one.low is None,
        open_right=one.high is None,
    )


def bar_drawing(row: CheckRow) -> Any:
    """Return the range bar as an SVG element. It is made without matplotlib because a page has dozens of bars."""
    from markupsafe import Markup

    bar, middle = row.bar, BAR_HEIGHT / 2
    if bar is None:
        return ""
    color = COLORS[row.check.verdict]
    parts = [
        f'<line x1="0" x2="{BAR_WIDTH:g}" y1="{middle:g}" y2="{middle:g}" stroke="#dfe3e7"/>',
        _rectangle(bar.left, bar.right, "#d3dae0"),
        *(
            _hatched(start, end)
            for start, end in ((bar.left, bar.inner_left), (bar.inner_right, bar.right))
            if end - start > 0.5
        ),
        *(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="2" y2="{BAR_HEIGHT - 2:g}" stroke="#5b6670"/>'
            for at, absent in ((bar.left, bar.open_left), (bar.right, bar.open_right))
            if not absent
        ),
    ]
    if bar.place is not None and bar.beyond:
        tip = 5.0 * bar.beyond
        parts.append(
            f'<path d="M{bar.place - tip:.1f} {middle - 5:g}l{2 * tip:.1f} 5l{-2 * tip:.1f} 5z" fill="{color}"/>'
        )
    elif bar.place is not None:
        if bar.reach is not None:
            ends = (max(bar.place - bar.reach, 0.0), min(bar.place + bar.reach, BAR_WIDTH))
            parts.append(
                f'<line x1="{ends[0]:.1f}" x2="{ends[1]:.1f}" y1="{middle:g}" y2="{middle:g}" '
                f'stroke="{color}" stroke-width="1.6"/>'
            )
        parts.append(
            f'<path d="M{bar.place:.1f} {middle - 6:g}l4.5 6l-4.5 6l-4.5 -6z" fill="{color}" stroke="#fff"/>'
        )
    size = f'width="{BAR_WIDTH:g}" height="{BAR_HEIGHT:g}" viewBox="0 0 {BAR_WIDTH:g} {BAR_HEIGHT:g}"'
    return Markup(f'<svg class="bar" {size} aria-hidden="true">{"".join(parts)}</svg>')


def _rectangle(start: float, end: float, color: str) -> str:
    y = BAR_HEIGHT / 2 - 3
    return f'<rect x="{start:.1f}" y="{y:g}" width="{max(end - start, 1):.1f}" height="6" fill="{color}"/>'


def _hatched(start: float, end: float) -> str:
    """Return a marginal zone in amber with slanted strokes, which remain visible in a black-and-white copy."""
    low, pitch = BAR_HEIGHT / 2 + 3, 2.4
    strokes = "".join(
        f"M{start + pitch * i:.1f} {low:g}l{pitch:g} -6" for i in range(max(1, int((end - start) / pitch)))
    )
    zone = _rectangle(start, end, "#f3d28a")
    return f'{zone}<path d="{strokes}" stroke="#8f5a00" stroke-width="0.8" fill="none"/>'
