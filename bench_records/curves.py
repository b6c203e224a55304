"""Curves of a result: one series of numbers over another, with axes. Sweeps may have limits for each point."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import msgspec


class Axis(msgspec.Struct, frozen=True):
    """Title, unit and scale of one axis of a plot."""

    label: str
    unit: str = ""
    scale: float = 1.0
    zero: float = 0.0  #: zero of the unit (SI), 273.15 K for degC

    def shown(self, value: float) -> float:
        """Return an SI value in the unit of the axis."""
        return (value - self.zero) / self.scale


class Curve(msgspec.Struct, frozen=True, kw_only=True):
    """A named series y over x, in SI. A ``loop`` connects all points, and a ``sweep`` is a table of few points.

    Curves of one ``group`` share a plot. Sweeps with the same x also share a table.
    """

    name: str
    x: Axis
    y: Axis
    xs: list[float | None]
    ys: list[float | None]
    kind: Literal["loop", "sweep"] = "loop"
    group: str = ""
    lows: list[float | None] = []  #: the limits of each point of a sweep, where it has some (SI)
    highs: list[float | None] = []
    expanded: list[float | None] = []  #: the expanded uncertainty of each y, where it is known (SI)

    def __post_init__(self) -> None:
        if len(self.xs) != len(self.ys):
            raise ValueError(
                f"curve {self.name!r} has {len(self.xs)} x and {len(self.ys)} y; the numbers must be equal"
            )
        if not {len(self.lows), len(self.highs)} <= {0, len(self.xs)}:
            raise ValueError(
                f"curve {self.name!r} has {len(self.lows)} low and {len(self.highs)} high limits for {len(self.xs)} "
                "points; give one for each point, or none at all"
            )
        if len(self.expanded) not in {0, len(self.xs)}:
            raise ValueError(
                f"curve {self.name!r} has {len(self.expanded)} uncertainties for {len(self.xs)} points; give one for "
                "each point (None if unknown), or none at all"
            )


def curve(
    name: str,
    x: Axis,
    y: Axis,
    xs: Iterable[float],
    ys: Iterable[float],
    *,
    kind: Literal["loop", "sweep"] = "loop",
    group: str = "",
    limits: Iterable[tuple[float | None, float | None]] = (),
    expanded: Iterable[float | None] = (),
) -> Curve:
    """Return a curve from two series of numbers (arrays are possible). NaN and ∞ become gaps.

    ``limits`` are the lower and upper limit of each point, and ``expanded`` is its expanded uncertainty.
    """
    clean_x, clean_y = ([float(n) if math.isfinite(n) else None for n in series] for series in (xs, ys))
    pairs = list(limits)
    lows, highs = [low for low, _ in pairs], [high for _, high in pairs]
    return Curve(
        name=name,
        x=x,
        y=y,
        xs=clean_x,
        ys=clean_y,
        kind=kind,
        group=group,
        lows=lows,
        highs=highs,
        expanded=list(expanded),
    )
