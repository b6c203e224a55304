"""The paper's figures 5 to 11: the bench as points, the plant's model as lines, the paper's closed forms dashed."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.units import bar, litre, mm
from bench_records.plots import INK, PALETTE, SHADE, SOFT, style
from bench_records.plots import svg as inline
from bench_sim.model.paper import (
    amplitude_damping,
    dynamic_stiffness,
    equivalent_volume,
    lateral_area,
    orifice_damping,
    roll_factor,
    unilateral_cosine,
)
from paper_study.bench import Points
from paper_study.laws import SMALL_LOSS, closed_secant, closed_stiffness, closed_tangent, fitted_lateral_area
from paper_study.study import SWEEPS, Study
from paper_study.subject import LOADS, Subject
from test_plans.by_frequency import SWEEP_AMPLITUDE
from test_plans.by_pressure import AMPLITUDES
from test_plans.by_ratio import NATURAL
from test_plans.damping_ratio import PLATES
from test_plans.fittings import PLATE
from test_plans.identification.area_and_volume import shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = npt.NDArray[np.float64]

COLOUR: Final = {"AW0": PALETTE[0], "AW3": PALETTE[1]}
MARKER: Final = {"AW0": "o", "AW3": "s"}
#: An order (amplitudes, diameters) reads best on a scale from dark to light; markers tell it without colour.
ORDERED: Final = ("#2d1160", "#8c2981", "#de4968", "#f0944d")
MARKERS: Final = ("o", "s", "^", "D")
DASHED: Final = (0, (4.5, 1.8))
DOTTED: Final = (0, (1.2, 1.4))
KN_M: Final = 1e3
PANEL_IN: Final = 3.5
WIDE_IN: Final = 4.5


def _figure(columns: int, rows: int = 1, height: float = 3.15, **kwargs: Any) -> tuple["Figure", Any]:
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    width = PANEL_IN * columns if columns > 2 else WIDE_IN * columns
    engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06, wspace=0.03, hspace=0.05)
    figure = Figure(figsize=(width, height * rows + 0.35), layout=engine, facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, **kwargs)
    return figure, axes


def _title(axes: "Axes", letter: str, title: str, x: str, y: str) -> None:
    axes.set_title(f"({letter})  {title}", loc="left", fontsize=9, fontweight="bold", pad=6)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def _points(
    axes: "Axes",
    one: Points,
    x: float,
    y: float,
    colour: str,
    marker: str = "o",
    *,
    label: str = "",
    hollow: bool = False,
    size: float = 4.6,
) -> None:
    """Measured points, with a bar from the lowest to the highest rig where there are several."""
    spread = np.vstack([one.y - one.low, one.high - one.y]) / y
    axes.errorbar(
        one.x / x,
        one.y / y,
        yerr=spread if spread.max() > 0.0 else None,
        color=colour,
        linestyle="none",
        marker=marker,
        markersize=size,
        markerfacecolor="white" if hollow else colour,
        markeredgecolor=colour if hollow else "white",
        markeredgewidth=0.9 if hollow else 0.6,
        elinewidth=0.9,
        zorder=3,
    )
    if label:  # the key shows the point without its bar
        look: dict[str, Any] = {
            "markerfacecolor": "white" if hollow else colour,
            "markeredgecolor": colour if hollow else "white",
        }
        axes.plot([], [], linestyle="none", marker=marker, markersize=size, label=label, **look)


def _line(
    axes: "Axes", x: Floats, y: Any, colour: str, dash: Any = "solid", label: str = "", **kw: Any
) -> None:
    axes.plot(x, y, color=colour, linestyle=dash, label=label or None, **({"linewidth": 1.25} | kw))


def _key(figure: "Figure", *entries: tuple[str, dict[str, Any]], columns: int = 0) -> None:
    """One key below the panels that says what points, lines and dashes are."""
    from matplotlib.lines import Line2D

    looks: list[dict[str, Any]] = [{"color": INK, "linewidth": 1.25} | look for _, look in entries]
    handles = [Line2D([], [], **look) for look in looks]
    figure.legend(
        handles,
        [text for text, _ in entries],
        loc="outside lower center",
        ncols=columns or len(entries),
        frameon=False,
        fontsize=8,
        handlelength=2.0,
        columnspacing=1.6,
    )


_MEASURED: Final[tuple[str, dict[str, Any]]] = (
    "bench",
    {"linestyle": "none", "marker": "o", "markersize": 5, "markeredgecolor": "white"},
)
_PLANT: Final[tuple[str, dict[str, Any]]] = ("plant's model, identified parameters", {})
_CLOSED: Final[tuple[str, dict[str, Any]]] = ("paper's closed form", {"linestyle": DASHED})


def _legend(axes: "Axes", **kwargs: Any) -> None:
    axes.legend(**({"frameon": False, "fontsize": 7.5, "handlelength": 1.6, "labelspacing": 0.35} | kwargs))


# -- figure 5: the track -------------------------------------------------------------------------------------------


def figure_5(study: Study) -> "Figure":
    """Track excitation (24) over time: by amplitude, and by angular frequency."""
    figure, ((a, b),) = _figure(2, sharey=True)
    t = np.linspace(0.0, 2.5, 600)
    for amplitude, colour in zip((2.5, 5.0, 7.5, 10.0), ORDERED, strict=True):
        z = unilateral_cosine(t, amplitude * mm, 2 * np.pi * NATURAL, 3)
        _line(a, t, np.asarray(z) / mm, colour, DASHED, label=f"{amplitude:g} mm")
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
    _title(a, "a", "By amplitude, at 1.2 Hz", "time, s", "displacement, mm")
    for f, colour in zip((0.6, 1.2, 2.4), ORDERED, strict=False):
        z = unilateral_cosine(t, 5 * mm, 2 * np.pi * f, 2)
        _line(b, t, np.asarray(z) / mm, colour, DASHED, label=f"{2 * np.pi * f:.1f} rad/s ({f:g} Hz)")
    _title(b, "b", "By angular frequency, 5 mm, two waves", "time, s", "")
    a.set_ylim(-0.4, 12.8)
    for axes in (a, b):
        _legend(axes, loc="upper right", ncols=2 if axes is a else 1)
    _key(
        figure,
        ("equation (24)", {"linestyle": DASHED}),
        ("platform of the bench, as its transducer reports", _MEASURED[1]),
    )
    return figure


# -- figure 6: what the bench finds --------------------------------------------------------------------------------


def figure_6(study: Study) -> "Figure":
    """Bench results: lateral stiffness over pressure, damping over the pressure ratio."""
    figure, (axes,) = _figure(3)
    for letter, load, panel in zip("ab", LOADS, axes, strict=False):
        _lateral_points(study, panel, load)
        p = np.linspace(*_span(study, load), 50)
        _line(panel, p / bar, closed_stiffness(load, p) / KN_M, SOFT, DASHED)
        _title(panel, letter, f"Lateral stiffness, {load}", "pressure (gauge), bar", "K′, kN/m")
        panel.set_ylim(bottom=0)
        _legend(panel, title="amplitude", title_fontsize=7.5, loc="lower right", ncols=3)
    _damping_points(study, axes[2])
    par = Subject().spring("AW0")
    r = np.linspace(0.77, 0.9995, 400)
    for d, colour in zip(PLATES, ORDERED, strict=True):
        c = orifice_damping(2 * np.pi * NATURAL, r, d, par.pressure, par)
        _line(axes[2], r, np.asarray(c) / KN_M, colour, DASHED, linewidth=0.9)
    _title(axes[2], "c", "Vertical damping, AW0, 1.2 Hz", "pressure ratio across the orifice", "c, kN·s/m")
    axes[2].set_ylim(0, 52)
    _legend(axes[2], title="orifice", title_fontsize=7.5, loc="lower left", ncols=2)
    _key(
        figure,
        _MEASURED,
        (
            "paper's closed form: (10) with (16) in series; (19) at the ratio at which it is linearised",
            {"linestyle": DASHED},
        ),
    )
    return figure


def _lateral_group(load: str) -> tuple[str, str]:
    return f"lateral_pressure_{load.lower()}", f"Lateral stiffness K' per spring, {load}"


def _span(study: Study, load: str) -> tuple[float, float]:
    p = study.bench.points(*_lateral_group(load), "5 mm").x
    return float(p.min()), float(p.max())


def _lateral_points(study: Study, panel: "Axes", load: str, *, first: bool = False) -> None:
    for a, colour, marker in zip(sorted(AMPLITUDES), ORDERED, MARKERS, strict=False):
        name = f"{a / mm:g} mm"
        _points(
            panel,
            study.bench.points(*_lateral_group(load), name, first=first),
            bar,
            KN_M,
            colour,
            marker,
            label=name,
        )


def _damping_points(study: Study, panel: "Axes", *, first: bool = False) -> None:
    for d, colour, marker in zip(PLATES, ORDERED, MARKERS, strict=True):
        name = f"{d / mm:g} mm"
        one = study.bench.points(
            "damping_ratio", "Vertical damping c over pressure ratio, AW0", name, first=first
        )
        _points(panel, one, 1.0, KN_M, colour, marker, label=name)


# -- figure 7: identified area and volume --------------------------------------------------------------------------


def figure_7(study: Study) -> "Figure":
    """Effective area and volume over lateral displacement: bench, fit with its interval, plant, paper's law."""
    figure, ((a, b),) = _figure(2)
    fit, plant = study.identified.area_and_volume, Subject().parameters("AW0").record
    y = np.linspace(-62, 62, 241) * mm
    travel = float(plant.membrane_travel[0])
    reach = _reach(fit, "effective_area")
    Y = shape(y, travel)
    A_0, V_0 = fit["effective_area"], fit["bellows_volume"]
    k_0, k_1 = fit["membrane_length"], fit["membrane_length_slope"]
    area = -0.5 * k_1 * Y / A_0
    volume = -0.5 * k_0 * Y / V_0
    area_sigma = _sigma(
        fit, {"membrane_length_slope": -0.5 * Y / A_0, "effective_area": 0.5 * k_1 * Y / A_0**2}
    )
    volume_sigma = _sigma(fit, {"membrane_length": -0.5 * Y / V_0, "bellows_volume": 0.5 * k_0 * Y / V_0**2})
    paper = Subject().spring("AW0")
    true_area = -0.5 * float(plant.membrane_length_slope[0]) * Y / float(plant.effective_area[0])
    true_volume = -0.5 * float(plant.membrane_length[0]) * Y / float(plant.bellows_volume[0])
    laws = (
        np.asarray(lateral_area(y, paper)) / paper.lateral_area - 1.0,
        np.asarray(equivalent_volume(y, paper)) / paper.bellows_volume - 1.0,
    )
    panels = (
        (a, "a", "Effective area", "A", "Effective area", area, area_sigma, true_area, laws[0]),
        (b, "b", "Equivalent volume", "V", "Volume", volume, volume_sigma, true_volume, laws[1]),
    )
    for panel, letter, title, symbol, group, course, sigma, true, law in panels:
        panel.fill_between(
            y / mm,
            100 * (course - reach * sigma),
            100 * (course + reach * sigma),
            color="#b9c4cc",
            linewidth=0,
        )
        _line(panel, y / mm, 100 * course, INK)
        _line(panel, y / mm, 100 * true, PALETTE[2], DOTTED, linewidth=1.6)
        _line(panel, y / mm, 100 * law, SOFT, DASHED)
        for load in LOADS:
            one = study.bench.points("lateral_offset", group, load)
            centre = one.y[np.abs(one.x) < 3 * mm].mean()
            relative = Points(
                *(
                    x if k == 0 else 100 * (x / centre - 1)
                    for k, x in enumerate((one.x, one.y, one.low, one.high))
                )
            )
            _points(
                panel,
                Points(relative.x, relative.y, relative.y, relative.y),
                mm,
                1.0,
                COLOUR[load],
                MARKER[load],
                label=f"bench, {load}",
            )
        _title(
            panel,
            letter,
            title,
            "lateral displacement of the bellows, mm",
            f"change of {symbol} from the centre, %",
        )
    a.set_ylim(-3.4, 0.5)
    b.set_ylim(-4.0, 19.5)
    a.text(
        0.03,
        0.06,
        f"A₀ = {A_0:.4f} ± {reach * fit.sigma('effective_area'):.4f} m²",
        transform=a.transAxes,
        fontsize=8,
    )
    b.text(
        0.5,
        0.93,
        f"V₀ = {V_0 / litre:.2f} ± {reach * fit.sigma('bellows_volume') / litre:.2f} litre",
        transform=b.transAxes,
        fontsize=8,
        ha="center",
    )
    _legend(b, loc="upper center", bbox_to_anchor=(0.5, 0.86))
    _key(
        figure,
        ("fit, with its 95 % interval", {"color": INK}),
        ("plant (what the fit should find)", {"color": PALETTE[2], "linestyle": DOTTED, "linewidth": 1.6}),
        ("paper's law (8), assumed α, β", {"color": SOFT, "linestyle": DASHED}),
    )
    return figure


def _reach(fit: Any, name: str) -> float:
    low, high = fit.interval(name)
    return float(0.5 * (high - low) / fit.sigma(name))


def _sigma(fit: Any, gradient: dict[str, Floats]) -> Floats:
    """Standard deviation of a function of fitted values out of its gradient."""
    places = [fit.names.index(name) for name in gradient]
    G = np.array(list(gradient.values()))
    return np.sqrt(np.einsum("in,ij,jn->n", G, fit.covariance[np.ix_(places, places)], G))


# -- figure 8: validation ------------------------------------------------------------------------------------------

#: What would make the bench's damping larger than that of the orifice, in the key's order.
IMPOSTORS: Final = (
    ("rubber", "rubber and friction of the shell", PALETTE[2], "solid"),
    ("lag", "5 ms between force and displacement", PALETTE[3], DASHED),
    ("coefficient", "discharge coefficient believed 5 % too large", PALETTE[5], DOTTED),
)


def figure_8(study: Study) -> "Figure":
    """Model against bench; below, what the deviation of damping could be, and which run tells."""
    figure, (top, below) = _figure(3, 2)
    area = fitted_lateral_area(study)
    for letter, load, panel in zip("ab", LOADS, top, strict=False):
        _lateral_points(study, panel, load, first=True)
        p = study.bench.points(*_lateral_group(load), "5 mm", first=True).x
        for row, colour in zip(study.model[f"lateral {load}"]["K"], ORDERED, strict=False):
            _line(panel, p / bar, row.real / KN_M, colour)
        _line(panel, p / bar, closed_stiffness(load, p, lateral_area=area) / KN_M, SOFT, DASHED)
        _title(panel, letter, f"Lateral stiffness, {load}", "pressure (gauge), bar", "K′, kN/m")
        _legend(panel, title="amplitude", title_fontsize=7.5, loc="lower right", ncols=3)
        low, high = panel.get_ylim()
        panel.set_ylim(low - 0.22 * (high - low), high)
    _damping_points(study, top[2], first=True)
    for d, colour in zip(PLATES, ORDERED, strict=True):
        model = study.model[f"damping {d / mm:g} mm"]
        for quantity, dash in (("K", "solid"), ("orifice", DOTTED)):
            c = model[quantity].imag / (2 * np.pi * NATURAL)
            _line(top[2], model["ratio"], c / KN_M, colour, dash, linewidth=1.25 if quantity == "K" else 1.5)
    _title(top[2], "c", "Vertical damping, AW0, 1.2 Hz", "pressure ratio across the orifice", "c, kN·s/m")
    top[2].set_ylim(0, 44)
    _legend(top[2], title="orifice", title_fontsize=7.5, loc="lower left", ncols=2)

    shown = study.model["confusable"]
    for panel, over, x, unit in ((below[0], "f", shown["f"], 1.0), (below[1], "a", shown["a"], mm)):
        reference = shown[f"orifice over {over}"].imag
        for name, label, colour, dash in IMPOSTORS:
            more = 100 * (shown[f"{name} over {over}"].imag / reference - 1.0)
            _line(panel, x / unit, more, colour, dash, label=label, linewidth=1.5)
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
    _title(
        below[0], "d", "Damping above the orifice's, 5 mm", "frequency, Hz", "more than the orifice alone, %"
    )
    _title(below[1], "e", "The same at 1.2 Hz", "amplitude, mm", "")
    for name, _, colour, dash in IMPOSTORS:
        _line(below[2], shown["f"], shown[f"{name} left"].imag / KN_M, colour, dash, linewidth=1.5)
    below[2].set_xscale("log")
    below[2].set_ylim(-5, 60)
    _title(below[2], "f", "Loss in F − p·A, 5 mm: no gas in it", "frequency, Hz", "K″, kN/m")
    for panel in (below[0], below[2]):
        _plain_log(panel, (0.3, 1, 3, 10))
    _plain_log(below[1], (1, 2, 5, 10, 20))
    _key(
        figure,
        _MEASURED,
        _PLANT,
        ("the same without rubber", {"linestyle": DOTTED, "linewidth": 1.5}),
        ("paper's (10), its area fitted", {"linestyle": DASHED, "color": SOFT}),
        *(
            (label, {"color": colour, "linestyle": dash, "linewidth": 1.5})
            for _, label, colour, dash in IMPOSTORS
        ),
        columns=4,
    )
    return figure


def _excess(panel: "Axes", one: Points, x: Floats, unit: float, reference: Floats) -> None:
    """The bench's damping over that of the orifice alone, where the panel shows it."""
    shown = (x >= 0.29) & (x <= 10.5) if unit == 1.0 else np.full(x.shape, True)
    more = Points(x, *(100 * (values / reference - 1.0) for values in (one.y, one.low, one.high)))
    _points(panel, more[shown], unit, 1.0, INK, "o")


def _plain_log(panel: "Axes", ticks: tuple[float, ...]) -> None:
    from matplotlib.ticker import NullFormatter, NullLocator

    panel.set_xticks(ticks, [f"{one:g}" for one in ticks])
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_minor_formatter(NullFormatter())


# -- figure 9: lateral displacement --------------------------------------------------------------------------------


def figure_9(study: Study) -> "Figure":
    """Lateral stiffness over lateral displacement: the secant of the paper, and the tangent that it hides."""
    figure, ((a, b),) = _figure(2)
    for load in LOADS:
        model, colour = study.model[f"offset {load}"], COLOUR[load]
        y = model["y"]
        secants = study.bench.points("lateral_offset", "Lateral secant stiffness per spring", load)
        _points(a, secants, mm, KN_M, colour, MARKER[load], label=load)
        _line(a, model["sizes"] / mm, model["stairs"] / KN_M, colour)
        _line(a, y / mm, model["secant"] / KN_M, colour, DOTTED, linewidth=1.5)
        _line(a, y / mm, closed_secant(load, y) / KN_M, colour, DASHED)
        tangents = study.bench.points("lateral_offset", "Lateral stiffness K' of 1 mm per spring", load)
        folded = Points(np.abs(tangents.x), tangents.y, tangents.low, tangents.high)
        _points(b, folded, mm, KN_M, colour, MARKER[load], label=load)
        _line(b, y / mm, model["tangent"].real / KN_M, colour)
        _line(b, y / mm, closed_tangent(load, y) / KN_M, colour, DASHED)
    _title(a, "a", "Secant F/y", "lateral displacement, mm", "secant stiffness, kN/m")
    _title(b, "b", "Small motion (1 mm, 2 Hz) about the offset", "lateral displacement, mm", "K′, kN/m")
    for panel in (a, b):
        panel.set_ylim(0, None)
        _legend(panel, loc="lower left", ncols=2)
    _key(
        figure,
        _MEASURED,
        _PLANT,
        ("the same without friction", {"linestyle": DOTTED, "linewidth": 1.5}),
        ("paper's (10), (16) in series", {"linestyle": DASHED}),
    )
    return figure


# -- figure 10: roll -----------------------------------------------------------------------------------------------


def figure_10(study: Study) -> "Figure":
    """Lateral stiffness over the roll angle, both signs, differential pressure valve open and isolated."""
    figure, axes = _figure(2, 2, height=2.5, sharex="col", gridspec_kw={"height_ratios": (2.6, 1)})
    for letter, load, panel, pressures in zip("ab", LOADS, *axes, strict=True):
        plan, colour = f"roll_angle_{load.lower()}", COLOUR[load]
        for valve, hollow in (("isolated", False), ("open", True)):
            name = f"{load}, valve {valve}"
            secants = study.bench.points(plan, "Lateral secant F/y at +20 mm per spring", name)
            _points(
                panel, secants, 1.0, KN_M, colour, MARKER[load], hollow=hollow, label=f"secant, valve {valve}"
            )
            apart = study.bench.points(plan, "Pressure left less right", name)
            _points(pressures, apart, 1.0, bar, colour, MARKER[load], hollow=hollow, size=3.6)
        harmonic = study.bench.points(
            plan, "Lateral stiffness K' of 5 mm about +20 mm per spring", f"{load}, valve isolated"
        )
        _points(panel, harmonic, 1.0, KN_M, SOFT, "^", label="first harmonic, 5 mm", size=4.0)
        model = study.model[f"roll {load}"]
        _line(panel, model["roll"], model["secant"] / KN_M, colour)
        _line(panel, model["roll"], model["K"].real / KN_M, SOFT)
        phi = np.linspace(model["roll"].min(), model["roll"].max(), 200)
        par = Subject().spring(load)
        even = closed_secant(load, np.array(20 * mm)) * np.asarray(roll_factor(phi, par))
        _line(panel, phi, even / KN_M, INK, DASHED)
        _title(panel, letter, f"Lateral stiffness, {load}, y = +20 mm", "", "kN/m")
        panel.set_ylim(0, None)
        panel.set_ylim(0, 1.28 * panel.get_ylim()[1])
        _legend(panel, loc="upper left", ncols=2)
        pressures.set_xlabel("roll angle, rad (φ·y > 0 on the right)")
        pressures.set_ylabel("left − right, bar")
    _key(
        figure,
        ("bench: valve isolated, or (hollow) open", _MEASURED[1]),
        _PLANT,
        ("paper's even law", {"linestyle": DASHED}),
    )
    return figure


# -- figure 11: frequency ------------------------------------------------------------------------------------------


def figure_11(study: Study) -> "Figure":
    """Stiffness and damping over frequency, with and without the connecting pipe."""
    figure, (top, below) = _figure(3, 2)
    f = np.geomspace(0.1, 25.0, 500)
    omega = 2 * np.pi * f
    for column, load in enumerate(LOADS):
        plan, colour = f"frequency_sweep_{load.lower()}", COLOUR[load]
        for row, (panel, direction) in enumerate(((top[column], "Lateral"), (below[column], "Vertical"))):
            for pipe, label, tone, hollow, dash in (
                ("orifice", "orifice", colour, False, "solid"),
                ("pipe", "pipe", PALETTE[2], False, "solid"),
                ("pipe, 0.5 mm", "pipe, at 0.5 mm", PALETTE[2], True, DOTTED),
            ):
                if (direction, pipe) not in SWEEPS:
                    continue
                one = study.bench.points(plan, f"{direction} stiffness |K| per spring", f"{load}, {pipe}")
                _points(panel, one, 1.0, KN_M, tone, MARKER[load], hollow=hollow, label=label, size=4.0)
                model = study.model[f"{direction.lower()} {load}, {pipe}"]
                _line(panel, model["f"], np.abs(model["K"]) / KN_M, tone, dash)
            _title(panel, "abde"[column + 2 * row], f"{direction} |K|, {load}", "frequency, Hz", "kN/m")
            _legend(panel, loc="upper left", ncols=3)
        small = study.bench.points(plan, "Lateral, 0.9 mm: stiffness |K| per spring", f"{load}, orifice")
        _points(
            top[column],
            small,
            1.0,
            KN_M,
            colour,
            MARKER[load],
            hollow=True,
            label="orifice, at 0.9 mm",
            size=4.0,
        )
        _legend(top[column], loc="upper left", ncols=3)
        par = Subject().spring(load)
        K = dynamic_stiffness(omega, 0.0, par.pressure, par, topology="series", r=SMALL_LOSS)
        piped = _with_pipe(load, omega)
        _line(top[column], f, np.abs(K) / KN_M, SOFT, DASHED)
        _line(top[column], f, np.abs(piped) / KN_M, PALETTE[2], DASHED)
        top[column].set_ylim(0, 1.3 * max(np.abs(piped).max() / KN_M, top[column].get_ylim()[1]))
        below[column].set_ylim(0, 1.32 * below[column].get_ylim()[1])

        vertical = study.bench.points(plan, "Vertical damping c per spring", f"{load}, orifice")
        _points(top[2], vertical, 1.0, KN_M, colour, MARKER[load], label=load, size=4.0)
        model = study.model[f"vertical {load}, orifice"]
        _line(top[2], model["f"], model["K"].imag / (2 * np.pi * model["f"]) / KN_M, colour)
        d = par.orifice_diameter
        c = np.asarray(amplitude_damping(omega, SWEEP_AMPLITUDE, d, par.pressure, par))
        _line(top[2], f, c / KN_M, colour, DASHED)
        lateral = study.bench.points(plan, "Lateral damping c per spring", f"{load}, orifice")
        _points(below[2], lateral, 1.0, KN_M, colour, MARKER[load], label=load, size=4.0)
        model = study.model[f"lateral {load}, orifice"]
        _line(below[2], model["f"], model["K"].imag / (2 * np.pi * model["f"]) / KN_M, colour)
    _title(top[2], "c", "Vertical damping, orifice only", "frequency, Hz", "c, kN·s/m")
    _title(below[2], "f", "Lateral damping, orifice only", "frequency, Hz", "c, kN·s/m")
    below[2].set_yscale("log")
    for panel in (*top, *below):
        panel.set_xscale("log")
        _plain_log(panel, (0.1, 0.3, 1, 3, 10, 25))
    for panel in (top[2], below[2]):
        _legend(panel, loc="upper right")
    _key(
        figure,
        _MEASURED,
        _PLANT,
        ("paper's closed form, lateral (23), damping by harmonic balance", {"linestyle": DASHED}),
        ("(23) with the inertia of a pipe", {"linestyle": DASHED, "color": PALETTE[2]}),
        columns=4,
    )
    return figure


def _with_pipe(load: str, omega: Floats) -> Any:
    """(23) with 1.5 m of pipe and a 30 mm plate: what the paper's claim on high frequencies needs."""
    par = Subject().spring(load, pipe_length=1.5)
    return dynamic_stiffness(omega, 0.0, par.pressure, par, topology="series", r=SMALL_LOSS, d=30 * mm)


# -- the table and the sensitivity ---------------------------------------------------------------------------------


def comfort(study: Study) -> "Figure":
    """The table as a picture: acceleration and comfort index over the wind speed."""
    figure, ((a, b),) = _figure(2)
    for panel, value, width in ((a, "acceleration", "acceleration_width"), (b, "comfort", "comfort_width")):
        for layer, dash, hollow in (("plant", "solid", False), ("paper", DASHED, True)):
            for load in LOADS:
                rows = [one for one in study.rides if (one.layer, one.load) == (layer, load)]
                x = np.array([one.wind_speed for one in rows])
                y = np.array([getattr(one, value) for one in rows])
                reach = np.nan_to_num(np.array([getattr(one, width) for one in rows]))
                _line(panel, x, y, COLOUR[load], dash)
                _points(
                    panel,
                    Points(x, y, y - reach, y + reach),
                    1.0,
                    1.0,
                    COLOUR[load],
                    MARKER[load],
                    hollow=hollow,
                    label=f"{load}, {layer}",
                )
        panel.set_xticks((10, 15, 20, 25))
        panel.set_ylim(0, None)
    _title(a, "a", "Lateral acceleration of the floor, rms", "mean wind speed, m/s", "m/s²")
    _title(b, "b", "Comfort index N", "mean wind speed, m/s", "N")
    b.axhspan(0, 1, color=SHADE, zorder=0)
    b.text(10, 0.94, "N < 1: very good", fontsize=7.5, color=SOFT, va="top")
    b.set_ylim(0, 1.15)
    for panel in (a, b):
        _legend(panel, loc="lower right", ncols=2)
    _key(
        figure,
        ("car on the plant's springs", {}),
        ("the paper's equation (28)", {"linestyle": DASHED}),
    )
    return figure


def sensitivity(study: Study) -> "Figure":
    """Total and first-order Sobol indices of the geometric parameters in both layers."""
    from paper_study.sensitivity import PAPER, PLANT

    figure, axes = _figure(4, 2, height=2.75)
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
    _key(
        figure,
        ("total index, with 95 % interval", {"linewidth": 7, "color": SOFT, "alpha": 0.75}),
        ("first order", {"linestyle": "none", "marker": "D", "markersize": 4}),
    )
    return figure


FIGURES: Final[dict[str, Callable[[Study], "Figure"]]] = {
    "figure-05": figure_5,
    "figure-06": figure_6,
    "figure-07": figure_7,
    "figure-08": figure_8,
    "figure-09": figure_9,
    "figure-10": figure_10,
    "figure-11": figure_11,
    "comfort": comfort,
    "sensitivity": sensitivity,
}


def draw(name: str, study: Study, out: Path) -> str:
    """Draw one of `FIGURES` into ``out`` as SVG and PNG; return it as an element for a page."""
    with style():
        figure = FIGURES[name](study)
        # The layout is solved once, not for each file.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        figure.savefig(out / f"{name}.svg", metadata={"Date": None, "Creator": None})
        figure.savefig(out / f"{name}.png", dpi=150, metadata={"Software": None})
        return inline(figure, name)
