"""The timing of a real CAN bus: duration of frames, arbitration by identifier, errors and repetition.

Sources: ISO 11898-1 for lengths, arbitration, error frames and fault confinement.
"""

import heapq
import itertools
import random
import re
import struct
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal

import numpy as np

from bench_protocol.frames import FRAME, Block, empty_block
from bench_protocol.units import NS
from bench_sim.rig.can_bus import RIG, Stage
from bench_sim.rig.frame_time import INTERMISSION, arbitration_key, frame_bits, worst_bits

BIT_RATES: Final = (10_000, 1_000_000)
#: An error flag of six bits, up to six more of those who notice later, the delimiter, and the intermission.
_ERROR_FRAME: Final = 6 + 6 + 8 + INTERMISSION
#: An error-passive node waits for this number of bits before it sends again.
_SUSPENDED: Final = 8
_PASSIVE_ABOVE: Final = 127
_OFF_ABOVE: Final = 255
#: Runs of eleven recessive bits after which a node comes back; each frame on the bus ends with one.
_RECOVERY_RUNS, _RUN_BITS = 128, 11
#: Frames of one node that may wait; more are lost, as in a full transmit queue.
WAITING_MAX: Final = 1024
#: The load is taken every 100 ms over the last ten of them.
_LOAD_EVERY, _LOAD_TIMES = NS // 10, 10
_TIME: Final = struct.Struct("<q")


def read_bit_rate(text: str) -> float:
    """Return the bit rate (bit/s) from a text such as 500k, 1M or 83333. Raises ValueError for another form."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([kM]?)", text.strip())
    if not found:
        raise ValueError(f"bit_rate = {text} is not a bit rate; use 500k, 1M or a number of bit/s")
    return float(found[1]) * {"": 1.0, "k": 1e3, "M": 1e6}[found[2]]


class NodeState(StrEnum):
    """The state of a node on the bus, which follows from its error counters."""

    ACTIVE = "error active"
    PASSIVE = "error passive"
    OFF = "bus off"


@dataclass(slots=True)
class Node:
    """One node on the bus, with its error counters and queue."""

    transmit_errors: int = 0
    receive_errors: int = 0
    waiting: int = 0  #: frames in its send queue
    lost: int = 0  #: frames that found its queue full or the node off the bus
    spoilt: int = 0  #: frames that go wrong next
    runs: float = 0.0  #: of recessive bits since it went off the bus
    off_since: int = -1  #: ns

    @property
    def state(self) -> NodeState:
        """Return the present state."""
        if self.off_since >= 0:
            return NodeState.OFF
        passive = max(self.transmit_errors, self.receive_errors) > _PASSIVE_ABOVE
        return NodeState.PASSIVE if passive else NodeState.ACTIVE


@dataclass(frozen=True, slots=True, order=True)
class _Waiting:
    """A frame in the send queue of a node."""

    key: int  #: the smaller one has priority
    number: int  #: and of equals the older
    ready: int
    peer: str
    record: bytes
    bits: int


class Pace(Stage):
    """A bus with ``bit_rate`` in bit/s. Every frame gets the time of its end on the bus as its time stamp.

    ``stuffing`` is "exact" to count the stuff bits of each frame, or "worst" for the largest possible number. A
    fraction ``error_rate`` of the frames fails at a random bit (random ``seed``), causes an error frame, and is
    repeated. A node in the state bus off returns after 128 runs of eleven recessive bits, which are counted from
    ``restart`` s on. Every frame is acknowledged. ``tell(load, errors)`` is called every 100 ms with the bus load of
    the last second, and with the transmit error counter of the rig.
    """

    rank = Stage.PACE

    def __init__(
        self,
        bit_rate: float,
        *,
        stuffing: Literal["exact", "worst"] = "exact",
        error_rate: float = 0.0,
        restart: float = 0.0,
        seed: int = 0,
        tell: Callable[[float, int], None] | None = None,
    ) -> None:
        low, high = BIT_RATES
        if not low <= bit_rate <= high:
            raise ValueError(
                f"bit_rate = {bit_rate:g} bit/s is not possible for classic CAN; use {low:,} to {high:,}"
            )
        if not 0 <= error_rate < 1:
            raise ValueError(
                f"error_rate = {error_rate:g} is not a fraction of the frames; use 0 or more, and less than 1"
            )
        if not restart >= 0:
            raise ValueError(f"restart = {restart:g} s is negative; use 0 s or more")
        self._bit = NS / bit_rate
        self._exact, self._error_rate = stuffing == "exact", error_rate
        self._restart, self._chance = round(restart * NS), random.Random(seed)
        self._numbers = itertools.count()
        self._arriving: list[tuple[int, int, _Waiting]] = []
        self._contending: list[_Waiting] = []
        self._done: list[tuple[int, str, bytes]] = []
        self._free_at = 0.0  # when the bus is idle again
        self._busy = 0.0  # ns in all
        self._busy_at: deque[tuple[int, float]] = deque(maxlen=_LOAD_TIMES + 1)
        self._tell = tell
        #: The nodes that have sent something, by name.
        self.nodes: dict[str, Node] = {RIG: Node()}

    @property
    def load(self) -> float:
        """Return the bus load of the last second, from 0 to 1."""
        if len(self._busy_at) < 2:
            return 0.0
        (since, before), (until, busy) = self._busy_at[0], self._busy_at[-1]
        return min(1.0, (busy - before) / (until - since))

    @property
    def waiting(self) -> int:
        """Return the number of frames in all send queues."""
        return len(self._arriving) + len(self._contending)

    def spoil(self, peer: str, frames: int) -> None:
        """Let the next ``frames`` transmissions of ``peer`` fail. After 32 failures in a row it is in the state bus
        off.
        """
        self._node(peer).spoilt += frames

    def outgoing(self, block: Block, now: int) -> Block:
        return self.incoming(block, RIG, now)

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        del now
        node, data, size = self._node(peer), block.tobytes(), FRAME.itemsize
        if self._exact:
            bits = frame_bits(block).tolist()
        else:
            bits = [worst_bits(int(one["length"]), extended=bool(one["extended"])) for one in block]
        times, ids, formats = block["time"].tolist(), block["id"].tolist(), block["extended"].tolist()
        for k, ready in enumerate(times):
            if node.off_since >= 0 or node.waiting >= WAITING_MAX:
                node.lost += 1
                continue
            node.waiting += 1
            number, key = next(self._numbers), arbitration_key(ids[k], extended=bool(formats[k]))
            entry = _Waiting(key, number, ready, peer, data[k * size : (k + 1) * size], bits[k])
            heapq.heappush(self._arriving, (ready, number, entry))
        return empty_block()

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        while self._next(now):
            pass
        self._recover(now)
        self._measure(now)
        ended = next((k for k, (end, _, _) in enumerate(self._done) if end > now), len(self._done))
        ready, self._done = self._done[:ended], self._done[ended:]
        for peer, run in itertools.groupby(ready, key=lambda one: one[1]):
            yield np.frombuffer(bytearray(b"".join(record for _, _, record in run)), FRAME), peer

    def forget(self, peer: str) -> None:
        self.nodes.pop(peer, None)

    def receives(self, peer: str) -> bool:
        """Return whether ``peer`` receives frames. In the state bus off it does not."""
        return self._node(peer).off_since < 0

    def _node(self, peer: str) -> Node:
        return self.nodes.setdefault(peer, Node())

    def _next(self, now: int) -> bool:
        """Take one frame from the queues if its transmission begins at ``now`` (ns) or before. Return whether there was
        one. A frame of a node in the state bus off is lost.
        """
        begin = self._free_at
        if not self._contending:
            if not self._arriving:
                return False
            begin = max(begin, self._arriving[0][0])
        if begin > now:
            return False
        while self._arriving and self._arriving[0][0] <= begin:
            heapq.heappush(self._contending, heapq.heappop(self._arriving)[2])
        entry = heapq.heappop(self._contending)
        node = self._node(entry.peer)
        node.waiting -= 1
        if node.off_since >= 0:
            node.lost += 1
            return True
        idle_runs = (begin - self._free_at) / (_RUN_BITS * self._bit) if self._free_at else 0.0
        if node.spoilt or (self._error_rate and self._chance.random() < self._error_rate):
            bits = self._fail(entry, node, begin)
        else:
            bits = entry.bits
            self._succeed(entry, node, begin)
        self._busy += bits * self._bit
        self._free_at = begin + bits * self._bit
        for one in self.nodes.values():
            if one.off_since >= 0 and begin >= one.off_since + self._restart:
                one.runs += 1 + idle_runs
        return True

    def _succeed(self, entry: _Waiting, node: Node, begin: float) -> None:
        end = round(begin + (entry.bits - INTERMISSION) * self._bit)
        self._done.append((end, entry.peer, _TIME.pack(end) + entry.record[_TIME.size :]))
        node.transmit_errors = max(0, node.transmit_errors - 1)
        for one in self.nodes.values():
            if one is not node:
                one.receive_errors = max(0, min(one.receive_errors, _PASSIVE_ABOVE + 1) - 1)

    def _fail(self, entry: _Waiting, node: Node, begin: float) -> int:
        """Let the frame fail at a random bit. Return how many bits it has occupied the bus."""
        node.spoilt = max(0, node.spoilt - 1)
        passive = node.state is NodeState.PASSIVE
        bits = 1 + self._chance.randrange(entry.bits - INTERMISSION) + _ERROR_FRAME + _SUSPENDED * passive
        node.transmit_errors += 8
        for one in self.nodes.values():
            if one is not node:
                one.receive_errors = min(_OFF_ABOVE, one.receive_errors + 1)
        if node.transmit_errors > _OFF_ABOVE:
            node.off_since, node.runs = round(begin + bits * self._bit), 0.0
            node.lost += 1
        else:
            node.waiting += 1
            heapq.heappush(self._contending, entry)
        return bits

    def _recover(self, now: int) -> None:
        """Return nodes to the bus that, at ``now`` (ns), have been in the state bus off for long enough."""
        for node in self.nodes.values():
            if node.off_since < 0:
                continue
            idle_from = max(self._free_at, node.off_since + self._restart)
            if node.runs + max(0.0, now - idle_from) / (_RUN_BITS * self._bit) >= _RECOVERY_RUNS:
                node.off_since, node.transmit_errors, node.receive_errors = -1, 0, 0

    def _measure(self, now: int) -> None:
        if self._busy_at and now - self._busy_at[-1][0] < _LOAD_EVERY:
            return
        self._busy_at.append((now, self._busy))
        if self._tell is not None:
            self._tell(self.load, self.nodes[RIG].transmit_errors)
