"""The faults of the rig as a whole, by name."""

from typing import Final

from bench_protocol.rates import TICK
from bench_protocol.units import NS
from bench_sim.rig.faults.fault import Fault, FaultNumber, FaultPlace, Values
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.modbus_filter import Mute
from bench_sim.rig.faults.schedule import Undo


def _late_ticks(points: InsertionPoints, v: Values) -> Undo:
    by = round(v["by"] * NS)
    return points.schedule.every(max(1, round(v["every"] / TICK)), lambda: points.rig.stall(by))


def _hung(points: InsertionPoints, v: Values) -> Undo:
    del v
    points.rig.hold_program()
    return points.modbus.add(Mute())


def _estop(points: InsertionPoints, v: Values) -> Undo:
    del v
    points.rig.press_estop()
    return points.rig.release_estop


def _power_loss(points: InsertionPoints, v: Values) -> Undo:
    del v
    points.rig.set_mains(there=False)
    return lambda: points.rig.set_mains(there=True)


FAULTS: Final = (
    Fault(
        "late_ticks",
        FaultPlace.RIG,
        "The computer of the rig pauses repeatedly. In virtual time the fault has no effect.",
        "`rig.late_ticks` and `rig.lateness_max` grow. Frames arrive in bursts, with the time stamps of their "
        "deadlines.",
        _late_ticks,
        (
            FaultNumber("by", "ms", 1, 1000, "length of a pause", 20),
            FaultNumber("every", "s", 0.01, 3600, "time between two pauses", 1),
        ),
    ),
    Fault(
        "hung_plc",
        FaultPlace.RIG,
        "The program of the PLC hangs: its sockets are open, but it does not answer.",
        "Connections are accepted, but requests are not answered (`LinkLost` after the time-out), and the function "
        "generator stops. CAN, watchdog and interlocks do not depend on the PLC and work.",
        _hung,
    ),
    Fault(
        "estop",
        FaultPlace.RIG,
        "A person presses the emergency stop, and releases it at the end.",
        "ESTOP with its reason and an emergency message; the springs are vented. A reset is refused until the "
        "release.",
        _estop,
    ),
    Fault(
        "power_loss",
        FaultPlace.RIG,
        "Valves and actuators lose their power. Sensors and communication have a battery.",
        "OFF: the bolster is held until the springs are vented, then set down and unloaded. Power on is refused "
        "until the fault ends. The bench does not start again by itself.",
        _power_loss,
    ),
)
