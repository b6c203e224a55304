"""The paper's table as a picture: acceleration and comfort index over the wind speed."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.figures.style import (
    COLOUR,
    DASHED,
    MARKER,
    add_key,
    add_legend,
    draw_line,
    draw_points,
    label_panel,
    panels_of,
)
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS
from bench_records.plots import SHADE, SOFT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Layer of a ride, its line, and whether its points are hollow.
_LINES = (("plant", "solid", False), ("no anti-roll bar", "dotted", True), ("paper", DASHED, True))


def comfort(study: Study) -> "Figure":
    """The table as a picture: acceleration and comfort index over the wind speed."""
    figure, ((a, b),) = panels_of(2)
    for panel, value, width in ((a, "acceleration", "acceleration_width"), (b, "comfort", "comfort_width")):
        for layer, dash, hollow in _LINES:
            for load in LOADS:
                rows = [one for one in study.rides if (one.layer, one.load) == (layer, load)]
                x = np.array([one.wind_speed for one in rows])
                y = np.array([getattr(one, value) for one in rows])
                reach = np.nan_to_num(np.array([getattr(one, width) for one in rows]))
                draw_line(panel, x, y, COLOUR[load], dash)
                draw_points(
                    panel,
                    Points(x, y, y - reach, y + reach),
                    1.0,
                    1.0,
                    COLOUR[load],
                    MARKER[load],
                    hollow=hollow,
                    label=f"{load}, {layer}" if layer in ("plant", "paper") else "",
                )
        panel.set_xticks((10, 15, 20, 25))
        panel.set_ylim(0, None)
    label_panel(a, "a", "Lateral acceleration of the floor, rms", "mean wind speed, m/s", "m/s²")
    label_panel(b, "b", "Comfort index N", "mean wind speed, m/s", "N")
    b.axhspan(0, 1, color=SHADE, zorder=0)
    b.text(10, 0.94, "N < 1: very good", fontsize=7.5, color=SOFT, va="top")
    b.set_ylim(0, 1.65)
    for panel in (a, b):
        add_legend(panel, loc="lower right", ncols=2)
    add_key(
        figure,
        ("car on the plant's springs", {}),
        ("the same, no anti-roll bar", {"linestyle": "dotted"}),
        ("the paper's equation (28)", {"linestyle": DASHED}),
    )
    return figure
