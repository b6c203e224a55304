"""Figure 5: track excitation over time."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.closed_form import unilateral_cosine
from astb_studies.paper.figures.style import (
    DASHED,
    MEASURED,
    ORDERED,
    add_key,
    add_legend,
    draw_line,
    label_panel,
    panels_of,
)
from astb_studies.paper.study import Study
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.units import mm
from bench_records.plots import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_5(study: Study) -> "Figure":
    """Track excitation (24) over time: by amplitude, and by angular frequency."""
    figure, ((a, b),) = panels_of(2, sharey=True)
    t = np.linspace(0.0, 2.5, 600)
    for amplitude, colour in zip((2.5, 5.0, 7.5, 10.0), ORDERED, strict=True):
        z = unilateral_cosine(t, amplitude * mm, 2 * np.pi * NATURAL, 3)
        draw_line(a, t, np.asarray(z) / mm, colour, DASHED, label=f"{amplitude:g} mm")
    times, platform = study.bench.track
    a.plot(
        times,
        platform / mm,
        color=INK,
        linestyle="none",
        marker="o",
        markersize=2.6,
        markevery=2,
        label="platform, 5 mm",
        zorder=3,
    )
    label_panel(a, "a", "By amplitude, at 1.2 Hz", "time, s", "displacement, mm")
    for f, colour in zip((0.6, 1.2, 2.4), ORDERED, strict=False):
        z = unilateral_cosine(t, 5 * mm, 2 * np.pi * f, 2)
        draw_line(b, t, np.asarray(z) / mm, colour, DASHED, label=f"{2 * np.pi * f:.1f} rad/s ({f:g} Hz)")
    label_panel(b, "b", "By angular frequency, 5 mm, two waves", "time, s", "")
    a.set_ylim(-0.4, 12.8)
    for axes in (a, b):
        add_legend(axes, loc="upper right", ncols=2 if axes is a else 1)
    add_key(
        figure,
        ("equation (24)", {"linestyle": DASHED}),
        ("platform of the bench, as its transducer reports", MEASURED[1]),
    )
    return figure
