"""Common parts of the drawings in reports: colours, font, axes of a given size, and SVG elements for a page.

Colours are those of Okabe and Ito, which people with any kind of colour vision can distinguish. No information depends
on colour alone. Texts are not converted to paths, so they have the font of the page and can be searched.
"""

from __future__ import annotations

import re
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    Numbers = npt.NDArray[np.float64]

INK = "#1c2126"
SOFT = "#68727c"
HAIR = "#dfe3e7"
SHADE = "#f1f4f6"
ALARM = "#b3261e"
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#b07aa1", "#56b4e9", "#8c6d00", "#1c2126", "#999999")

WIDTH_IN = 9.6
LEFT_IN, RIGHT_IN = 0.72, 1.85
#: Digits of a path beyond the hundredth of a point.
FINER_THAN_SEEN = re.compile(r"(?<=\.\d\d)\d+")


def style() -> Any:
    """Return a context manager that sets font, lines and colours of all drawings."""
    from matplotlib import rc_context

    return rc_context(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "astb",
            # This font comes with matplotlib, so texts have the same width on every machine.
            "font.family": "DejaVu Sans",
            "font.size": 8.5,
            "text.color": INK,
            "axes.labelcolor": SOFT,
            "axes.labelsize": 8.5,
            "axes.edgecolor": "#9aa3ab",
            "axes.linewidth": 0.7,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.unicode_minus": True,
            "text.parse_math": False,
            "axes.formatter.useoffset": False,
            "grid.color": HAIR,
            "grid.linewidth": 0.6,
            "xtick.color": SOFT,
            "ytick.color": SOFT,
            "xtick.labelsize": 8,
            "ytick.labelsize": 8,
            "xtick.bottom": False,
            "xtick.major.size": 0,
            "ytick.left": False,
            "ytick.major.size": 0,
            "lines.linewidth": 1.2,
            "lines.solid_joinstyle": "round",
            "path.simplify_threshold": 0.25,
        }
    )


def panel(
    height: float,
    width: float = WIDTH_IN,
    left: float = LEFT_IN,
    right: float = RIGHT_IN,
    bottom: float = 0.3,
    top: float = 0.3,
) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes. Sizes and margins are in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="none")
    axes = figure.add_axes(
        (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
    )
    axes.set_facecolor("none")
    axes.locator_params(axis="y", nbins=5)
    return figure, axes


#: Size of a title, and the space between it and the text on the right, in points.
_TITLE: Final = 9.5
_BETWEEN: Final = 8.0


def heading(axes: Axes, title: str, unit: str, what: str = "") -> None:
    """Write the title on the left, and quantity and unit on the right above the axes. The title gets smaller if there
    is no room for both.
    """
    text = ", ".join(filter(None, [what, unit]))
    room = 72.0 * axes.get_position().width * axes.figure.get_figure(root=True).get_figwidth()
    size = _TITLE * min(
        1.0, (room - _width(text, 8.5) - _BETWEEN) / max(_width(title, _TITLE, bold=True), 1.0)
    )
    # With y given, matplotlib does not measure the drawing to place the title.
    axes.set_title(title, loc="left", fontsize=max(size, 6.0), fontweight="bold", pad=5, y=1.0)
    axes.set_title(text, loc="right", fontsize=8.5, color=SOFT, pad=5, y=1.0)


def _width(text: str, size: float, *, bold: bool = False) -> float:
    """Return the width of a text in points, in the widest font of the page."""
    from matplotlib import font_manager, textpath

    if not text:
        return 0.0
    weight = "bold" if bold else "normal"
    path = textpath.TextPath(
        (0.0, 0.0), text, prop=font_manager.FontProperties(family="DejaVu Sans", weight=weight, size=size)
    )
    return float(path.get_extents().x1)


def number(value: float) -> str:
    """Return a number as text, with narrow spaces between thousands."""
    return f"{value:,.10g}".replace(",", "\u2009").replace("-", "\u2212")


def plain_numbers(figure: Figure | SubFigure) -> None:
    """Format all ticks of a figure as plain numbers, before the figure is saved. Logarithmic axes would use markup."""
    from matplotlib.ticker import FuncFormatter, LogFormatter, LogFormatterSciNotation

    class Plain(LogFormatterSciNotation):
        """A formatter that uses the same ticks, but writes plain numbers."""

        def __call__(self, x: float, pos: Any = None) -> str:
            return number(x) if super().__call__(x, pos) else ""

    for axis in (one for axes in figure.axes for one in (axes.xaxis, axes.yaxis)):
        major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
        if isinstance(major, LogFormatter) and not isinstance(major, Plain):
            axis.set_major_formatter(FuncFormatter(lambda n, _: number(n)))
        if isinstance(minor, LogFormatter) and not isinstance(minor, Plain):
            axis.set_minor_formatter(Plain(labelOnlyBase=minor.labelOnlyBase))


def svg(figure: Figure, name: str) -> str:
    """Return the figure as an SVG element for a page. Its ids are unique, and coordinates are rounded to visible
    precision.
    """
    plain_numbers(figure)
    out = StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    return element(out.getvalue(), name, ", ".join(filter(None, titles)))


def element(text: str, name: str, title: str = "") -> str:
    """Convert a saved SVG figure to an element for a page. ``name`` makes its ids unique.

    ``title`` is its name for screen readers. Without a title, they read the texts of the drawing.
    """
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' d="[^"]*"', lambda m: FINER_THAN_SEEN.sub("", m.group()).replace("\n", ""), text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace("url(#", f"url(#{name}-").replace('href="#', f'href="#{name}-')
    # The page defines the font; the drawing defines only size and weight.
    text = text.replace(" font-family: 'DejaVu Sans';", "")
    role = f'role="img" aria-label="{escape(title, quote=True)}"' if title else 'role="group"'
    text = re.sub(
        r'<svg [^>]*?viewBox="([^"]*)"[^>]*>',
        lambda m: f'<svg class="plot" viewBox="{m[1]}" {role}>',
        text,
        count=1,
    )
    return re.sub(r"\n\s*", "\n", text)
