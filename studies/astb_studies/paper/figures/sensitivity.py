"""Global sensitivity of the geometric parameters in both layers."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.figures.style import add_key, panels_of
from astb_studies.paper.sensitivity import PAPER, PLANT
from astb_studies.paper.study import Study
from bench_records.plots import INK, PALETTE, SOFT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def sensitivity(study: Study) -> "Figure":
    """Total and first-order Sobol indices of the geometric parameters in both layers."""
    figure, axes = panels_of(4, 2, height=2.75)
    for row, (layer, names) in zip(axes, (("paper", PAPER), ("plant", PLANT)), strict=True):
        found = study.sensitivity[layer]
        places = np.arange(len(found.parameters))
        for k, panel in enumerate(row):
            if k >= len(found.outputs):
                panel.set_axis_off()
                continue
            colour = PALETTE[0] if layer == "plant" else SOFT
            reach = np.vstack([found.total[k] - found.total_low[k], found.total_high[k] - found.total[k]])
            panel.barh(
                places,
                found.total[k],
                xerr=np.maximum(reach, 0.0),
                height=0.62,
                color=colour,
                alpha=0.75,
                linewidth=0,
                error_kw={"elinewidth": 0.9, "ecolor": INK},
            )
            panel.plot(found.first[k], places, linestyle="none", marker="D", markersize=3.6, color=INK)
            panel.set_yticks(places, [names[name] for name in found.parameters] if k == 0 else [])
            panel.invert_yaxis()
            panel.set_xlim(0, 1.12)
            panel.set_title(f"{layer}: {found.outputs[k]}", loc="left", fontsize=8.5, fontweight="bold")
            panel.grid(visible=False, axis="y")
    add_key(
        figure,
        ("total index, with 95 % interval", {"linewidth": 7, "color": SOFT, "alpha": 0.75}),
        ("first order", {"linestyle": "none", "marker": "D", "markersize": 4}),
    )
    return figure
