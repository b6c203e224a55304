"""The faults of the CAN bus, by name."""

from collections.abc import Callable
from typing import Final

from bench_protocol.frames import STANDARD_ID_MAX
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_sim.rig.faults.bus_stage import (
    ALL,
    BOTH,
    FROM_RIG,
    TO_RIG,
    Babble,
    BrokenSum,
    Corrupted,
    Delayed,
    Doubled,
    Dropped,
    FrameFault,
    Miscounted,
    Silence,
)
from bench_sim.rig.faults.fault import Begin, Fault, FaultChoice, FaultNumber, FaultPlace, Values
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.schedule import Undo

_DIRECTION: Final = FaultChoice("direction", (FROM_RIG, TO_RIG, BOTH), "direction of the frames", BOTH)
_MESSAGE: Final = FaultChoice(
    "message", (ALL, *(message.name for message in TABLE.messages)), "affected frames", ALL
)
_SEED: Final = FaultNumber("seed", "1", 0, 1_000_000, "random seed", 0, whole=True)


def _chance(percent: float) -> FaultNumber:
    return FaultNumber("probability", "%", 0.01, 100, "of each frame", percent)


_WHICH: Final = (_DIRECTION, _MESSAGE, _SEED)


def _frames(make: Callable[[Values], FrameFault]) -> Begin:
    def begin(points: InsertionPoints, values: Values) -> Undo:
        return points.on_bus(make(values))

    return begin


def _drawn(kind: type[FrameFault]) -> Begin:
    return _frames(lambda v: kind(v["direction"], v["message"], v["probability"], int(v["seed"])))


def _delayed(v: Values) -> FrameFault:
    by, jitter = (round(v[name] * NS) for name in ("by", "jitter"))
    return Delayed(by, jitter, direction=v["direction"], message=v["message"], seed=int(v["seed"]))


def _cut(points: InsertionPoints, values: Values) -> Undo:
    del values
    undos = points.on_bus(Silence()), points.cut("can")

    def undo() -> None:
        for one in undos:
            one()

    return undo


FAULTS: Final = (
    Fault(
        "drop",
        FaultPlace.BUS,
        "Frames vanish from the bus.",
        "The sample counters have gaps (`LOST`). 100 % towards the rig: HOLD after 100 ms, the safe position after "
        "500 ms. 100 % from the rig: readings become stale (NaN).",
        _drawn(Dropped),
        (_chance(10), *_WHICH),
    ),
    Fault(
        "duplicate",
        FaultPlace.BUS,
        "Frames are sent twice, as by a faulty repeater.",
        "The second frame is refused as repeated, and readings stay correct. Duplicate commands are counted in "
        "`rig.rejected_commands`.",
        _drawn(Doubled),
        (_chance(100), *_WHICH),
    ),
    Fault(
        "corrupt",
        FaultPlace.BUS,
        "One bit of a frame is wrong, and the CRC of CAN is valid, as behind a faulty gateway.",
        "A command fails its CRC and is counted in `rig.rejected_commands`. A frame of the rig has only a counter: "
        "a reading jumps, or a gap is counted.",
        _drawn(Corrupted),
        (_chance(10), *_WHICH),
    ),
    Fault(
        "delay",
        FaultPlace.BUS,
        "Frames arrive late. With jitter, their order can change.",
        "The time stamps are later by the delay. Readings older than their age limit are stale, and overtaken "
        "frames are refused. Commands later than 100 ms lead to HOLD once, when the delay begins.",
        _frames(_delayed),
        (
            FaultNumber("by", "ms", 0.1, 2000, "smallest delay", 20),
            FaultNumber("jitter", "ms", 0, 1000, "largest additional delay", 0),
            *_WHICH,
        ),
    ),
    Fault(
        "babble",
        FaultPlace.BUS,
        "A faulty node sends one identifier continuously.",
        "Unknown frames arrive at this rate. If the bus has a bit rate and the identifier is low, all other frames "
        "wait.",
        _frames(lambda v: Babble(int(v["identifier"]), v["rate"])),
        (
            FaultNumber("identifier", "1", 0, STANDARD_ID_MAX, "of its frames", 0, whole=True),
            FaultNumber("rate", "Hz", 1, 8000, "of its frames", 2000),
        ),
    ),
    Fault(
        "bus_off",
        FaultPlace.BUS,
        "The CAN controller of the rig is in the state bus off, but connections stay open.",
        "No frames arrive, and all readings become stale. The rig receives no command: HOLD after 100 ms, the safe "
        "position after 500 ms. Modbus works, and reports the state.",
        _frames(lambda v: Silence()),
    ),
    Fault(
        "wrong_counter",
        FaultPlace.BUS,
        "The counters of frames are wrong: they do not change (step -1), or they leave out numbers.",
        "With step -1, each frame after the first is refused as repeated, readings become stale, and the rig "
        "holds. With other steps, the missing numbers are counted as lost frames.",
        _frames(
            lambda v: Miscounted(
                int(v["step"]), direction=v["direction"], message=v["message"], seed=int(v["seed"])
            )
        ),
        (
            FaultNumber(
                "step", "1", -1, 100, "additional change of the counter in each frame", -1, whole=True
            ),
            *_WHICH,
        ),
    ),
    Fault(
        "wrong_crc",
        FaultPlace.BUS,
        "The CRC of commands is wrong.",
        "The rig counts each command in `rig.rejected_commands` and executes none: HOLD after 100 ms, the safe "
        "position after 500 ms.",
        _frames(lambda v: BrokenSum(TO_RIG, ALL, v["probability"], int(v["seed"]))),
        (_chance(100), _SEED),
    ),
    Fault(
        "interface_down",
        FaultPlace.BUS,
        "The CAN interface of the rig goes down, and up again at the end.",
        "The connection to the hub and new connections are closed at once (`LinkLost`). On SocketCAN no frames "
        "arrive. The rig holds when it detects the closed connection, or else after 100 ms.",
        _cut,
    ),
)
