"""The catalogue of faults: everything that can be broken on purpose, by name."""

from difflib import get_close_matches
from typing import Final

from bench_sim.rig.faults import bus, modbus, plant, sensors, whole_rig
from bench_sim.rig.faults.fault import Fault, FaultError

FAULTS: Final[dict[str, Fault]] = {
    fault.name: fault
    for fault in (*bus.FAULTS, *modbus.FAULTS, *sensors.FAULTS, *plant.FAULTS, *whole_rig.FAULTS)
}


def find_fault(name: str) -> Fault:
    """Return the fault called ``name``; FaultError, which says what there is, where there is none."""
    if name in FAULTS:
        return FAULTS[name]
    near = get_close_matches(name, FAULTS, n=1, cutoff=0.5)
    right = f"{near[0]} would be one" if near else "`astb rig fault list` lists them"
    raise FaultError(f"{name} is no fault; {right}")
