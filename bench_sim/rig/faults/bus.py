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

_DIRECTION: Final = FaultChoice("direction", (FROM_RIG, TO_RIG, BOTH), "which way the frames go", BOTH)
_MESSAGE: Final = FaultChoice(
    "message", (ALL, *(message.name for message in TABLE.messages)), "which frames", ALL
)
_SEED: Final = FaultNumber("seed", "1", 0, 1_000_000, "draws the frames", 0, whole=True)


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
        "Gaps in the sample counters (`LOST`); at 100 % towards the rig HOLD after 100 ms and the safe position after "
        "500 ms; at 100 % from the rig readings go stale and read as NaN.",
        _drawn(Dropped),
        (_chance(10), *_WHICH),
    ),
    Fault(
        "duplicate",
        FaultPlace.BUS,
        "Frames come twice, as from a repeater that never saw its acknowledgement.",
        "The second one is refused as repeated: readings stay right; commands that are doubled count in "
        "`rig.rejected_commands`.",
        _drawn(Doubled),
        (_chance(100), *_WHICH),
    ),
    Fault(
        "corrupt",
        FaultPlace.BUS,
        "One bit of a frame's data is wrong, as behind a faulty gateway that makes a new CRC of CAN's own.",
        "A command fails its CRC and counts in `rig.rejected_commands`; a feedback frame has only a counter: a reading "
        "jumps, or the counter does and the frame is refused or a gap is counted.",
        _drawn(Corrupted),
        (_chance(10), *_WHICH),
    ),
    Fault(
        "delay",
        FaultPlace.BUS,
        "Frames come late, with a jitter also in another order.",
        "The stamps of the frames are later by as much; readings whose delay exceeds their age limit are stale, old "
        "ones that overtake are refused; commands later than 100 ms lead to HOLD once, when the delay begins.",
        _frames(_delayed),
        (
            FaultNumber("by", "ms", 0.1, 2000, "how late at least", 20),
            FaultNumber("jitter", "ms", 0, 1000, "how much later at most", 0),
            *_WHICH,
        ),
    ),
    Fault(
        "babble",
        FaultPlace.BUS,
        "A node that has gone mad sends one identifier all the time.",
        "Foreign frames at that rate; where the bus has a bit rate and the identifier is low, everybody else's frames "
        "wait. Nothing is read from them.",
        _frames(lambda v: Babble(int(v["identifier"]), v["rate"])),
        (
            FaultNumber("identifier", "1", 0, STANDARD_ID_MAX, "of its frames", 0, whole=True),
            FaultNumber("rate", "Hz", 1, 8000, "of its frames", 2000),
        ),
    ),
    Fault(
        "bus_off",
        FaultPlace.BUS,
        "The rig's CAN controller is off the bus; the connections stand.",
        "No frame comes any more and all readings go stale; the rig hears no command: HOLD after 100 ms, the safe "
        "position after 500 ms. Modbus goes on, and says so.",
        _frames(lambda v: Silence()),
    ),
    Fault(
        "wrong_counter",
        FaultPlace.BUS,
        "The counters in the frames go wrong: they stand still (step -1) or leave numbers out.",
        "Standing still: every frame after the first is refused as repeated, readings go stale, commands are rejected "
        "and the rig holds. Leaving out: as many lost frames are counted as numbers are missing.",
        _frames(
            lambda v: Miscounted(
                int(v["step"]), direction=v["direction"], message=v["message"], seed=int(v["seed"])
            )
        ),
        (
            FaultNumber("step", "1", -1, 100, "how far a counter goes too far each time", -1, whole=True),
            *_WHICH,
        ),
    ),
    Fault(
        "wrong_crc",
        FaultPlace.BUS,
        "The CRC of commands is wrong.",
        "The rig counts each in `rig.rejected_commands` and acts on none: HOLD after 100 ms, the safe position after "
        "500 ms.",
        _frames(lambda v: BrokenSum(TO_RIG, ALL, v["probability"], int(v["seed"]))),
        (_chance(100), _SEED),
    ),
    Fault(
        "interface_down",
        FaultPlace.BUS,
        "The CAN interface of the rig goes down, and up again at the end.",
        "The connection to the hub closes and new ones are closed at once (`LinkLost`); on SocketCAN the bus falls "
        "silent. The rig holds at once where it sees the connection close, else after 100 ms.",
        _cut,
    ),
)
