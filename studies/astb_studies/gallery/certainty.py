"""Guard bands: the probability of conformity near the limits, and the positions of a run's values in their bands."""

from pathlib import Path
from typing import Final

import numpy as np

from astb_studies.gallery.drawing import figure_of, save
from bench_records.conformity import SURE, conformity, guard_factor
from bench_records.plots import ALARM, INK, PALETTE, SHADE, SOFT, heading, style
from bench_records.result import read_result

#: A band from -1 to 1, and a standard uncertainty for which the guard bands can be seen.
U: Final = 0.12
ROWS: Final = 14
GUARD: Final = "#f3dfb4"


def certainty(runs: Path, path: Path) -> None:
    """The closed form above, checks of a run below, each scaled to its own band."""
    checks = [
        one
        for one in read_result(runs / "dynamic_stiffness").checks
        if one.u and one.low is not None and one.high is not None
    ]
    checks = sorted(checks, key=lambda one: -one.guard / (one.high - one.low))[:ROWS]
    with style():
        figure, (law, values) = figure_of(5.4, 2, 1, sharex=True, height_ratios=(1, 1.25))
        _law(law)
        for row, one in enumerate(checks):
            middle, half = 0.5 * (one.low + one.high), 0.5 * (one.high - one.low)
            guard = one.guard / half
            for edge in (-1.0, 1.0):
                values.barh(row, -edge * guard, left=edge, height=0.8, color=GUARD)
            values.errorbar(
                (one.number - middle) / half,
                row,
                xerr=one.expanded / half,
                fmt="o",
                color=PALETTE[0],
                markersize=4,
                capsize=2,
            )
        values.set_yticks(range(len(checks)), [one.name for one in checks], color=INK, fontsize=7.5)
        values.invert_yaxis()
        values.grid(visible=False, axis="y")
        for axes in (law, values):
            for edge in (-1.0, 1.0):
                axes.axvline(edge, color=ALARM, linewidth=1.1)
        values.set_xticks((-1, 0, 1), ("lower limit", "middle", "upper limit"), color=INK)
        heading(values, "Checks of one run, each in its own band", "expanded uncertainty, guard band")
        save(figure, path)


def _law(axes: "object") -> None:
    x = np.linspace(-1.45, 1.45, 400)
    guard = guard_factor(0.0) * U
    axes.axvspan(-1 + guard, 1 - guard, color=SHADE, zorder=0)
    for side in (-1, 1):
        axes.axvspan(side, side * (1 - guard), color=GUARD, zorder=0)
        axes.text(
            side * (1 - guard / 2),
            45,
            "marginal",
            ha="center",
            va="center",
            color=INK,
            fontsize=8,
            rotation=90,
        )
        axes.text(side * 1.3, 45, "fail", ha="center", color=ALARM, fontsize=9)
    axes.text(0.0, 45, "pass", ha="center", color=INK, fontsize=9)
    axes.plot(x, [100 * conformity(value, U, -1.0, 1.0) for value in x], color=PALETTE[0])
    axes.axhline(100 * SURE, color=SOFT, linewidth=0.8, dashes=(2, 1.5))
    axes.text(-1.43, 100 * SURE - 2, f"{100 * SURE:g} %", color=SOFT, fontsize=8, va="top")
    heading(axes, "How surely a value conforms, for one uncertainty", "%")
