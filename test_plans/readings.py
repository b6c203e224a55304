"""What plans read on the bench: which signals belong together, and how late each transducer is."""

from __future__ import annotations

from typing import Final

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import ms, s
from bench_protocol.words import SIDES

#: Vertical load cells under each spring: they stand below the springs, 1 m to either side.
CELLS_UNDER: Final = {"left": ("load_cell.1", "load_cell.3"), "right": ("load_cell.2", "load_cell.4")}
VERTICAL_CELLS: Final = tuple(cell for pair in CELLS_UNDER.values() for cell in pair)
SHEAR_CELLS: Final = BY_GROUP[Group.LATERAL_LOAD_CELL]
HEIGHTS: Final = BY_GROUP[Group.HEIGHT]
CHAMBERS: Final = ("bellows", "auxiliary")
PRESSURES: Final = BY_GROUP[Group.PRESSURE]
BELLOWS_TEMPERATURES: Final = tuple(f"{side}.bellows_temperature" for side in SIDES)
#: Where the generator is in its program.
GENERATOR: Final = ("rig.program", "rig.generator_cycle")

#: Data sheets: the lasers are 2 ms late, load cells and transducers of the actuators 1 ms, thermometers 1 s.
LASER_LAG: Final = 2 * ms
LOAD_CELL_LAG: Final = 1 * ms
TRANSDUCER_LAG: Final = 1 * ms
ACCELEROMETER_LAG: Final = 1 * ms
THERMOMETER_LAG: Final = 1 * s
