"""The catalogue of simulated faults by name."""

from typing import Final

from bench_protocol.suggestion import did_you_mean
from bench_sim.rig.faults import bus, modbus, plant, sensors, whole_rig
from bench_sim.rig.faults.fault import Fault, FaultError

FAULTS: Final[dict[str, Fault]] = {
    fault.name: fault
    for fault in (*bus.FAULTS, *modbus.FAULTS, *sensors.FAULTS, *plant.FAULTS, *whole_rig.FAULTS)
}


def find_fault(name: str) -> Fault:
    """Return the fault called ``name``. Raises FaultError, which suggests similar names, if there is none."""
    if name in FAULTS:
        return FAULTS[name]
    raise FaultError(
        f"{name} is not a fault; {did_you_mean(name, FAULTS, '`astb rig fault list` lists them')}"
    )
