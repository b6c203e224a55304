"""Stores curves for the record, with the quantities and units of their axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from bench_protocol.units import UNITS
from bench_records.curves import Axis

if TYPE_CHECKING:
    from test_plans.analysis.uncertainty import Measured
    from test_plans.loads import Band
    from test_plans.run import Run


def _axis(label: str, unit: str) -> Axis:
    found = UNITS.get(unit, UNITS["1"])
    return Axis(label, "" if unit == "1" else unit, found.factor, found.zero)


Quantity = tuple[str, str]  #: name and unit

PRESSURE: Final = ("pressure", "bar")
STEP: Final = ("step", "1")
RATIO: Final = ("pressure ratio", "1")
FREQUENCY: Final = ("frequency", "Hz")
SHEAR: Final = ("lateral displacement", "mm")
BELLOWS_SHEAR: Final = ("lateral displacement of the bellows", "mm")
HEIGHT: Final = ("height", "mm")
ROLL: Final = ("roll angle", "rad")
AMPLITUDE: Final = ("amplitude", "mm")
STORAGE: Final = ("stiffness K'", "kN/m")
LOSS: Final = ("stiffness K''", "kN/m")
TANGENT: Final = ("tan δ", "1")
MAGNITUDE: Final = ("stiffness |K|", "kN/m")
SECANT: Final = ("secant stiffness", "kN/m")
DAMPING: Final = ("damping c", "kN*s/m")
AREA: Final = ("effective area", "m2")
VOLUME: Final = ("volume over volume at the centre", "1")
TEMPERATURE: Final = ("temperature", "degC")


def keep(
    run: Run,
    name: str,
    group: str,
    x: Quantity,
    y: Quantity,
    xs: Sequence[float],
    ys: Sequence[float | Measured],
    limits: Iterable[Band] = (),
) -> None:
    """Record ``ys`` over ``xs`` (SI) as one curve of the plot ``group``, with the ``limits`` of each point, if any."""
    run.curve(name, _axis(*x), _axis(*y), xs, ys, group=group, limits=limits)
