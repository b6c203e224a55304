"""Pictures of runs: the measured values of a plan, with their limits."""

import re
from collections.abc import Callable
from math import tau
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from astb_studies.gallery.drawing import LEGEND, SIDE, figure_of, save
from bench_protocol.units import bar, kN, mm
from bench_records.layout import Phase
from bench_records.plots import ALARM, INK, PALETTE, SHADE, heading, style
from bench_records.record import Record, read
from bench_records.result import Check, read_result
from test_plans.analysis import Samples
from test_plans.analysis.geometry import POSE_SIGNALS, shear_of
from test_plans.description import ours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: An order (amplitudes) reads best from dark to light.
ORDERED: Final = ("#2d1160", "#b5367a", "#f0944d")
CHAMBERS: Final = ("left.auxiliary_pressure", "right.auxiliary_pressure")


def stiffness(runs: Path, path: Path) -> None:
    """Loops over amplitude of one run, and its K' and K'' over frequency with limits."""
    directory = runs / "dynamic_stiffness"
    checks = read_result(directory).checks
    with style():
        figure, (loops, storage, loss) = figure_of(3.3, 1, 3, width_ratios=(1.1, 1.0, 1.0))
        _loops(loops, read(directory))
        _over_frequency(storage, checks, "K'", lambda _: 1.0)
        heading(storage, "Storage K' of a spring", "kN/m")
        _over_frequency(loss, checks, "c", lambda f: tau * f)
        heading(loss, "Loss K'' = c ω", "kN/m")
        save(figure, path)


def _loops(axes: "Axes", record: Record) -> None:
    phases = {phase.name.rpartition(", ")[2]: phase for phase in record.phases if "1 Hz, " in phase.name}
    table = record.frame(("left.height", "load_cell.1", "load_cell.2"), 200.0)
    for colour, (amplitude, phase) in zip(ORDERED, sorted(phases.items(), key=_size), strict=True):
        part = table[(table.index > phase.end - 2.2) & (table.index <= phase.end - 1.2)]
        x = -part["left.height"].to_numpy()
        f = (part["load_cell.1"] + part["load_cell.2"]).to_numpy()
        axes.plot((x - x.mean()) / mm, (f - f.mean()) / kN, color=colour, label=amplitude)
    axes.legend(**LEGEND)
    axes.set_xlabel("mm")
    heading(axes, "Left spring, 1 Hz", "kN")


def _size(named: tuple[str, Phase]) -> float:
    """Return the amplitude in the words of a phase, in mm."""
    return float(named[0].removesuffix(" mm"))


def _over_frequency(
    axes: "Axes", checks: list[Check], what: str, of: Callable[[Samples], Samples | float]
) -> None:
    found = [
        (float(m[1]), one)
        for one in checks
        if (m := re.fullmatch(rf"{re.escape(what)} at (\S+) Hz", one.name))
    ]
    f = np.array([frequency for frequency, _ in found])
    low, high, value, expanded = (
        of(f) * np.array([getattr(one, name) / one.scale for _, one in found])
        for name in ("low", "high", "number", "expanded")
    )
    axes.fill_between(f, low, high, color=SHADE, zorder=0)
    for limit in (low, high):
        axes.plot(f, limit, color=ALARM, linewidth=0.9)
    axes.errorbar(f, value, expanded, color=PALETTE[0], marker="o", markersize=3.5, capsize=2)
    axes.set_xscale("log")
    axes.set_xticks(f, [f"{one:g}" for one in f])
    axes.minorticks_off()
    axes.set_xlabel("Hz")
    axes.set_ylim(bottom=0)


def leveling(runs: Path, path: Path) -> None:
    """Pressures of both springs over time, from AW0 to AW3 and back."""
    record, checks = read(runs / "leveling"), {one.name: one for one in read_result(runs / "leveling").checks}
    with style():
        figure, panels = figure_of(3.2, 1, 2, sharey=True)
        for axes, verb, load in zip(panels, ("fill", "exhaust"), ("AW3", "AW0"), strict=True):
            phase = next(one for one in record.phases if one.name == f"{verb} to {load}")
            limit = checks[f"left valve, time to {verb} to {load}"].high or 0.0
            for side, look in SIDE.items():
                times, values = record.series(f"{side}.auxiliary_pressure")
                inside = (times > phase.start) & (times < phase.end)
                axes.plot(times[inside] - phase.start, values[inside] / bar, label=side, **look)
            axes.axvspan(0, limit, color=SHADE, zorder=0)
            axes.axvline(limit, color=ALARM, linewidth=1.1)
            place = (limit, 0.93)
            axes.annotate(
                f"at most {limit:g} s",
                place,
                (-4, 0),
                axes.get_xaxis_transform(),
                "offset points",
                color=ALARM,
                fontsize=8,
                ha="right",
            )
            axes.set_xlabel("s since the bolster went " + ("down" if verb == "fill" else "up"))
            axes.set_xlim(0, 1.05 * limit)
            axes.set_ylim(bottom=0)
            heading(axes, f"{verb.capitalize()} to {load}", "bar")
        panels[0].legend(**LEGEND, loc="lower right", bbox_to_anchor=(0.85, 0.1))
        save(figure, path)


def gust(runs: Path, path: Path) -> None:
    """Draw a gust, in which the differential pressure valve stays shut, and a roll that opens it."""
    blown, rolled = runs / "crosswind_gust", runs / "differential_pressure_valve"
    most = next(one for one in read_result(blown).checks if one.name == "largest displacement")
    opens = next(one for one in read_result(rolled).checks if one.name == "opens, left higher")
    with style():
        figure, ((way, first), (parted, second)) = figure_of(4.4, 2, 2, sharex="col", width_ratios=(1, 1.3))
        times, pose = _during(read(blown), "gust", *POSE_SIGNALS)
        y = shear_of(dict(zip(POSE_SIGNALS, pose, strict=True)), ours())
        way.plot(times, (y - y[0]) / mm, color=PALETTE[2])
        _limit(way, (most.high or 0.0) / mm, "at most")
        heading(way, "Gust: the springs, sideways", "mm")
        for axes, below, record, phase, title in (
            (None, parted, read(blown), "gust", "Gust: left less right"),
            (first, second, read(rolled), "left higher", "Rolled: left less right"),
        ):
            times, pressures = _during(record, phase, *CHAMBERS)
            if axes is not None:
                for (side, look), values in zip(SIDE.items(), pressures, strict=True):
                    axes.plot(times, values / bar, label=side, **look)
                axes.legend(**LEGEND)
                heading(axes, "Rolled until air crosses: the springs", "bar")
            below.plot(times, (pressures[0] - pressures[1]) / bar, color=INK, linewidth=1.0)
            below.axhspan((opens.low or 0.0) / bar, (opens.high or 0.0) / bar, color="#f6dedc", zorder=0)
            _limit(below, (opens.low or 0.0) / bar, "the valve opens")
            below.set_xlabel("s")
            below.margins(x=0.0)
            heading(below, title, "bar")
        save(figure, path)


def _during(record: Record, phase: str, *names: str) -> tuple[Samples, list[Samples]]:
    """Return the times since a phase began (s), and signals at them."""
    inside = next(one for one in record.phases if one.name == phase)
    table = record.frame(names, 20.0)
    table = table[(table.index > inside.start) & (table.index < inside.end)]
    return table.index.to_numpy() - inside.start, [table[name].to_numpy() for name in names]


def _limit(axes: "Axes", value: float, text: str) -> None:
    axes.axhline(value, color=ALARM, linewidth=1.1)
    axes.annotate(
        text,
        (0.01, value),
        (0, -3),
        axes.get_yaxis_transform(),
        "offset points",
        color=ALARM,
        fontsize=8,
        va="top",
    )
