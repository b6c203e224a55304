"""CAN ports without a bus: one in memory for virtual time, and a simulated faulty link for any port."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench_protocol.frames import Block, join
from drivers.errors import LinkLost

if TYPE_CHECKING:
    from drivers.can_port import CanPort, OnFrames, OnLost
    from drivers.wire import Wire


class InMemoryCan:
    """A ``CanPort`` without a bus. Sent frames go to the given function; frames given to ``receive`` reach the
    subscribers.
    """

    wire: Wire | None = None

    def __init__(self, send: OnFrames) -> None:
        self.local_ports: set[int] = set()
        self._send = send
        self._subscribers: tuple[OnFrames, ...] = ()
        self._lost_callbacks: list[OnLost] = []
        self._lost = ""

    def send(self, block: Block) -> None:
        """Pass the frames to the function. Raises LinkLost if the bus is lost."""
        if self._lost:
            raise LinkLost(self._lost)
        self._send(block)

    def receive(self, block: Block) -> None:
        """Pass frames of the simulated bus to the subscribers."""
        if block.size and not self._lost:
            for callback in self._subscribers:
                callback(block)

    @property
    def lost(self) -> bool:
        """Whether the bus is lost."""
        return bool(self._lost)

    def lose(self, reason: str) -> None:
        """Simulate the loss of the bus."""
        if self._lost:
            return
        self._lost = reason
        callbacks, self._lost_callbacks = self._lost_callbacks, []
        for callback in callbacks:
            callback(reason)

    def subscribe(self, callback: OnFrames) -> None:
        """Call ``callback(block)`` with everything received from now on."""
        self._subscribers += (callback,)

    def on_lost(self, callback: OnLost) -> None:
        """Call ``callback(reason)`` once when the bus is lost; at once if it is lost already."""
        if self._lost:
            callback(self._lost)
        else:
            self._lost_callbacks.append(callback)

    def close(self) -> None:
        """Leave the bus."""
        self._lost = self._lost or "the bus in memory was closed"


@dataclass(frozen=True, slots=True)
class Faults:
    """Probability of each fault per frame, 0 to 1."""

    lose: float = 0.0
    double: float = 0.0
    delay: float = 0.0  #: the frame arrives up to ``delay_frames`` frames late
    echo: float = 0.0  #: a sent frame is received by its sender, as on a real bus
    delay_frames: int = 20

    def __post_init__(self) -> None:
        for name in ("lose", "double", "delay", "echo"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name):g} is not a probability; use 0 to 1")
        if not 1 <= self.delay_frames <= 10_000:
            raise ValueError(f"delay_frames = {self.delay_frames} is out of range; use 1 to 10000")


class _Mishaps:
    """Applies faults to the frames of one direction; equal seeds give equal faults."""

    def __init__(self, faults: Faults, chance: random.Random) -> None:
        self._faults, self._chance = faults, chance
        self._held: list[tuple[int, Block]] = []
        self._passed = 0

    def through(self, block: Block) -> Block:
        """Return the frames of ``block`` with the simulated faults: some are lost, doubled or delayed."""
        faults, chance, out = self._faults, self._chance, []
        for k in range(block.size):
            frame = block[k : k + 1]
            self._passed += 1
            # Always draw four numbers per frame, so that one fault does not change those of later frames.
            lost, doubled, delayed, wait = (chance.random() for _ in range(4))
            if delayed < faults.delay:
                self._held.append((self._passed + 1 + int(wait * faults.delay_frames), frame.copy()))
            elif lost >= faults.lose:
                out += [frame, frame] if doubled < faults.double else [frame]
            due = [held for held in self._held if held[0] <= self._passed]
            self._held = [held for held in self._held if held[0] > self._passed]
            out += [held[1] for held in due]
        return join(out)


class FaultyCan:
    """Wraps a ``CanPort``: frames in both directions are lost, doubled or delayed; own frames come back as echoes.

    ``outward`` are the faults of sent frames if they differ from the ``faults`` of received ones.
    """

    wire: Wire | None = None  # frames written to the wire directly would have no faults

    @property
    def local_ports(self) -> set[int]:
        """The TCP ports of the wrapped port."""
        return self._port.local_ports

    def __init__(self, port: CanPort, faults: Faults, seed: int, *, outward: Faults | None = None) -> None:
        sent = outward or faults
        self._port, self._echo = port, sent.echo
        self._outward = _Mishaps(sent, random.Random(f"out {seed}"))
        self._inward = _Mishaps(faults, random.Random(f"in {seed}"))
        self._echoes = random.Random(f"echo {seed}")
        self._subscribers: tuple[OnFrames, ...] = ()
        port.subscribe(self._receive)

    def send(self, block: Block) -> None:
        """Apply the simulated faults to the frames of ``block``, and send the remaining ones."""
        survivors = self._outward.through(block)
        if survivors.size:
            self._port.send(survivors)
        echoed = np.array([self._echoes.random() < self._echo for _ in range(block.size)], bool)
        if echoed.any():
            self._hand_on(block[echoed])

    def subscribe(self, callback: OnFrames) -> None:
        """Call ``callback(block)`` with the received frames that remain after the simulated faults."""
        self._subscribers += (callback,)

    def on_lost(self, callback: OnLost) -> None:
        """Call ``callback(reason)`` when the wrapped port is lost."""
        self._port.on_lost(callback)

    def close(self) -> None:
        """Leave the bus."""
        self._port.close()

    def _receive(self, block: Block) -> None:
        survivors = self._inward.through(block)
        if survivors.size:
            self._hand_on(survivors)

    def _hand_on(self, block: Block) -> None:
        for callback in self._subscribers:
            callback(block)
