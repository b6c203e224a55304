"""What plans read on the bench: which signals belong together, and how late each transducer is."""

from __future__ import annotations

from typing import Final

from bench_protocol.table import SIDES
from bench_protocol.units import ms, s

#: Vertical load cells under each spring: they stand below the springs, 1 m to either side.
CELLS_UNDER: Final = {"left": ("load_cell.1", "load_cell.3"), "right": ("load_cell.2", "load_cell.4")}
VERTICAL_CELLS: Final = tuple(cell for pair in CELLS_UNDER.values() for cell in pair)
SHEAR_CELLS: Final = ("load_cell.5", "load_cell.6")
HEIGHTS: Final = tuple(f"{side}.height" for side in SIDES)
CHAMBERS: Final = ("bellows", "auxiliary")
PRESSURES: Final = tuple(f"{side}.{chamber}_pressure" for side in SIDES for chamber in CHAMBERS)
BELLOWS_TEMPERATURES: Final = tuple(f"{side}.bellows_temperature" for side in SIDES)
#: Where the generator is in its program.
GENERATOR: Final = ("rig.program", "rig.generator_cycle")

#: Data sheets: the lasers are 2 ms late, load cells and transducers of the actuators 1 ms, thermometers 1 s.
LASER_LAG: Final = 2 * ms
LOAD_CELL_LAG: Final = 1 * ms
TRANSDUCER_LAG: Final = 1 * ms
ACCELEROMETER_LAG: Final = 1 * ms
THERMOMETER_LAG: Final = 1 * s
