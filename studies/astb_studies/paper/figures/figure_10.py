"""Figure 10: lateral stiffness over the roll angle."""

from typing import TYPE_CHECKING

import numpy as np

from astb_studies.paper.closed_form import roll_factor
from astb_studies.paper.figures.bench_curves import at_once
from astb_studies.paper.figures.style import (
    COLOUR,
    DASHED,
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
from astb_studies.paper.laws import closed_secant
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from bench_protocol.units import bar, mm
from bench_records.plots import INK, SOFT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_10(study: Study) -> "Figure":
    """Lateral stiffness over the roll angle, both signs, differential pressure valve open and isolated."""
    figure, axes = panels_of(2, 2, height=2.5, sharex="col", gridspec_kw={"height_ratios": (2.6, 1)})
    for letter, load, panel, pressures in zip("ab", LOADS, *axes, strict=True):
        plan, colour = f"roll_angle_{load.lower()}", COLOUR[load]
        for valve, hollow in (("isolated", False), ("open", True)):
            name = f"{load}, valve {valve}"
            secants = study.bench.points(plan, "Lateral secant F/y at +20 mm per spring", name)
            draw_points(
                panel, secants, 1.0, KN_M, colour, MARKER[load], hollow=hollow, label=f"secant, valve {valve}"
            )
            apart = study.bench.points(plan, "Pressure left less right", name)
            draw_points(pressures, apart, 1.0, bar, colour, MARKER[load], hollow=hollow, size=3.6)
        harmonic = study.bench.points(
            plan, "Lateral stiffness K' of 5 mm about +20 mm per spring", f"{load}, valve isolated"
        )
        draw_points(panel, harmonic, 1.0, KN_M, SOFT, "^", label="first harmonic, 5 mm", size=4.0)
        at_once(study, panel, load, "roll")
        model = study.model[f"roll {load}"]
        draw_line(panel, model["roll"], model["secant"] / KN_M, colour)
        draw_line(panel, model["roll"], model["K"].real / KN_M, SOFT)
        phi = np.linspace(model["roll"].min(), model["roll"].max(), 200)
        par = Subject().spring(load)
        even = closed_secant(load, np.array(20 * mm)) * np.asarray(roll_factor(phi, par))
        draw_line(panel, phi, even / KN_M, INK, DASHED)
        label_panel(panel, letter, f"Lateral stiffness, {load}, y = +20 mm", "", "kN/m")
        panel.set_ylim(0, None)
        panel.set_ylim(0, 1.28 * panel.get_ylim()[1])
        add_legend(panel, loc="upper left", ncols=2)
        pressures.set_xlabel("roll angle, rad (φ·y > 0 on the right)")
        pressures.set_ylabel("left − right, bar")
    add_key(
        figure,
        ("bench: valve isolated, or (hollow) open", MEASURED[1]),
        PLANT_MODEL,
        ("paper's even law", {"linestyle": DASHED}),
    )
    return figure
