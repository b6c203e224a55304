"""Sketch of the bench: its parts, their motion, and the signals on each bus."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from astb_studies.gallery.drawing import figure_of, save
from bench_records.plots import INK, PALETTE, SHADE, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CAN, MODBUS = PALETTE[0], PALETTE[1]
AIR: Final = "#cfe3ef"
STEEL: Final = "#c9cfd4"


def sketch(_runs: Path, path: Path) -> None:
    """The bench, its controller, both wires and the host; lengths in arbitrary units."""
    from bench_records.plots import style

    with style():
        figure, axes = figure_of(4.3)
        axes.set(xlim=(0, 96), ylim=(0, 43), aspect="equal")
        axes.set_axis_off()
        _bench(axes)
        _host(axes)
        save(figure, path)


def _box(axes: "Axes", x: float, y: float, w: float, h: float, text: str = "", **kwargs: Any) -> None:
    from matplotlib.patches import FancyBboxPatch

    round_corners = "round,pad=0,rounding_size=0.7"
    look = {"facecolor": "white", "edgecolor": SOFT, "linewidth": 0.9} | kwargs
    axes.add_patch(FancyBboxPatch((x, y), w, h, boxstyle=round_corners, **look))
    axes.text(x + w / 2, y + h / 2, text, ha="center", va="center", fontsize=8.5, linespacing=1.35)


def _arrow(axes: "Axes", start: tuple[float, float], end: tuple[float, float], color: str = INK) -> None:
    axes.annotate(
        "",
        end,
        start,
        arrowprops={"arrowstyle": "<|-|>", "color": color, "lw": 1.2, "shrinkA": 0, "shrinkB": 0},
    )


def _bench(axes: "Axes") -> None:
    _box(axes, 4, 36, 36, 4, "bolster, the car's weight", facecolor=STEEL)
    _box(axes, 4, 9, 36, 4, "platform", facecolor=STEEL)
    for side, x in (("left", 8.0), ("right", 28.0)):
        _box(axes, x, 26, 8, 10, f"{side}\nbellows", facecolor=AIR)
        _box(axes, x + 1.5, 20.5, 5, 5.5, "", facecolor=SHADE, hatch="---", edgecolor="#9aa3ab")
        _box(axes, x, 15, 8, 4, "auxiliary\nchamber", facecolor=AIR)
        axes.plot((x + 4, x + 4), (19, 20.5), color=INK, lw=2.2)
        for dx in (1.2, 6.8):
            axes.plot(x + dx, 14, "s", color=INK, ms=5)
    axes.plot((16, 28), (17, 17), color=INK, lw=1.2)
    axes.plot(22, 17, marker=(4, 0, 45), color=INK, ms=9, mfc="white")
    axes.text(22, 18.6, "differential\npressure valve", ha="center", va="bottom", fontsize=7.5, color=SOFT)
    axes.text(22, 13.9, "load cells", ha="center", fontsize=7.5, color=SOFT)
    axes.text(22, 23.7, "emergency\nsprings", ha="center", va="bottom", fontsize=7.5, color=SOFT)
    axes.text(22, 30, "orifice below\neach bellows", ha="center", fontsize=7.5, color=SOFT)
    for x in (12.0, 32.0):
        _arrow(axes, (x, 40.3), (x, 43))
        _arrow(axes, (x, 5.2), (x, 8.7))
    _arrow(axes, (0.2, 38), (3.8, 38))
    axes.text(22, 41.6, "two vertical actuators, one lateral", ha="center", fontsize=7.5, color=SOFT)
    axes.text(22, 6.4, "track: height, sideways, roll", ha="center", fontsize=7.5, color=SOFT)


def _host(axes: "Axes") -> None:
    _box(axes, 48, 27, 15, 9, "fast controller\n200 Hz", edgecolor=CAN)
    _box(axes, 48, 13, 15, 9, "PLC\nvalves, states,\ninterlocks", edgecolor=MODBUS)
    for y in (31.5, 17.5):
        axes.plot((41.5, 48), (y, y), color=SOFT, lw=1.0, ls=(0, (2, 2)))
    axes.plot((41.5, 41.5), (10, 39), color=SOFT, lw=1.0, ls=(0, (2, 2)))
    _box(axes, 80, 11, 15, 27, "", facecolor=SHADE)
    for y, text in ((31.5, "test plan"), (24.5, "drivers"), (17.5, "record,\nreport")):
        _box(axes, 81.5, y - 2.5, 12, 5, text)
    _arrow(axes, (63.3, 31.5), (79.7, 31.5), CAN)
    _arrow(axes, (63.3, 17.5), (79.7, 17.5), MODBUS)
    for y, wire, what, color in (
        (31.5, "CAN", "readings, set-points", CAN),
        (17.5, "Modbus/TCP", "settings, states", MODBUS),
    ):
        axes.text(71.5, y + 1.0, wire, ha="center", fontsize=9, fontweight="bold", color=color)
        axes.text(71.5, y - 2.3, what, ha="center", fontsize=7.5, color=SOFT)
    axes.text(71.5, 24.4, "nothing else\nis shared", ha="center", va="center", fontsize=7.5, color=SOFT)
    axes.text(33.5, 2, "the rig: simulated, or steel", ha="center", fontsize=9, fontweight="bold")
    axes.text(87.5, 8, "the host", ha="center", fontsize=9, fontweight="bold")
