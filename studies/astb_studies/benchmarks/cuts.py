"""Ways to lose a commander, and a bus client that measures the times until the bench holds and until it is safe."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bench_protocol.can_codec import Decoder
from bench_protocol.frames import Block, empty_block
from bench_protocol.rates import DISABLE_AFTER, HOLD_AFTER
from bench_protocol.table import TABLE
from bench_protocol.units import NS, mm, s
from bench_protocol.words import ACTUATORS, LIVE_STATES, SIDES, STATES
from bench_sim.rig.can_bus import Stage
from bench_sim.rig.safe_position import EMPTY, LOWERING_SPEED, SET_DOWN
from drivers.bench import Bench
from drivers.wiring.astb.transport import WATCHDOG

#: Limits of the table of states: 500 ms until the bench drops its commander, 9 s to vent 7 bar, and the time to lower
#: a bolster from the highest permitted position.
VENTING: Final = 9 * s
SAFE_WITHIN: Final = DISABLE_AFTER + VENTING + 200 * mm / LOWERING_SPEED
_PRESSURES: Final = [
    TABLE.index[f"{side}.{part}_pressure"] for side in SIDES for part in ("bellows", "auxiliary")
]
_FORCES: Final = [TABLE.index[f"{actuator}.force"] for actuator in ACTUATORS if actuator != "lateral"]
_STATE: Final = TABLE.index["rig.state"]
_EMERGENCY: Final = next(message.identifier for message in TABLE.messages if message.name == "Emergency")
#: The largest force that an actuator still shows after its release.
_LET_GO: Final = 2 * SET_DOWN


@dataclass(frozen=True)
class Cut:
    """One way to lose the commander, and the time limit (s) for the bench to hold."""

    name: str
    hold_within: float = HOLD_AFTER

    @property
    def safe_within(self) -> float:
        """Time limit (s) until the bench is safe, increased if it waits longer than for a missing command."""
        return SAFE_WITHIN + self.hold_within - HOLD_AFTER


KILLED: Final = Cut("plan killed (SIGKILL)")
STOPPED: Final = Cut("plan stopped (SIGSTOP)")
CAN_CLOSED: Final = Cut("CAN connection closed")
MODBUS_CLOSED: Final = Cut("Modbus connection closed")
BOTH_CLOSED: Final = Cut("both connections closed")
CAN_HOLE: Final = Cut("CAN becomes a black hole")
MODBUS_HOLE: Final = Cut("Modbus becomes a black hole", WATCHDOG)
ESTOP: Final = Cut("emergency stop")
POWER: Final = Cut("power lost")
#: Those of a process and those of a wire can be made on real sockets; no one cuts the power of a process.
REAL_CUTS: Final = (KILLED, STOPPED, CAN_CLOSED, MODBUS_CLOSED, BOTH_CLOSED, CAN_HOLE, MODBUS_HOLE, ESTOP)
CUTS: Final = (*REAL_CUTS, POWER)


@dataclass
class Witness:
    """Another user on the bus: ``held`` and ``safe`` are the times (s) after the cut at ``since`` (ns); NaN before."""

    since: int = 1 << 62
    held: float = np.nan
    safe: float = np.nan
    _decoder: Decoder = field(default_factory=lambda: Decoder(TABLE))

    def start(self, now: int) -> None:
        """Wait for the reactions to a cut at ``now`` (ns, of the frames' stamps)."""
        self.since, self.held, self.safe = now, np.nan, np.nan

    def receive(self, block: Block) -> None:
        """Take frames of the rig, of any number of instants."""
        for part in np.split(block, np.flatnonzero(np.diff(block["time"])) + 1):
            if part.size:
                self._decoder.decode(part)
                self._judge(part)

    def _judge(self, block: Block) -> None:
        after, latest = (int(block["time"][-1]) - self.since) / NS, self._decoder.latest
        if after < 0 or np.isnan(latest[_STATE]):
            return
        down = STATES[int(latest[_STATE])] not in LIVE_STATES
        if np.isnan(self.held) and (down or (block["id"] == _EMERGENCY).any()):
            self.held = after
        at_rest = (latest[_PRESSURES] < EMPTY).all() and (np.abs(latest[_FORCES]) < _LET_GO).all()
        if np.isnan(self.safe) and down and at_rest:
            self.safe = after


def give_up(bench: Bench) -> None:
    """Do the first step of the tear-down of every plan on the remaining bus: release D."""
    bench.commander.set_all({f"control.{bit}": 0.0 for bit in ("enable", "hold", "active", "reset")})


class Hole(Stage):
    """A bus that drops the frames of its clients."""

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        del block, peer, now
        return empty_block()
