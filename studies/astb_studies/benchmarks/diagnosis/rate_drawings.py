"""The drawings of the page of rates: confusion, power over λ, and coverage of the intervals."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from astb_studies.benchmarks.diagnosis.judge import LEVELS, Judged, covered
from astb_studies.benchmarks.diagnosis.statistics import Rate
from bench_records.plots import INK, PALETTE, SOFT, plain_numbers, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Edges of the classes of λ.
EDGES: Final = (4.0, 6.0, 10.0, 20.0, 50.0, 150.0, 500.0, 4000.0)
LAMBDA_TICKS: Final = (5, 10, 20, 50, 100, 200, 500, 1000)
#: A point over λ represents at least so many cases.
LEAST_POINT: Final = 10
NOTHING, OPEN, SHAPE = "no effect", "unresolved", "unknown"


def confusion(path: Path, judged: Sequence[Judged]) -> None:
    """Hidden effects (rows; for the bench, families of causes) against the findings (columns)."""
    single = [j for j in judged if len(j.hidden) <= 1]
    rows = sorted({_family(j.hidden) for j in single}, key=lambda name: (name == NOTHING, name))
    content = {name: [_named_cause(j) for j in single if _family(j.hidden) == name] for name in rows}
    extra = sorted({word for words in content.values() for word in words} - {*rows, NOTHING, OPEN, SHAPE})
    columns = [*(row for row in rows if row != NOTHING), *extra, OPEN, SHAPE, NOTHING]
    shares = np.zeros((len(rows), len(columns)))
    for i, row in enumerate(rows):
        for word in content[row]:
            shares[i, columns.index(word)] += 1.0 / len(content[row])
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(1.9 + 0.30 * len(columns), 1.7 + 0.24 * len(rows)), layout="constrained")
        axes = figure.subplots()
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(rows)), [f"{row}  ({len(content[row])})" for row in rows])
        axes.grid(visible=False)
        axes.tick_params(length=0)
        for i, j in zip(*np.nonzero(shares), strict=True):
            colour = "white" if shares[i, j] > 0.55 else INK
            axes.text(j, i, f"{100 * shares[i, j]:.0f}", ha="center", va="center", color=colour, fontsize=6.5)
        axes.set_xlabel("first cause of the finding, % of the row")
        axes.set_ylabel("hidden effect (cases)")
        save(figure, path)


def power(path: Path, judged: Sequence[Judged]) -> None:
    """Rates over λ of single effects: detected, included in the finding, named exactly."""
    single = [j for j in judged if j.kind == "single"]
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 3.4), layout="constrained")
        axes = figure.subplots()
        series = (
            ("detected", lambda j: j.detected, "o", PALETTE[4]),
            ("reported", lambda j: j.reported, "s", PALETTE[2]),
            ("named exactly", lambda j: j.exact, "D", PALETTE[0]),
        )
        for k, (label, hit, marker, colour) in enumerate(series):
            places, rates = [], []
            for low, high in pairwise(EDGES):
                inside = [j for j in single if low <= j.weakest < high]
                if len(inside) >= LEAST_POINT:
                    places.append(np.sqrt(low * high) * 1.05 ** (k - 1))
                    rates.append(Rate.of([hit(j) for j in inside]))
            values = np.array([rate.value for rate in rates])
            ends = np.array([rate.interval for rate in rates]).reshape(-1, 2).T
            axes.errorbar(
                places,
                values,
                np.abs(ends - values) if places else None,
                label=label,
                color=colour,
                marker=marker,
                markersize=4.5,
                linewidth=1.1,
                elinewidth=0.8,
                capsize=2,
            )
        axes.set_xscale("log")
        axes.set_xticks(LAMBDA_TICKS, [f"{one:g}" for one in LAMBDA_TICKS])
        axes.set_xticks((), minor=True)
        axes.set_xlabel("λ of the hidden effect")
        axes.set_ylabel("share of the cases, with 95 % interval")
        axes.set_ylim(-0.03, 1.03)
        axes.legend(frameon=False, loc="lower right", labelcolor=SOFT)
        save(figure, path)


def reliability(path: Path, judged: Sequence[Judged]) -> None:
    """Coverage of intervals against their nominal level: amplitudes, and the parameters of the base model."""
    named = [j for j in judged if j.exact and j.hidden]
    series = (
        ("amplitudes", [d for j in named for d in j.deviations], "o", PALETTE[0]),
        ("parameters of the base model", [d for j in named for d in j.base], "s", PALETTE[1]),
    )
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(3.9, 3.6), layout="constrained")
        axes = figure.subplots()
        axes.plot((0.45, 1.0), (0.45, 1.0), color=SOFT, linewidth=0.8, linestyle=(0, (4, 2)))
        for k, (label, deviations, marker, colour) in enumerate(series):
            if deviations:
                rates = [Rate(covered(deviations, level), len(deviations)) for level in LEVELS]
                values = np.array([rate.value for rate in rates])
                ends = np.array([rate.interval for rate in rates]).T
                axes.errorbar(
                    np.array(LEVELS) + 0.006 * (2 * k - 1),
                    values,
                    np.abs(ends - values),
                    label=f"{label} ({len(deviations)})",
                    color=colour,
                    marker=marker,
                    markersize=4.5,
                    linewidth=1.0,
                    elinewidth=0.8,
                    capsize=2,
                )
        axes.set_xlabel("level of the interval")
        axes.set_ylabel("share of intervals that contain the truth")
        axes.legend(frameon=False, loc="lower right", labelcolor=SOFT)
        save(figure, path)


def _family(names: Sequence[str]) -> str:
    return names[0].partition(".")[0] if names else NOTHING


def _named_cause(judged: Judged) -> str:
    """The first cause, the right one if it is among them; else the verdict."""
    for name in judged.causes:
        if name in judged.hidden:
            return _family([name])
    if judged.causes:
        return _family(judged.causes)
    return judged.verdict


def save(figure: "Figure", path: Path) -> None:
    """Write a drawing whose bytes depend only on its content."""
    path.parent.mkdir(parents=True, exist_ok=True)
    plain_numbers(figure)
    figure.savefig(path, format="svg", metadata={"Date": None}, facecolor="white")
