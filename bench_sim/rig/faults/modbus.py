"""The faults of Modbus/TCP, by name."""

from collections.abc import Callable
from typing import Final

from bench_sim.rig.faults.fault import Begin, Fault, FaultChoice, FaultNumber, FaultPlace, Values
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.modbus_filter import (
    ALL,
    READS,
    WRITES,
    Junk,
    Mute,
    Refusal,
    RequestFault,
    Slow,
    Split,
)
from bench_sim.rig.faults.schedule import Undo

_REQUESTS: Final = FaultChoice("requests", (READS, WRITES, ALL), "affected requests", ALL)
_SEED: Final = FaultNumber("seed", "1", 0, 1_000_000, "random seed", 0, whole=True)
_CHANCE: Final = FaultNumber("probability", "%", 0.01, 100, "of each request", 100)
_WHICH: Final = (_CHANCE, _REQUESTS, _SEED)


def _requests(make: Callable[[Values], RequestFault]) -> Begin:
    def begin(points: InsertionPoints, values: Values) -> Undo:
        return points.modbus.add(make(values))

    return begin


def _restart(points: InsertionPoints, values: Values) -> Undo:
    del values
    undo = points.cut("modbus")
    points.rig.cut_power()

    def back() -> None:
        points.rig.power_on()
        undo()

    return back


FAULTS: Final = (
    Fault(
        "modbus_exception",
        FaultPlace.MODBUS,
        "The PLC refuses requests with an exception.",
        "`Refused` with this code and its meaning. Nothing changes on the rig.",
        _requests(lambda v: Refusal(int(v["code"]), v["probability"], v["requests"], int(v["seed"]))),
        (FaultNumber("code", "1", 1, 11, "of the exception", 4, whole=True), *_WHICH),
    ),
    Fault(
        "modbus_silence",
        FaultPlace.MODBUS,
        "Requests to the PLC are lost.",
        "No answer arrives within the time-out, then `LinkLost`. The request was not executed. CAN works.",
        _requests(lambda v: Mute(v["probability"], v["requests"], int(v["seed"]))),
        _WHICH,
    ),
    Fault(
        "modbus_junk",
        FaultPlace.MODBUS,
        "Answers are invalid: from another transaction or unit, or random bytes.",
        "`LinkLost`, and never a reading. The request was executed.",
        _requests(lambda v: Junk(v["what"], v["probability"], v["requests"], int(v["seed"]))),
        (
            FaultChoice(
                "what", (Junk.TRANSACTION, Junk.UNIT, Junk.NOISE), "wrong part of the answer", Junk.NOISE
            ),
            *_WHICH,
        ),
    ),
    Fault(
        "modbus_slow",
        FaultPlace.MODBUS,
        "Answers arrive late.",
        "Each request takes longer. Beyond the time-out of the client it is `LinkLost`.",
        _requests(lambda v: Slow(v["by"])),
        (FaultNumber("by", "ms", 1, 10_000, "delay", 100),),
    ),
    Fault(
        "modbus_split",
        FaultPlace.MODBUS,
        "Answers arrive in small pieces, as through a poor tunnel.",
        "Answers take longer, and the client must join the pieces.",
        _requests(lambda v: Split(int(v["size"]), v["gap"])),
        (
            FaultNumber("size", "1", 1, 250, "bytes of a piece", 3, whole=True),
            FaultNumber("gap", "ms", 0, 1000, "time between two pieces", 5),
        ),
    ),
    Fault(
        "plc_restart",
        FaultPlace.MODBUS,
        "The PLC restarts, for 3 s if no duration is given. Valves and actuators lose their power.",
        "All Modbus connections and new ones are closed at once (`LinkLost`), and the lease ends. CAN reports OFF, "
        "then BOOT, INIT and DISABLED.",
        _restart,
        lasts=3.0,
    ),
)
