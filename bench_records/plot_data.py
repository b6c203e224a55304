"""The numbers of the plots in a report, packed for the script of the page, which zooms and displays values.

Each series is stored once, in steps of 1/65534 of its range, and all series are compressed together. The number of
points is limited, so the page of even a long run is small enough for an e-mail.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]

ASSETS: Final = Path(__file__).parent / "assets"
#: Steps of a range, and the code of a gap.
STEPS: Final = 65534
GAP: Final = 65535


class Trace(NamedTuple):
    """One line of a plot, in the units of its axes."""

    label: str
    color: str
    dash: tuple[float, ...]
    xs: Numbers
    ys: Numbers
    width: float = 1.2
    expanded: Numbers | None = None  #: the expanded uncertainty of each y, NaN where it is not known


class Plot(NamedTuple):
    """A plot for the script. *time* plots zoom together, a *sweep* has few points, and a *loop* is a closed curve."""

    kind: Literal["time", "sweep", "loop"]
    title: str
    x: str
    y: str
    traces: Sequence[Trace]
    logarithmic: bool = False
    shades: Sequence[tuple[float, float]] = ()
    marks: Sequence[float] = ()
    ticks: Sequence[float] = ()  #: of the horizontal scale; without any the script finds them


class PlotData:
    """The plots of a page and their numbers."""

    def __init__(self) -> None:
        self._plots: list[dict[str, Any]] = []
        self._parts: list[bytes] = []
        self._known: dict[bytes, list[float]] = {}
        self._count = 0

    def add(self, plot: Plot) -> int:
        """Add a plot. Return its number for the script."""
        fields = plot._asdict()
        fields["traces"] = [
            {
                "label": one.label,
                "color": one.color,
                "dash": one.dash,
                "width": one.width,
                "x": self.place(one.xs),
                "y": self.place(one.ys),
                "expanded": None if one.expanded is None else self.place(one.expanded),
            }
            for one in plot.traces
        ]
        self._plots.append(fields)
        return len(self._plots) - 1

    def place(self, numbers: Numbers) -> list[float]:
        """Store a series of numbers once. Return the index of its first number, its length, its lowest and its
        highest value.
        """
        import numpy as np

        key = numbers.tobytes()
        if key not in self._known:
            finite = numbers[np.isfinite(numbers)]
            low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
            # The quotient first: a range may be so small that STEPS over it is infinite.
            scaled = STEPS * ((numbers - low) / (high - low if high > low else 1.0))
            steps = np.where(np.isfinite(scaled), np.rint(np.nan_to_num(scaled)), GAP).astype("<u2")
            self._parts.append(steps.tobytes())
            self._known[key] = [self._count, numbers.size, low, high]
            self._count += numbers.size
        return self._known[key]

    @property
    def json(self) -> str:
        """Return the plots as JSON for the script. The text is escaped, so it cannot close its HTML element."""
        return embedded(self._plots)

    @property
    def packed(self) -> str:
        """Return all numbers as base64 of compressed 16-bit little-endian integers."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 6)).decode("ascii")


def embedded(content: Any) -> str:
    """Return plain data as JSON. The text is escaped, so it cannot close its HTML element."""
    return json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


@cache
def asset(name: str) -> str:
    """Return the text of a file of this package that is embedded in pages."""
    return (ASSETS / name).read_text(encoding="utf-8")
