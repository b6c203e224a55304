"""The drawings of a diagnosis. Each function returns one SVG element; equal findings give equal bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bench_records.plots import ALARM, HAIR, INK, PALETTE, SHADE, SOFT, heading, panel, style, svg
from bench_records.typography import fixed, significant
from diagnosis.contracts import Array
from diagnosis.finding import Confusability, Figure, Gain, PanelRow, Score, Series, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

BEFORE, AFTER, MEASURED = PALETTE[1], PALETTE[0], "#c3cad0"
#: Width of a letter in the widest font of the pages (inches).
LETTER = 0.066
#: Names of the two models of a finding; equal names are one model.
CAUSE, CAUSES, FUNCTION, MODEL = (
    ("without the cause", "with the cause"),
    ("without the causes", "with the causes"),
    ("without the fitted function", "with the fitted function"),
    ("model", "model"),
)
#: Rows and columns that a drawing has room for.
MOST_SCORES = 24
#: In a larger map of similarities, the cells are too small for numbers.
MOST_NUMBERS = 24


def values(numbers: Sequence[float | None]) -> Array:
    """Return numbers with NaN in place of None."""
    return np.array([np.nan if n is None else n for n in numbers], dtype=np.float64)


def trace_curves(name: str, trace: Trace, names: tuple[str, str]) -> str:
    """Draw a part of a test run: measured, and predicted by both models."""
    with style():
        figure, axes = panel(2.25, width=4.72, left=0.66, right=0.12, bottom=0.48, top=0.30)
        times = np.array(trace.times)
        # A wide pale band: it shows on both sides of a line that runs along it.
        measured = values(trace.measured)
        sparse = np.isfinite(measured).sum() < 0.5 * measured.size  # single samples have no line
        axes.plot(
            times,
            measured,
            "o" if sparse else "-",
            color=MEASURED,
            linewidth=4.0,
            markersize=4,
            label="measured",
        )
        if names[0] != names[1]:
            axes.plot(
                times, values(trace.before), color=BEFORE, linewidth=1.1, dashes=(4, 1.6), label=names[0]
            )
        axes.plot(times, values(trace.after), color=AFTER, linewidth=0.9, label=names[1])
        axes.margins(x=0.0, y=0.06)
        heading(axes, trace.channel, trace.unit)
        _foot(axes, f"time in s, {trace.run}")
        _legend(axes)
        return svg(figure, name)


def trace_errors(name: str, trace: Trace, names: tuple[str, str]) -> str:
    """Draw the errors over the whole run, as the range between their extremes, and a noise band of two standard
    deviations.
    """
    with style():
        figure, axes = panel(2.25, width=4.72, left=0.66, right=0.12, bottom=0.48, top=0.30)
        times = np.array(trace.error_times)
        if trace.noise is not None:
            axes.axhspan(
                -2.0 * trace.noise, 2.0 * trace.noise, color="#d3dae0", linewidth=0, label="noise (95 %)"
            )
        if names[0] != names[1]:
            axes.plot(times, values(trace.error_before), color=BEFORE, linewidth=0.8, label=names[0])
        axes.plot(times, values(trace.error_after), color=AFTER, linewidth=0.8, label=names[1])
        axes.margins(x=0.0, y=0.06)
        heading(axes, f"error of {trace.channel}", trace.unit)
        _foot(axes, f"time in s, {trace.run}")
        _legend(axes)
        return svg(figure, name)


def gain_rows(name: str, gains: Sequence[Gain], names: tuple[str, str]) -> str:
    """Draw the ratio of error to noise in each channel, before and after, on a logarithmic scale. "" without data."""
    rows = [g for g in gains if g.noise_ratio_before is not None and g.noise_ratio is not None]
    if not rows:
        return ""
    with style():
        height, left = 0.235 * len(rows) + 0.80, _room([gain.channel for gain in rows], 1.75)
        width = left + 4.65
        figure, axes = panel(height, width=width, left=left, right=0.25, bottom=0.50, top=0.30)
        for place, gain in enumerate(rows):
            before, after = gain.noise_ratio_before or 1.0, gain.noise_ratio or 1.0
            axes.plot([after, before], [place, place], color="#b9c2ca", linewidth=2.0, zorder=1)
            axes.plot(before, place, "D", color=BEFORE, markersize=5, label=None if place else names[0])
            axes.plot(after, place, "o", color=AFTER, markersize=5.5, label=None if place else names[1])
        axes.axvline(1.0, color=SOFT, linewidth=0.9, linestyle=(0, (3, 2)))
        _log_axis(axes, "x", [n for g in rows for n in (g.noise_ratio_before, g.noise_ratio)])
        axes.set_yticks(range(len(rows)), [gain.channel for gain in rows], color=INK)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        heading(axes, "RMS error divided by the noise", "", what="")
        _legend(axes)
        return _sized(svg(figure, name), width)


def score_points(name: str, scores: Sequence[Score], threshold: float) -> str:
    """Draw the score of every effect against the base model, and the threshold."""
    shown = sorted((s for s in scores if s.score is not None), key=lambda s: -(s.score or 0.0))[:MOST_SCORES]
    if not shown:
        return ""
    with style():
        height = 0.215 * len(shown) + 0.78
        labels = _room([score.title for score in shown], 2.25)
        figure, axes = panel(height, width=labels + 4.15, left=labels, right=0.75, bottom=0.44, top=0.30)
        least = 0.3
        for place, score in enumerate(shown):
            value = score.score or 0.0
            accepted, beyond = score.outcome == "accepted", value > threshold
            look: dict[str, Any] = {"color": AFTER if accepted or beyond else "#9aa3ab", "markersize": 6}
            if not accepted:
                look["markerfacecolor"] = "white"
            axes.plot(max(value, least), place, "o", **look)
            label = f"{value:.3g}".replace("-", "\u2212")
            # Together with the point, on the side where the threshold is not.
            left = 2.0 * least < value < threshold
            axes.annotate(
                label,
                (max(value, least), place),
                (-6 if left else 6, 0),
                textcoords="offset points",
                ha="right" if left else "left",
                va="center",
                fontsize=7.5,
                color=SOFT,
            )
        axes.axvline(threshold, color=ALARM, linewidth=1.0, linestyle=(0, (3, 2)))
        axes.set_xscale("log")
        largest = max(*(s.score or 0.0 for s in shown), 2.0 * threshold)
        axes.set_xlim(least, 1.6 * largest)
        _plain_log(axes, "x")
        axes.set_yticks(range(len(shown)), [s.title for s in shown], color=INK)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        title = "Scores" if len(shown) == len(scores) else f"{len(shown)} largest scores"
        heading(axes, title, "", what=f"filled: cause; dashed line: threshold {threshold:.2f}")
        return _sized(svg(figure, name), labels + 4.15)


def panel_map(name: str, rows: Sequence[PanelRow]) -> str:
    """Draw a map of all tests over all channels. A darker cell is a clearer error; a dot marks a test that does not
    apply.

    The p-value is not drawn, because in long runs it is 0 for every error.
    """
    tests = list(dict.fromkeys(row.title for row in rows if row.test != "parity"))
    channels = list(dict.fromkeys(row.channel for row in rows if row.test != "parity"))
    if not tests or not channels:
        return ""
    with style():
        from matplotlib.colors import LinearSegmentedColormap

        colors = LinearSegmentedColormap.from_list("alarm", [SHADE, "#f0c9a8", "#d55e00", "#7a2c00"])
        labels, left = _room(channels), _room(tests)
        height = 0.25 * len(tests) + 0.15 + labels
        # The last of the slanted labels needs room at its right.
        cell, right = max(0.36, min(0.52, 6.0 / len(channels))), 0.6 * labels
        width = left + cell * len(channels)
        figure, axes = panel(height, width=width + right, left=left, right=right, bottom=0.08, top=labels)
        largest = max((row.statistic or 0.0 for row in rows if row.significant), default=1.0)
        for row in rows:
            if row.test == "parity":
                continue
            x, y = channels.index(row.channel), tests.index(row.title)
            if row.q is None:
                axes.plot(x, y, ".", color="#c3cad0", markersize=3)
                continue
            size = row.statistic or 0.0
            depth = math.log1p(size) / math.log1p(largest) if row.significant else 0.0
            axes.add_patch(_cell(x, y, colors(depth)))
        _name_cells(axes, channels, tests)
        return _sized(svg(figure, name), width + right)


def cosine_map(name: str, confusability: Confusability, titles: Mapping[str, str]) -> str:
    """Draw the cosines between the footprints of all effects; those above 0.9 have a number, unless there
    are more than `MOST_NUMBERS` effects.

    ``titles`` has the name of each effect. The columns have the numbers of the rows.
    """
    effects = confusability.effects
    if len(effects) < 2:
        return ""
    with style():
        from matplotlib.colors import LinearSegmentedColormap

        colors = LinearSegmentedColormap.from_list("alike", ["#ffffff", "#c6dcea", PALETTE[0], "#00334f"])
        numbers = [str(place) for place, _ in enumerate(effects, start=1)]
        rows = [f"{titles[effect]} ({place})" for effect, place in zip(effects, numbers, strict=True)]
        labels, side = _room(rows), min(7.4, 0.30 * len(effects))
        width = side + labels + 0.1
        figure, axes = panel(side + 0.4, width=width, left=labels, right=0.1, bottom=0.1, top=0.3)
        for i, row in enumerate(confusability.cosines):
            for j, cosine in enumerate(row):
                if i == j or cosine is None:
                    axes.add_patch(_cell(j, i, SHADE))
                    continue
                axes.add_patch(_cell(j, i, colors(min(cosine, 1.0) ** 2)))
                if cosine > 0.9 and len(effects) <= MOST_NUMBERS:
                    text = f"{cosine:.2f}".lstrip("0")
                    axes.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white")
        _name_cells(axes, numbers, rows, rotation=0)
        return _sized(svg(figure, name), width)


def _name_cells(axes: Axes, columns: Sequence[str], rows: Sequence[str], rotation: float = 52) -> None:
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), rows, color=INK)
    axes.set_xticks(
        range(len(columns)), columns, rotation=rotation, ha="left" if rotation else "center", color=INK
    )
    axes.xaxis.tick_top()
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _room(names: Sequence[str], least: float = 0.0) -> float:
    """Return the width in inches that the longest of some names needs in the font of the page."""
    return max(least, 0.25 + LETTER * max(map(len, names)))


def _cell(x: float, y: float, color: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.47, y - 0.46), 0.94, 0.92, facecolor=color, linewidth=0)


def panel_figure(name: str, title: str, figure: Figure) -> str:
    """Return the figure of one of the tests of the residual, or of an unknown term (surface), as SVG."""
    with style():
        drawing, axes = panel(
            2.75,
            width=4.72,
            left=0.95 if figure.kind == "map" else 0.72,
            right=0.55 if figure.kind == "map" else 0.18,
            bottom=0.62,
            top=0.30,
        )
        for index, series in enumerate(figure.series):
            _series(axes, figure, series, PALETTE[index % len(PALETTE)])
        if figure.limit is not None:
            for limit in {figure.limit, -figure.limit if not figure.logarithmic else figure.limit}:
                axes.axhline(limit, color=ALARM, linewidth=0.8, linestyle=(0, (3, 2)))
        if figure.logarithmic:
            axes.set_yscale("log")
            _plain_log(axes, "y")
        heading(axes, title, "", what="")
        axes.set_xlabel(_small(figure, "x")[1], loc="right")
        beside = axes.set_ylabel(
            _small(figure, "y")[1] if figure.kind == "map" else figure.y_label, loc="top"
        )
        beside.set_fontsize(float(beside.get_fontsize()) * min(1.0, 36 / len(beside.get_text() or " ")))
        if 1 < len(figure.series) <= 6 and figure.kind != "map":
            _legend(axes)
        return svg(drawing, name)


def _series(axes: Axes, figure: Figure, series: Series, color: str) -> None:
    x, y = values(series.x), values(series.y)
    if figure.kind == "bars":
        if figure.logarithmic:  # a bar would begin somewhere on a scale that has no zero
            axes.plot(np.arange(x.size), y, "o-", color=color, linewidth=0.9, markersize=4.5)
        else:
            axes.bar(np.arange(x.size), y, width=0.8, color=color)
        step = max(1, x.size // 10)
        axes.set_xticks(np.arange(x.size)[::step], [f"{n:.3g}" for n in x[::step]])
    elif figure.kind == "lines":
        axes.plot(x, y, color=color, linewidth=1.0, label=series.name)
    elif figure.kind == "cloud":
        axes.plot(
            x * _small(figure, "x")[0], y, ".", color=color, markersize=2.2, alpha=0.5, markeredgewidth=0
        )
    elif figure.kind == "map":
        z = values(series.z)
        x, y = (
            _even(axes.xaxis, x * _small(figure, "x")[0], 4),
            _even(axes.yaxis, y * _small(figure, "y")[0], 6),
        )
        reach = float(np.nanmax(np.abs(z))) if z.size else 1.0
        shown = axes.scatter(
            x,
            y,
            c=z,
            s=min(160.0, 5000.0 / max(x.size, 1)),
            marker="s",
            cmap="RdBu_r",
            vmin=-reach,
            vmax=reach,
            linewidths=0.3,
            edgecolors=HAIR,
        )
        bar = axes.figure.colorbar(shown, ax=axes, pad=0.02, fraction=0.05)
        bar.outline.set_visible(False)
        bar.set_label(figure.z_label, fontsize=8)
    else:
        axes.plot(x, y, "o", color=color, markersize=4.5, markeredgecolor="white", label=series.name)


def _small(figure: Figure, axis: str) -> tuple[float, str]:
    """Return the factor and the label of an axis of a map or cloud: mm instead of m for lengths and speeds below
    0.1.
    """
    label = figure.x_label if axis == "x" else figure.y_label
    sizes = [abs(n) for one in figure.series for n in (one.x if axis == "x" else one.y) if n is not None]
    quantity, _, unit = label.rpartition(" in ")
    if figure.kind not in {"map", "cloud"} or unit not in {"m", "m/s"} or max(sizes, default=1.0) >= 0.1:
        return 1.0, label
    return 1e3, f"{quantity} in m{unit}"


def _even(axis: Axis, places: Array, ticks: int) -> Array:
    """Return equidistant positions for the values of a map axis, and label the ticks with the values, which are not
    equidistant.
    """
    known = np.unique(places[np.isfinite(places)])
    step = max(1, -(-known.size // ticks))
    axis.set_ticks(np.arange(known.size)[::step], _tick_labels(known[::step]))
    return np.searchsorted(known, places).astype(np.float64)


def _tick_labels(numbers: Array) -> list[str]:
    """Return numbers as text with the decimals that their range requires, or with two significant digits if some would
    be equal. Numbers that round to 0 are "0".
    """
    reach = float(np.ptp(numbers)) if numbers.size else 0.0
    decimals = max(0, 1 - math.floor(math.log10(reach))) if reach > 0.0 else 3
    rounded = [round(float(n), decimals) for n in numbers]
    if len(set(rounded)) < len(rounded):
        return [significant(float(n), 2) for n in numbers]
    return [fixed(n, decimals) if n else "0" for n in rounded]


def _foot(axes: Axes, text: str) -> None:
    axes.set_xlabel(text, loc="right", labelpad=1)


def _legend(axes: Axes) -> None:
    """Add the names of the lines at the foot of the figure."""
    axes.figure.legend(
        loc="lower left",
        bbox_to_anchor=(axes.get_position().x0 - 0.012, -0.015),
        ncols=6,
        frameon=False,
        fontsize=8,
        handlelength=1.3,
        columnspacing=1.0,
        borderpad=0.1,
    )


def _sized(drawing: str, width: float) -> str:
    """Return a drawing with a fixed size on the page, so that its font does not grow with the window."""
    return drawing.replace('class="plot"', f'class="plot" style="max-width:{6.04 * width:.1f}rem"', 1)


def _log_axis(axes: Axes, axis: str, shown: Sequence[float | None]) -> None:
    numbers = [n for n in shown if n]
    low, high = min([*numbers, 0.8]), max([*numbers, 2.0])
    axes.set_xscale("log")
    axes.set_xlim(0.9 * low, 1.2 * high)
    _plain_log(axes, axis)


def _plain_log(axes: Axes, axis: str) -> None:
    """Set the ticks of a logarithmic axis at 1, 2 and 5 (at decades only for a long axis), written as plain numbers."""
    from matplotlib.ticker import LogLocator, NullLocator

    which = axes.xaxis if axis == "x" else axes.yaxis
    low, high = sorted(axes.get_xlim() if axis == "x" else axes.get_ylim())
    few = high / max(low, 1e-300) < 300.0
    which.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    which.set_minor_locator(NullLocator())
