"""What plans read on the bench: which signals belong together, and what of them is free of their lag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES
from test_plans.analysis import Samples, first_harmonic, without_lag
from test_plans.description import lag_of

VERTICAL_CELLS: Final = BY_GROUP[Group.VERTICAL_LOAD_CELL]
SHEAR_CELLS: Final = BY_GROUP[Group.LATERAL_LOAD_CELL]
HEIGHTS: Final = BY_GROUP[Group.HEIGHT]
CHAMBERS: Final = ("bellows", "auxiliary")
PRESSURES: Final = BY_GROUP[Group.PRESSURE]
BELLOWS_TEMPERATURES: Final = tuple(f"{side}.bellows_temperature" for side in SIDES)
#: Where the generator is in its program.
GENERATOR: Final = ("rig.program", "rig.generator_cycle")


def harmonic(
    rig: Mapping[str, float], times: Samples, series: Samples, frequency: float, *signals: str
) -> complex:
    """Return the first harmonic of a ``series`` that was computed of these ``signals``, free of their mean lag."""
    return without_lag(first_harmonic(times, series, frequency), lag_of(rig, *signals), frequency)
