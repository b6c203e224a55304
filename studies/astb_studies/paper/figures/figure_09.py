"""Figure 9: lateral stiffness over lateral displacement."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.figures.style import (
    COLOUR,
    DASHED,
    DOTTED,
    KN_M,
    MARKER,
    MEASURED,
    PLANT_MODEL,
    add_key,
    add_legend,
    draw_line,
    draw_points,
    label_panel,
    panels_of,
)
from astb_studies.paper.laws import closed_secant, closed_tangent
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS
from bench_protocol.units import mm

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_9(study: Study) -> "Figure":
    """Lateral stiffness over lateral displacement: the secant of the paper, and the tangent that it hides."""
    figure, ((a, b),) = panels_of(2)
    for load in LOADS:
        model, colour = study.model[f"offset {load}"], COLOUR[load]
        y = model["y"]
        secants = study.bench.points("lateral_offset", "Lateral secant stiffness per spring", load)
        draw_points(a, secants, mm, KN_M, colour, MARKER[load], label=load)
        draw_line(a, model["sizes"] / mm, model["stairs"] / KN_M, colour)
        draw_line(a, y / mm, model["secant"] / KN_M, colour, DOTTED, linewidth=1.5)
        draw_line(a, y / mm, closed_secant(load, y) / KN_M, colour, DASHED)
        tangents = study.bench.points("lateral_offset", "Lateral stiffness K' of 1 mm per spring", load)
        folded = Points(np.abs(tangents.x), tangents.y, tangents.low, tangents.high)
        draw_points(b, folded, mm, KN_M, colour, MARKER[load], label=load)
        draw_line(b, y / mm, model["tangent"].real / KN_M, colour)
        draw_line(b, y / mm, closed_tangent(load, y) / KN_M, colour, DASHED)
    label_panel(a, "a", "Secant F/y", "lateral displacement, mm", "secant stiffness, kN/m")
    label_panel(b, "b", "Small motion (1 mm, 2 Hz) about the offset", "lateral displacement, mm", "K′, kN/m")
    for panel in (a, b):
        panel.set_ylim(0, None)
        add_legend(panel, loc="lower left", ncols=2)
    add_key(
        figure,
        MEASURED,
        PLANT_MODEL,
        ("the same without friction", {"linestyle": DOTTED, "linewidth": 1.5}),
        ("paper's (10), (16) in series", {"linestyle": DASHED}),
    )
    return figure
