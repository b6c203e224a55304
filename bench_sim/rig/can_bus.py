"""The CAN bus between the rig and its server: a chain of stages that every block of frames goes through, both ways."""

import threading
from collections.abc import Callable, Iterable
from typing import ClassVar, Final, Protocol

from bench_protocol.clock import Clock, Task
from bench_protocol.frames import Block
from bench_sim.rig.controls import TICK_NS

#: The rig itself, among the names of those who send.
RIG: Final = "rig"


class Stage:
    """Something that befalls frames on their way from a sender to all others: a fault, the bus's pace, a recording.

    A block belongs to a stage while it has it: it may be changed in place, kept, or come back longer or shorter.
    Times (ns) are those of the frames' stamps. This one changes nothing.
    """

    #: Stages stand in this order, seen from every sender; equal ones in the order in which they were added.
    rank: ClassVar[int] = 0
    FAULT: Final = 0
    PACE: Final = 1
    RECORD: Final = 2

    def outgoing(self, block: Block, now: int) -> Block:
        """Return what goes on, now, of frames that the rig sends."""
        del now
        return block

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        """Return what goes on, now, of frames that ``peer`` sends."""
        del peer, now
        return block

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        """Return what has been kept and goes on now, with the name of its sender; asked every millisecond."""
        del now
        return ()

    def receives(self, peer: str) -> bool:
        """Return whether what is kept reaches ``peer`` at all."""
        del peer
        return True

    def forget(self, peer: str) -> None:
        """Take note that ``peer`` has left the bus."""


class CanServer(Protocol):
    """Where the frames of the bus leave for other programs."""

    def publish(self, block: Block) -> None:
        """Send frames of the rig to everybody."""

    def relay(self, block: Block, peer: str) -> None:
        """Send frames of ``peer`` to everybody else."""


class CanBus:
    """Passes frames between the rig, which ``receive(block, peer)`` s, and a server; an empty chain costs nothing.

    ``now()`` is the time of the frames' stamps (ns); ``clock`` wakes stages that keep frames every millisecond.
    Thread-safe.
    """

    def __init__(self, receive: Callable[[Block, str], None], clock: Clock, now: Callable[[], int]) -> None:
        self._receive, self._clock, self._now = receive, clock, now
        self._server: CanServer | None = None
        self._stages: tuple[Stage, ...] = ()
        self._lock = threading.RLock()  # frames go on in the order in which they leave the chain
        self._ticking: Task | None = None

    def connect(self, server: CanServer) -> None:
        """Send from now on what the rig sends, and what has been kept, through ``server``."""
        self._server = server

    def add(self, stage: Stage) -> None:
        """Put ``stage`` in its place in the chain."""
        with self._lock:
            self._stages = tuple(sorted((*self._stages, stage), key=lambda one: one.rank))
            if self._ticking is None and self._keeping:
                self._ticking = self._clock.every(TICK_NS, self.poll)

    def remove(self, stage: Stage) -> None:
        """Take ``stage`` out; what it kept is lost. ValueError if it is not in the chain."""
        with self._lock:
            if stage not in self._stages:
                raise ValueError(f"{type(stage).__name__} is not on the bus: it cannot be taken off")
            self._stages = tuple(one for one in self._stages if one is not stage)
            idle = None if self._keeping else self._ticking
            self._ticking = None if idle else self._ticking
        if idle:
            idle.cancel()

    def close(self) -> None:
        """Take all stages out."""
        for stage in self._stages:
            self.remove(stage)

    def publish(self, block: Block) -> None:
        """Take frames from the rig to everybody else."""
        if not self._stages:
            self._send(block, RIG)
            return
        with self._lock:
            self._send(self._through(self._stages, block, RIG), RIG)

    def carry(self, block: Block, peer: str) -> Block:
        """Return what reaches everybody else now of the frames that ``peer`` sends: the server passes it on."""
        if not self._stages:
            return block
        with self._lock:
            return self._through(self._stages, block, peer)

    def take(self, block: Block, peer: str) -> None:
        """Take frames of ``peer`` to the rig, from a server whose other clients have received them already."""
        block = self.carry(block, peer)
        if block.size:
            self._receive(block, peer)

    def forget(self, peer: str) -> None:
        """Tell the stages that ``peer`` has left the bus."""
        for stage in self._stages:
            stage.forget(peer)

    def poll(self) -> None:
        """Send on what is due of that which the stages have kept."""
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
    def _keeping(self) -> bool:
        """Whether one of the stages keeps frames for later."""
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
