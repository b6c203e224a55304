"""Figure 7: effective area and volume over lateral displacement."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

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
from astb_studies.paper.identification.area_and_volume import shape
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import litre, mm
from bench_records.plots import INK, PALETTE, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Quantity:
    """One panel: changes from the centre over the displacement, as shares; ``group`` is that of the bench's curve."""

    title: str
    symbol: str
    group: str
    fit: Floats
    fit_sigma: Floats
    plant: Floats
    paper: Floats


def figure_7(study: Study) -> "Figure":
    """Effective area and volume over lateral displacement: bench, fit with its interval, plant, paper's law."""
    figure, ((a, b),) = panels_of(2)
    fit = study.identified.area_and_volume
    y = np.linspace(-62, 62, 241) * mm
    reach = _reach(fit, "effective_area")
    for panel, letter, quantity in zip((a, b), "ab", _quantities(fit, y), strict=True):
        _draw_quantity(study, panel, quantity, y, reach)
        label_panel(
            panel,
            letter,
            quantity.title,
            "lateral displacement of the bellows, mm",
            f"change of {quantity.symbol} from the centre, %",
        )
    a.set_ylim(-3.4, 0.5)
    b.set_ylim(-4.0, 19.5)
    area, volume = fit["effective_area"], fit["bellows_volume"] / litre
    area_width, volume_width = (reach * fit.sigma(name) for name in ("effective_area", "bellows_volume"))
    a.text(0.03, 0.06, f"A₀ = {area:.4f} ± {area_width:.4f} m²", transform=a.transAxes, fontsize=8)
    told = f"V₀ = {volume:.2f} ± {volume_width / litre:.2f} litre"
    b.text(0.5, 0.93, told, transform=b.transAxes, fontsize=8, ha="center")
    add_legend(b, loc="upper center", bbox_to_anchor=(0.5, 0.86))
    add_key(
        figure,
        ("fit, with its 95 % interval", {"color": INK}),
        ("plant (what the fit should find)", {"color": PALETTE[2], "linestyle": DOTTED, "linewidth": 1.6}),
        ("paper's law (8), assumed α, β", {"color": SOFT, "linestyle": DASHED}),
    )
    return figure


def _quantities(fit: Any, y: Floats) -> tuple[_Quantity, _Quantity]:
    """Area and volume at lateral displacements (m)."""
    plant, paper = Subject().parameters("AW0").record, Subject().spring("AW0")
    Y = shape(y, float(plant.membrane_travel[0]))
    A_0, V_0 = fit["effective_area"], fit["bellows_volume"]
    k_0, k_1 = fit["membrane_length"], fit["membrane_length_slope"]
    return (
        _Quantity(
            "Effective area",
            "A",
            "Effective area",
            -0.5 * k_1 * Y / A_0,
            _sigma(fit, {"membrane_length_slope": -0.5 * Y / A_0, "effective_area": 0.5 * k_1 * Y / A_0**2}),
            -0.5 * float(plant.membrane_length_slope[0]) * Y / float(plant.effective_area[0]),
            np.asarray(lateral_area(y, paper)) / paper.lateral_area - 1.0,
        ),
        _Quantity(
            "Equivalent volume",
            "V",
            "Volume",
            -0.5 * k_0 * Y / V_0,
            _sigma(fit, {"membrane_length": -0.5 * Y / V_0, "bellows_volume": 0.5 * k_0 * Y / V_0**2}),
            -0.5 * float(plant.membrane_length[0]) * Y / float(plant.bellows_volume[0]),
            np.asarray(equivalent_volume(y, paper)) / paper.bellows_volume - 1.0,
        ),
    )


def _draw_quantity(study: Study, panel: "Axes", one: _Quantity, y: Floats, reach: float) -> None:
    """Draw curves and points, in per cent; the band reaches ``reach`` standard deviations."""
    panel.fill_between(
        y / mm,
        100 * (one.fit - reach * one.fit_sigma),
        100 * (one.fit + reach * one.fit_sigma),
        color="#b9c4cc",
        linewidth=0,
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


def _reach(fit: Any, name: str) -> float:
    """Return half the width of the 95 % interval of a fitted value, in its standard deviations."""
    low, high = fit.interval(name)
    return float(0.5 * (high - low) / fit.sigma(name))


def _sigma(fit: Any, gradient: dict[str, Floats]) -> Floats:
    """Standard deviation of a function of fitted values out of its gradient."""
    places = [fit.names.index(name) for name in gradient]
    G = np.array(list(gradient.values()))
    return np.sqrt(np.einsum("in,ij,jn->n", G, fit.covariance[np.ix_(places, places)], G))
