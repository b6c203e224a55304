"""What plans read on the bench: which signals belong together."""

from __future__ import annotations

from typing import Final

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES

VERTICAL_CELLS: Final = BY_GROUP[Group.VERTICAL_LOAD_CELL]
SHEAR_CELLS: Final = BY_GROUP[Group.LATERAL_LOAD_CELL]
HEIGHTS: Final = BY_GROUP[Group.HEIGHT]
CHAMBERS: Final = ("bellows", "auxiliary")
PRESSURES: Final = BY_GROUP[Group.PRESSURE]
BELLOWS_TEMPERATURES: Final = tuple(f"{side}.bellows_temperature" for side in SIDES)
#: Where the generator is in its program.
GENERATOR: Final = ("rig.program", "rig.generator_cycle")
