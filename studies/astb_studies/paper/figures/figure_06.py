"""Figure 6: what the bench measures, lateral stiffness over pressure and damping over the pressure ratio."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.closed_form import orifice_damping
from astb_studies.paper.figures.bench_curves import damping_points, lateral_points
from astb_studies.paper.figures.style import (
    DASHED,
    KN_M,
    MEASURED,
    ORDERED,
    add_key,
    add_legend,
    draw_line,
    label_panel,
    panels_of,
)
from astb_studies.paper.laws import closed_stiffness
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.units import bar, mm
from bench_records.plots import SOFT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_6(study: Study) -> "Figure":
    """Bench results: lateral stiffness over pressure, damping over the pressure ratio."""
    figure, (axes,) = panels_of(3)
    for letter, load, panel in zip("ab", LOADS, axes, strict=False):
        lateral_points(study, panel, load)
        p = np.linspace(*_span(study, load), 50)
        draw_line(panel, p / bar, closed_stiffness(load, p) / KN_M, SOFT, DASHED)
        label_panel(panel, letter, f"Lateral stiffness, {load}", "pressure (gauge), bar", "K′, kN/m")
        panel.set_ylim(bottom=0)
        add_legend(panel, title="amplitude", title_fontsize=7.5, loc="lower right", ncols=3)
    damping_points(study, axes[2])
    par = Subject().spring("AW0")
    r = np.linspace(0.77, 0.9995, 400)
    for d, colour in zip(PLATES, ORDERED, strict=True):
        c = orifice_damping(2 * np.pi * NATURAL, r, d, par.pressure, par)
        draw_line(axes[2], r, np.asarray(c) / KN_M, colour, DASHED, linewidth=0.9)
    label_panel(
        axes[2], "c", "Vertical damping, AW0, 1.2 Hz", "pressure ratio across the orifice", "c, kN·s/m"
    )
    axes[2].set_ylim(0, 52)
    add_legend(axes[2], title="orifice", title_fontsize=7.5, loc="lower left", ncols=2)
    add_key(
        figure,
        MEASURED,
        (
            "paper's closed form: (10) with (16) in series; (19) at the ratio at which it is linearised",
            {"linestyle": DASHED},
        ),
    )
    return figure


def _span(study: Study, load: str) -> tuple[float, float]:
    p = study.bench.lateral_stiffness(load, 5 * mm).x
    return float(p.min()), float(p.max())
