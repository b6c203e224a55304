"""Whether a reason is true: every sentence that may block a plan, against what the rig really is at that moment."""

import re
from collections.abc import Callable, Iterator

from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import bar
from bench_protocol.words import AIR_BY_STATE, SIDES

#: What a bench without air may still have, and how far a transducer is off.
_RESIDUAL, _OFF = 0.2 * bar, 0.1 * bar


def _fault_on(name: str) -> Callable[[object], bool]:
    return lambda rig: any(one.fault.name == name for one in rig.faults.active)


#: The named cause of a reason, whether it is right, the advised action, and the cause in short.
CAUSES: tuple[tuple[str, Callable[[object], bool], str, str], ...] = (
    (
        "the emergency stop is pressed",
        lambda rig: rig.supervisor.estop,
        "release the button",
        "emergency stop pressed",
    ),
    ("the mains are off", lambda rig: not rig.supervisor.mains, "switch them on", "mains off"),
    (r"supply pressure (is \d|.*\(\d)", _fault_on("supply_loss"), "open the supply", "no supply of air"),
    (
        "the CAN interface of the rig is down",
        _fault_on("interface_down"),
        "its CAN interface is up",
        "CAN interface down",
    ),
    (
        "the device does not answer",
        _fault_on("hung_plc"),
        "check that the device runs and can be reached",
        "PLC silent",
    ),
    (
        "because their CRC or counter is wrong",
        _fault_on("wrong_crc"),
        "check the devices between this computer and the bench",
        "frames spoilt",
    ),
    (
        r"(pressure|height) is unavailable \(its transducer gives no value",
        _fault_on("broken_wire"),
        "repair it",
        "transducer dead",
    ),
    (
        "the bench is held by the commander with token",
        lambda rig: rig.lease.token != 0,
        "that client releases the bench",
        "still held by the first",
    ),
)


def pressures(rig) -> dict[str, float]:
    """Return the true pressure (Pa gauge) of each side, the higher one of its chambers."""
    ideal = dict(zip([signal.name for signal in MEASUREMENTS], rig.plant.ideal(), strict=True))
    return {
        side: max(ideal[f"{side}.{chamber}_pressure"] for chamber in ("bellows", "auxiliary"))
        for side in SIDES
    }


def untruths(reason: str, rig) -> Iterator[str]:
    """Yield everything in ``reason`` that is not so, or that is missing: a cause that is true, and what to do."""
    yield from of_the_air(reason, rig)
    if "another client tries to command" in reason:
        yield "nobody else tries to command the bench"
    named = [one for one in CAUSES if re.search(one[0], reason)]
    if not named:
        yield "no known cause is named"
    for cause, is_so, remedy, _ in named:
        if not is_so(rig):
            yield f"it is not so: {cause}"
        if remedy not in reason:
            yield f"{cause}: nobody is told to {remedy}"


def of_the_air(reason: str, rig) -> Iterator[str]:
    """Yield everything that ``reason`` says of the air and of who is near it that is not so, or does not say."""
    true = pressures(rig)
    for told, side in re.findall(r"([\d.]+) bar on the (left|right)", reason):
        if abs(float(told) * bar - true[side]) > _OFF:
            yield f"{told} bar on the {side} are {true[side] / bar:.2f} bar"
    if "without pressure" in reason and max(true.values()) > _RESIDUAL + _OFF:
        yield "the springs hold pressure"
    if "keep away" in reason and not reason.startswith("keep away"):
        yield "what a person has to do does not come first"
    for state in re.findall(r"the bench, in ([A-Z_]+), ", reason):
        fate = {
            "vents the springs": "let off",
            "keeps its valves": "shut in",
            "keeps the air as": "as ordered",
        }
        said = next(fate[words] for words in fate if f"{state}, {words}" in reason)
        if AIR_BY_STATE[rig.state.name] != said:
            yield f"in {rig.state.name} the bench does otherwise with the air"
    connected = not reason.startswith("connecting:")  # else it knows nothing of the springs, and says nothing
    if connected and max(true.values()) > _RESIDUAL + _OFF and "keep away" not in reason:
        yield "the springs hold pressure, and nobody is told to keep away"
