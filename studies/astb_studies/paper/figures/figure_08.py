"""Figure 8: model against experiment, and other causes that look like the damping of rubber."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.figures.bench_curves import damping_points, lateral_points
from astb_studies.paper.figures.style import (
    DASHDOT,
    DASHED,
    DOTTED,
    KN_M,
    MEASURED,
    ORDERED,
    PLANT_MODEL,
    add_key,
    add_legend,
    draw_line,
    draw_points,
    label_panel,
    panels_of,
    plain_log_ticks,
)
from astb_studies.paper.laws import closed_stiffness, fitted_lateral_area
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.arrays import Floats
from bench_protocol.units import bar, mm
from bench_records.plots import INK, PALETTE, SOFT
from test_plans.steps.fittings import PLATE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: What would make the bench's damping larger than that of the orifice, in the key's order.
LOOKALIKES: Final = (
    ("rubber", "rubber and friction of the shell", PALETTE[2], "solid"),
    ("lag", "5 ms between force and displacement", PALETTE[3], DASHED),
    ("coefficient", "discharge coefficient believed 5 % too large", PALETTE[5], DOTTED),
)


def figure_8(study: Study) -> "Figure":
    """Model against bench; below, possible causes of the deviation of damping, and the run that distinguishes them."""
    figure, (top, below) = panels_of(3, 2)
    _model_against_bench(study, top)
    _lookalikes(study, below)
    add_key(
        figure,
        MEASURED,
        PLANT_MODEL,
        ("the same without rubber", {"linestyle": DOTTED, "linewidth": 1.5}),
        ("model, wind and track at once", {"linestyle": DASHDOT}),
        ("paper's (10), its area fitted", {"linestyle": DASHED, "color": SOFT}),
        *(
            (label, {"color": colour, "linestyle": dash, "linewidth": 1.5})
            for _, label, colour, dash in LOOKALIKES
        ),
        columns=4,
    )
    return figure


def _model_against_bench(study: Study, top: Any) -> None:
    """Draw (a) to (c): lateral stiffness and vertical damping, measured on the first rig and computed."""
    area = fitted_lateral_area(study.bench)
    for letter, load, panel in zip("ab", LOADS, top, strict=False):
        lateral_points(study, panel, load, first=True)
        p = study.bench.lateral_stiffness(load, 5 * mm, first=True).x
        for row, colour in zip(study.model[f"lateral {load}"]["K"], ORDERED, strict=False):
            draw_line(panel, p / bar, row.real / KN_M, colour)
        at_once = study.model[f"at once {load}"]
        draw_line(panel, at_once["p"] / bar, at_once["K"] / KN_M, INK, DASHDOT)
        draw_line(panel, p / bar, closed_stiffness(load, p, lateral_area=area) / KN_M, SOFT, DASHED)
        label_panel(panel, letter, f"Lateral stiffness, {load}", "pressure (gauge), bar", "K′, kN/m")
        add_legend(panel, title="amplitude", title_fontsize=7.5, loc="lower right", ncols=3)
        low, high = panel.get_ylim()
        panel.set_ylim(low - 0.22 * (high - low), high)
    damping_points(study, top[2], first=True)
    for d, colour in zip(PLATES, ORDERED, strict=True):
        model = study.model[f"damping {d / mm:g} mm"]
        for quantity, dash in (("K", "solid"), ("orifice", DOTTED)):
            c = model[quantity].imag / (2 * np.pi * NATURAL)
            draw_line(
                top[2], model["ratio"], c / KN_M, colour, dash, linewidth=1.25 if quantity == "K" else 1.5
            )
    label_panel(
        top[2], "c", "Vertical damping, AW0, 1.2 Hz", "pressure ratio across the orifice", "c, kN·s/m"
    )
    top[2].set_ylim(0, 44)
    add_legend(top[2], title="orifice", title_fontsize=7.5, loc="lower left", ncols=2)


def _lookalikes(study: Study, below: Any) -> None:
    """Draw (d) to (f): three causes of more damping than the orifice's, and the experiments that distinguish them ."""
    shown = study.model["confusable"]
    for panel, over, x, unit in ((below[0], "f", shown["f"], 1.0), (below[1], "a", shown["a"], mm)):
        reference = shown[f"orifice over {over}"].imag
        for name, label, colour, dash in LOOKALIKES:
            more = 100 * (shown[f"{name} over {over}"].imag / reference - 1.0)
            draw_line(panel, x / unit, more, colour, dash, label=label, linewidth=1.5)
        panel.axhline(0.0, color=SOFT, linewidth=0.7)
        panel.set_xscale("log")
        panel.set_ylim(-8, 34)
    sweep = study.bench.points(
        "frequency_sweep_aw0", "Vertical damping c per spring", "AW0, orifice", first=True
    )
    model = study.model["vertical AW0, orifice"]
    _excess(below[0], sweep, model["f"], 1.0, model["orifice"].imag / (2 * np.pi * model["f"]))
    ratio = study.bench.points(
        "damping_ratio", "Vertical damping c over amplitude, AW0", f"{PLATE / mm:g} mm", first=True
    )
    model = study.model[f"damping {PLATE / mm:g} mm"]
    _excess(below[1], ratio, ratio.x, mm, model["orifice"].imag / (2 * np.pi * NATURAL))
    below[0].axvline(NATURAL, color=SOFT, linewidth=0.7, linestyle=DOTTED)
    below[0].annotate("1.2 Hz", (NATURAL, -6.6), (3, 0), textcoords="offset points", fontsize=7.5, color=SOFT)
    label_panel(
        below[0], "d", "Damping above the orifice's, 5 mm", "frequency, Hz", "more than the orifice alone, %"
    )
    label_panel(below[1], "e", "The same at 1.2 Hz", "amplitude, mm", "")
    for name, _, colour, dash in LOOKALIKES:
        draw_line(below[2], shown["f"], shown[f"{name} left"].imag / KN_M, colour, dash, linewidth=1.5)
    below[2].set_xscale("log")
    below[2].set_ylim(-5, 60)
    measured = study.bench.loss_without_gas(study.fitted["effective_area"])
    draw_points(below[2], measured[measured.x <= 10.5], 1.0, KN_M, INK, "o")
    label_panel(below[2], "f", "Loss in F − p·A, 5 mm: no gas in it", "frequency, Hz", "K″, kN/m")
    for panel in (below[0], below[2]):
        plain_log_ticks(panel, (0.3, 1, 3, 10))
    plain_log_ticks(below[1], (1, 2, 5, 10, 20))


def _excess(panel: "Axes", one: Points, x: Floats, unit: float, reference: Floats) -> None:
    """Draw the bench's damping as the excess over that of the orifice alone, in per cent."""
    shown = (x >= 0.29) & (x <= 10.5) if unit == 1.0 else np.full(x.shape, True)
    more = Points(x, *(100 * (values / reference - 1.0) for values in (one.y, one.low, one.high)))
    draw_points(panel, more[shown], unit, 1.0, INK, "o")
