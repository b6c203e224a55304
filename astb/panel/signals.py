"""The signals that the panel shows: name, unit and decimals, limits, and position."""

from collections.abc import Sequence
from typing import Any, Final

import msgspec

from astb.rig_limits import KnownLimit
from bench_protocol.signals import Group, Signal
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import UNITS
from bench_protocol.words import LimitKind
from bench_records.replay import DECIMALS, WRITTEN

#: Signals with large digits, readable from two metres away, in this order.
KEY: Final = (
    "left.height",
    "right.height",
    "left.bellows_pressure",
    "right.bellows_pressure",
    "vertical_left.force",
    "vertical_right.force",
    "lateral.displacement",
    "lateral.force",
    "supply.pressure",
)


class Shown(msgspec.Struct, frozen=True):
    """A signal for display; limits and range are in its ``unit``."""

    name: str
    label: str
    panel: str  #: the title over signals of this kind
    unit: str
    decimals: int
    factor: float  #: SI value of one unit
    zero: float  #: SI value where the unit begins to count: 273.15 K for °C
    low: float | None  #: the nearest lower limit that is known
    high: float | None
    key: bool

    def of(self, value: Any) -> Any:
        """Return a value (SI), or an array of values, in the display unit."""
        return (value - self.zero) / self.factor


def shown_signals(limits: Sequence[KnownLimit]) -> tuple[Shown, ...]:
    """Return every measurement, the key readings first."""
    order = sorted(MEASUREMENTS, key=lambda one: KEY.index(one.name) if one.name in KEY else len(KEY))
    return tuple(shown(one, limits) for one in order)


def shown(signal: Signal, limits: Sequence[KnownLimit] = ()) -> Shown:
    """Return a measurement for display, with the nearest of its ``limits``."""
    read_in = "degC" if signal.unit == "K" else signal.unit
    unit = UNITS[read_in]
    mine = [one.limit for one in limits if one.limit.signal == signal.name]
    lows = [(one.at - unit.zero) / unit.factor for one in mine if one.kind is LimitKind.LOWER]
    highs = [(one.at - unit.zero) / unit.factor for one in mine if one.kind is LimitKind.UPPER]
    assert isinstance(signal.group, Group), "a measurement has a group"
    return Shown(
        signal.name,
        signal.name.replace(".", " ").replace("_", " "),
        signal.group.row.panel,
        WRITTEN.get(read_in, read_in),
        DECIMALS.get(read_in, 2),
        unit.factor,
        unit.zero,
        max(lows, default=None),
        min(highs, default=None),
        signal.name in KEY,
    )
