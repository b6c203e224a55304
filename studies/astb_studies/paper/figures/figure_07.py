"""Figure 7: effective area and volume over lateral displacement."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.closed_form import equivalent_volume, lateral_area
from astb_studies.paper.figures.style import (
    COLOUR,
    DASHED,
    DOTTED,
    MARKER,
    add_key,
    add_legend,
    draw_line,
    draw_points,
    label_panel,
    panels_of,
)
from astb_studies.paper.identified import SHAPE, Identified, changes
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.arrays import Floats
from bench_protocol.units import litre, mm
from bench_records.plots import INK, PALETTE, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class _Quantity:
    """One panel: changes from the centre over the displacement, as shares; ``group`` is that of the bench's curve."""

    title: str
    symbol: str
    group: str
    fit: Floats
    width: Floats  #: half the width of the 95 % interval
    plant: Floats
    paper: Floats


def figure_7(study: Study) -> "Figure":
    """Effective area and volume over lateral displacement: bench, fit with its interval, plant, paper's law."""
    figure, ((a, b),) = panels_of(2)
    y = np.linspace(-62, 62, 241) * mm
    for panel, letter, quantity in zip((a, b), "ab", _quantities(study.identified, y), strict=True):
        _draw_quantity(study, panel, quantity, y)
        label_panel(
            panel,
            letter,
            quantity.title,
            "lateral displacement of the bellows, mm",
            f"change of {quantity.symbol} from the centre, %",
        )
    a.set_ylim(-3.4, 0.5)
    b.set_ylim(-4.0, 19.5)
    area, volume = (study.identified.parameters[name] for name in ("effective_area", "bellows_volume"))
    text = f"A₀ = {area.value:.5f} ± {area.high - area.value:.5f} m²"
    a.text(0.03, 0.06, text, transform=a.transAxes, fontsize=8)
    text = f"V₀ = {volume.value / litre:.2f} ± {(volume.high - volume.value) / litre:.2f} litre"
    b.text(0.5, 0.93, text, transform=b.transAxes, fontsize=8, ha="center")
    add_legend(b, loc="upper center", bbox_to_anchor=(0.5, 0.86))
    add_key(
        figure,
        ("fit, with its 95 % interval", {"color": INK}),
        ("plant (what the fit should find)", {"color": PALETTE[2], "linestyle": DOTTED, "linewidth": 1.6}),
        ("paper's law (8), assumed α, β", {"color": SOFT, "linestyle": DASHED}),
    )
    return figure


def _quantities(identified: Identified, y: Floats) -> tuple[_Quantity, _Quantity]:
    """Area and volume at lateral displacements (m)."""
    plant, paper = Subject().parameters("AW0").record, Subject().spring("AW0")
    geometry = np.array([float(plant[name][0]) for name in SHAPE])
    fits, widths = identified.changes(y)
    true_area, true_volume = changes(geometry, y)
    laws = (
        np.asarray(lateral_area(y, paper)) / paper.lateral_area - 1.0,
        np.asarray(equivalent_volume(y, paper)) / paper.bellows_volume - 1.0,
    )
    return (
        _Quantity("Effective area", "A", "Effective area", fits[0], widths[0], true_area, laws[0]),
        _Quantity("Equivalent volume", "V", "Volume", fits[1], widths[1], true_volume, laws[1]),
    )


def _draw_quantity(study: Study, panel: "Axes", one: _Quantity, y: Floats) -> None:
    """Draw curves and points, in per cent."""
    panel.fill_between(
        y / mm, 100 * (one.fit - one.width), 100 * (one.fit + one.width), color="#b9c4cc", linewidth=0
    )
    draw_line(panel, y / mm, 100 * one.fit, INK)
    draw_line(panel, y / mm, 100 * one.plant, PALETTE[2], DOTTED, linewidth=1.6)
    draw_line(panel, y / mm, 100 * one.paper, SOFT, DASHED)
    for load in LOADS:
        measured = study.bench.points("lateral_offset", one.group, load)
        centre = measured.y[np.abs(measured.x) < 3 * mm].mean()
        change = 100 * (measured.y / centre - 1)
        points = Points(measured.x, change, change, change)
        draw_points(panel, points, mm, 1.0, COLOUR[load], MARKER[load], label=f"bench, {load}")
