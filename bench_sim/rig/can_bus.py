"""The CAN bus between the rig and its server: a chain of stages that process every block of frames, in both
directions.
"""

import threading
from collections.abc import Callable, Iterable
from typing import ClassVar, Final, Protocol

from bench_protocol.clock import Clock, Task
from bench_protocol.frames import Block
from bench_sim.rig.controls import TICK_NS

#: Name of the rig as a sender.
RIG: Final = "rig"


class Stage:
    """Processes frames between a sender and all receivers: a fault, the bit rate of the bus, or a recording.

    A stage owns the block that it receives: it may change the block in place, keep it, or return a longer or shorter
    one. ``now`` is the time (ns) on the clock of the time stamps. This base class changes nothing.
    """

    #: Order of the stages, for every sender; stages of equal rank keep the order in which they were added.
    rank: ClassVar[int] = 0
    FAULT: Final = 0
    PACE: Final = 1
    RECORD: Final = 2

    def outgoing(self, block: Block, now: int) -> Block:
        """Return the frames to pass on now, for a ``block`` that the rig sends."""
        del now
        return block

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        """Return the frames to pass on now, for a ``block`` that ``peer`` sends."""
        del peer, now
        return block

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        """Return the kept blocks that are to be passed on now, with the names of their senders. Called every
        millisecond.
        """
        del now
        return ()

    def receives(self, peer: str) -> bool:
        """Return whether kept frames reach ``peer``."""
        del peer
        return True

    def forget(self, peer: str) -> None:
        """Handle a ``peer`` that has left the bus."""


class CanServer(Protocol):
    """A server that sends the frames of the bus to other programs."""

    def publish(self, block: Block) -> None:
        """Send frames of the rig to all clients."""

    def relay(self, block: Block, peer: str) -> None:
        """Send frames of ``peer`` to all other clients."""


class CanBus:
    """Passes frames between the rig and a server, through the stages. Without stages it costs almost no time.

    ``receive(block, peer)`` passes frames to the rig. ``now()`` is the time of the time stamps (ns). If a stage keeps
    frames for later, ``clock`` polls the stages every millisecond. Thread-safe.
    """

    def __init__(self, receive: Callable[[Block, str], None], clock: Clock, now: Callable[[], int]) -> None:
        self._receive, self._clock, self._now = receive, clock, now
        self._server: CanServer | None = None
        self._stages: tuple[Stage, ...] = ()
        self._lock = threading.RLock()  # frames go on in the order in which they leave the chain
        self._ticking: Task | None = None

    def connect(self, server: CanServer) -> None:
        """Use ``server`` from now on to send the frames of the rig, and frames that stages have kept."""
        self._server = server

    def add(self, stage: Stage) -> None:
        """Insert ``stage`` into the chain by its rank."""
        with self._lock:
            self._stages = tuple(sorted((*self._stages, stage), key=lambda one: one.rank))
            if self._ticking is None and self._keeping:
                self._ticking = self._clock.every(TICK_NS, self.poll)

    def remove(self, stage: Stage) -> None:
        """Remove ``stage``. The frames that it has kept are lost. Raises ValueError if it is not in the chain."""
        with self._lock:
            if stage not in self._stages:
                raise ValueError(f"{type(stage).__name__} is not on the bus, so it cannot be removed")
            self._stages = tuple(one for one in self._stages if one is not stage)
            idle = None if self._keeping else self._ticking
            self._ticking = None if idle else self._ticking
        if idle:
            idle.cancel()

    def close(self) -> None:
        """Remove all stages."""
        for stage in self._stages:
            self.remove(stage)

    def publish(self, block: Block) -> None:
        """Send frames of the rig to all clients."""
        if not self._stages:
            self._send(block, RIG)
            return
        with self._lock:
            self._send(self._through(self._stages, block, RIG), RIG)

    def carry(self, block: Block, peer: str) -> Block:
        """Return the frames of ``peer`` after all stages, to be passed on now. The server sends them to the other
        clients.
        """
        if not self._stages:
            return block
        with self._lock:
            return self._through(self._stages, block, peer)

    def take(self, block: Block, peer: str) -> None:
        """Pass frames of ``peer`` to the rig. This is for a server whose other clients have received them already."""
        block = self.carry(block, peer)
        if block.size:
            self._receive(block, peer)

    def forget(self, peer: str) -> None:
        """Notify the stages that ``peer`` has left the bus."""
        for stage in self._stages:
            stage.forget(peer)

    def poll(self) -> None:
        """Pass on the kept frames whose time has come."""
        received: list[tuple[Block, str]] = []
        with self._lock:
            stages, now = self._stages, self._now()
            for place, stage in enumerate(stages):
                for kept, peer in stage.due(now):
                    block = self._through(stages[place + 1 :], kept, peer)
                    if block.size:
                        self._send(block, peer)
                        received.append((block, peer))
            listening = all(stage.receives(RIG) for stage in stages)
        for block, peer in received:
            if peer != RIG and listening:
                self._receive(block, peer)

    @property
    def staged(self) -> bool:
        """Whether the bus has any stages."""
        return bool(self._stages)

    @property
    def _keeping(self) -> bool:
        """Whether any of the stages can keep frames for later."""
        return any(type(stage).due is not Stage.due for stage in self._stages)

    def _through(self, stages: tuple[Stage, ...], block: Block, peer: str) -> Block:
        now = self._now()
        for stage in stages:
            if not block.size:
                break
            block = stage.outgoing(block, now) if peer == RIG else stage.incoming(block, peer, now)
        return block

    def _send(self, block: Block, peer: str) -> None:
        if self._server is None or not block.size:
            return
        if peer == RIG:
            self._server.publish(block)
        else:
            self._server.relay(block, peer)
