"""Figure 11: stiffness and damping over frequency."""

from typing import TYPE_CHECKING, Any

import numpy as np

from astb_studies.paper.closed_form import amplitude_damping, dynamic_stiffness
from astb_studies.paper.combined import DAMPING
from astb_studies.paper.figures.bench_curves import at_once
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
    plain_log_ticks,
)
from astb_studies.paper.laws import SMALL_LOSS
from astb_studies.paper.model_jobs import SWEEPS
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.sweeps.frequency import SWEEP_AMPLITUDE
from bench_protocol.arrays import Floats
from bench_protocol.units import mm
from bench_records.plots import PALETTE, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_11(study: Study) -> "Figure":
    """Stiffness and damping over frequency, with and without the connecting pipe."""
    figure, (top, below) = panels_of(3, 2)
    f = np.geomspace(0.1, 25.0, 500)
    for column, load in enumerate(LOADS):
        _stiffness(study, load, "Lateral", top[column], "ab"[column])
        _stiffness(study, load, "Vertical", below[column], "de"[column])
        _small_motion_and_closed_form(study, load, top[column], f)
        below[column].set_ylim(0, 1.32 * below[column].get_ylim()[1])
        at_once(study, top[column], load, "frequency")
        add_legend(top[column], loc="upper left", ncols=2)
        _damping(study, load, top[2], below[2], f)
        at_once(study, below[2], load, "frequency", check=DAMPING, colour=COLOUR[load], label="")
    label_panel(top[2], "c", "Vertical damping, orifice only", "frequency, Hz", "c, kN·s/m")
    label_panel(below[2], "f", "Lateral damping, orifice only", "frequency, Hz", "c, kN·s/m")
    below[2].set_yscale("log")
    below[2].tick_params(axis="y", which="minor", left=True)
    for panel in (*top, *below):
        panel.set_xscale("log")
        plain_log_ticks(panel, (0.1, 0.3, 1, 3, 10, 25))
    for panel in (top[2], below[2]):
        add_legend(panel, loc="upper right")
    add_key(
        figure,
        MEASURED,
        PLANT_MODEL,
        ("paper's closed form, lateral (23), damping by harmonic balance", {"linestyle": DASHED}),
        ("(23) with the inertia of a pipe", {"linestyle": DASHED, "color": PALETTE[2]}),
        columns=4,
    )
    return figure


def _stiffness(study: Study, load: str, direction: str, panel: "Axes", letter: str) -> None:
    """Draw |K| of the bench and of the model in one direction, with and without the pipe."""
    plan, colour = f"frequency_sweep_{load.lower()}", COLOUR[load]
    for pipe, label, tone, hollow, dash in (
        ("orifice", "orifice", colour, False, "solid"),
        ("pipe", "pipe", PALETTE[2], False, "solid"),
        ("pipe, 0.5 mm", "pipe, at 0.5 mm", PALETTE[2], True, DOTTED),
    ):
        if (direction, pipe) not in SWEEPS:
            continue
        one = study.bench.points(plan, f"{direction} stiffness |K| per spring", f"{load}, {pipe}")
        draw_points(panel, one, 1.0, KN_M, tone, MARKER[load], hollow=hollow, label=label, size=4.0)
        model = study.model[f"{direction.lower()} {load}, {pipe}"]
        draw_line(panel, model["f"], np.abs(model["K"]) / KN_M, tone, dash)
    label_panel(panel, letter, f"{direction} |K|, {load}", "frequency, Hz", "kN/m")
    add_legend(panel, loc="upper left", ncols=3)


def _small_motion_and_closed_form(study: Study, load: str, panel: "Axes", f: Floats) -> None:
    """Add to lateral |K| the bench's points at 0.9 mm and equation (23), without and with a pipe, over f (Hz)."""
    small = study.bench.points(
        f"frequency_sweep_{load.lower()}",
        "Lateral, 0.9 mm: stiffness |K| per spring",
        f"{load}, orifice",
    )
    style: dict[str, Any] = {"hollow": True, "label": "orifice, at 0.9 mm", "size": 4.0}
    draw_points(panel, small, 1.0, KN_M, COLOUR[load], MARKER[load], **style)
    add_legend(panel, loc="upper left", ncols=3)
    par, omega = Subject().spring(load), 2 * np.pi * f
    K = dynamic_stiffness(omega, 0.0, par.pressure, par, topology="series", r=SMALL_LOSS)
    piped = _with_pipe(load, omega)
    draw_line(panel, f, np.abs(K) / KN_M, SOFT, DASHED)
    draw_line(panel, f, np.abs(piped) / KN_M, PALETTE[2], DASHED)
    panel.set_ylim(0, 1.3 * max(np.abs(piped).max() / KN_M, panel.get_ylim()[1]))


def _damping(study: Study, load: str, vertical: "Axes", lateral: "Axes", f: Floats) -> None:
    """Draw c = K″/ω of bench and model in both directions, and vertically the closed form over f (Hz)."""
    plan, colour = f"frequency_sweep_{load.lower()}", COLOUR[load]
    for direction, panel in (("Vertical", vertical), ("Lateral", lateral)):
        one = study.bench.points(plan, f"{direction} damping c per spring", f"{load}, orifice")
        draw_points(panel, one, 1.0, KN_M, colour, MARKER[load], label=load, size=4.0)
        model = study.model[f"{direction.lower()} {load}, orifice"]
        draw_line(panel, model["f"], model["K"].imag / (2 * np.pi * model["f"]) / KN_M, colour)
    par = Subject().spring(load)
    c = amplitude_damping(2 * np.pi * f, SWEEP_AMPLITUDE, par.orifice_diameter, par.pressure, par)
    draw_line(vertical, f, np.asarray(c) / KN_M, colour, DASHED)


def _with_pipe(load: str, omega: Floats) -> Any:
    """(23) with 1.5 m of pipe and a 30 mm plate: what the paper's claim on high frequencies needs."""
    par = Subject().spring(load, pipe_length=1.5)
    return dynamic_stiffness(omega, 0.0, par.pressure, par, topology="series", r=SMALL_LOSS, d=30 * mm)
