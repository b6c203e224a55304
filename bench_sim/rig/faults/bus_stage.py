"""Faults of the CAN bus: one stage of the bus changes frames between the rig and all other nodes."""

import heapq
import itertools
from collections.abc import Callable, Iterable
from typing import ClassVar, Final

import numpy as np

from bench_protocol.e2e import COUNTER_PERIOD, crc_of
from bench_protocol.frames import LENGTH_MAX, Block, copied, empty_block, frame, join
from bench_protocol.messages import Protection
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_sim.rig.can_bus import RIG, Stage

FROM_RIG: Final = "from_rig"
TO_RIG: Final = "to_rig"
BOTH: Final = "both"
ALL: Final = "all"
#: The sender of the frames of a babbling node.
BABBLER: Final = "babbling node"
_BABBLED_AT_ONCE: Final = 64
_PROTECTION: Final = {message.identifier: message.protection for message in TABLE.messages}


class FrameFault:
    """A change of frames, in one ``direction`` or both, for one ``message`` or all. ``chance`` is its probability for
    each frame, ``seed`` selects the random numbers. ``now`` is the time (ns) on the clock of the time stamps.
    """

    def __init__(self, direction: str = BOTH, message: str = ALL, chance: float = 1.0, seed: int = 0) -> None:
        self._direction = direction
        self._identifier = -1 if message == ALL else TABLE.messages[TABLE.message_index[message]].identifier
        self._chance = chance
        self.random = np.random.default_rng(seed)

    def through(self, block: Block, peer: str, now: int) -> Block:
        """Return the frames to pass on now, for a ``block`` that ``peer`` sends."""
        if self._direction not in (BOTH, FROM_RIG if peer == RIG else TO_RIG):
            return block
        hit = self.random.random(block.size) < self._chance
        if self._identifier >= 0:
            hit &= block["id"] == self._identifier
        return self.befall(block, hit, peer, now) if hit.any() else block

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        """Return the frames to pass on now, for a ``block``. The boolean array ``hit`` selects the frames that the
        fault affects.
        """
        raise NotImplementedError

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        """Return the delayed frames that are to be passed on now, with their senders."""
        del now
        return ()

    def flush(self) -> Iterable[tuple[Block, str]]:
        """Return all frames that the fault still keeps, with their senders. Called when the fault ends."""
        return ()


class Dropped(FrameFault):
    """Frames are lost."""

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del peer, now
        return copied(block[~hit])


class Doubled(FrameFault):
    """Frames arrive twice."""

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del peer, now
        return np.repeat(block, 1 + hit)


class Corrupted(FrameFault):
    """One bit of the data of frames is wrong, as behind a faulty gateway. On the bus itself, the CRC of CAN would
    detect such an error.
    """

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del peer, now
        block = copied(block)
        for place in np.flatnonzero(hit & (block["length"] > 0)):
            bit = int(self.random.integers(8 * int(block["length"][place])))
            block["data"][place, bit >> 3] ^= 1 << (bit & 7)
        return block


class Delayed(FrameFault):
    """Frames arrive ``by`` ns later, plus a random time up to ``jitter`` ns. Their time stamps are those of the late
    arrival.
    """

    def __init__(self, by: int, jitter: int, **which: object) -> None:
        super().__init__(**which)  # type: ignore[arg-type]
        self._by, self._jitter = by, jitter
        self._kept: list[tuple[int, int, Block, str]] = []
        self._order = itertools.count()

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        for place in np.flatnonzero(hit):
            one = copied(block[place : place + 1])
            delay = self._by + int(self.random.random() * self._jitter)
            one["time"] += delay
            heapq.heappush(self._kept, (now + delay, next(self._order), one, peer))
        return copied(block[~hit])

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        while self._kept and self._kept[0][0] <= now:
            *_, block, peer = heapq.heappop(self._kept)
            yield block, peer

    def flush(self) -> Iterable[tuple[Block, str]]:
        kept, self._kept = sorted(self._kept), []
        return [(block, peer) for *_, block, peer in kept]


class Miscounted(FrameFault):
    """The counter of frames advances by ``step`` too much. With −1 the counter stops, with 1 it skips every other
    value.

    The CRC of a command is changed to fit the wrong counter. The CRC is linear, so this is possible without the key.
    """

    def __init__(self, step: int, **which: object) -> None:
        super().__init__(**which)  # type: ignore[arg-type]
        self._step = step
        self._off: dict[int, int] = {}

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del peer, now
        block = copied(block)
        for place in np.flatnonzero(hit):
            record = block[place]
            identifier, data = int(record["id"]), record["data"]
            off = self._off[identifier] = self._off.get(identifier, 0) + self._step
            protection = _PROTECTION.get(identifier, Protection.NONE)
            if protection is Protection.COUNTER:
                data[7] = (int(data[7]) + off) % 256
            elif protection is Protection.E2E:
                counter = int(data[1]) & 0x0F
                change = np.zeros(LENGTH_MAX, np.uint8)
                change[1] = counter ^ (counter + off) % COUNTER_PERIOD
                change[0] = crc_of(change, 0)
                data ^= change
        return block


class BrokenSum(FrameFault):
    """The CRC of commands is wrong."""

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del peer, now
        block = copied(block)
        hit = hit & np.array([_PROTECTION.get(int(one)) is Protection.E2E for one in block["id"]], bool)
        block["data"][:, 0] ^= np.where(hit, 0xFF, 0).astype(np.uint8)
        return block


class Babble(FrameFault):
    """A node sends frames of one ``identifier`` at ``rate`` (Hz), independent of other traffic."""

    def __init__(self, identifier: int, rate: float) -> None:
        super().__init__()
        self._frame = frame(identifier, bytes(LENGTH_MAX))
        self._period = round(NS / rate)
        self._next = 0

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del hit, peer, now
        return block

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        begun = self._next or now
        count = min((now - begun) // self._period + 1, _BABBLED_AT_ONCE) if now >= begun else 0
        if count:
            block = np.repeat(self._frame, count)
            block["time"] = begun + self._period * np.arange(count)
            # After a pause of the whole process it skips the missed frames.
            self._next = max(begun + self._period * count, now - _BABBLED_AT_ONCE * self._period)
            yield block, BABBLER


class Silence(FrameFault):
    """No frame passes, in either direction."""

    def befall(self, block: Block, hit: np.ndarray, peer: str, now: int) -> Block:
        del block, hit, peer, now
        return empty_block()


class FaultStage(Stage):
    """All active faults of the bus, applied in the order in which they were switched on."""

    rank: ClassVar[int] = Stage.FAULT

    def __init__(self) -> None:
        self._faults: tuple[FrameFault, ...] = ()
        self._left: list[tuple[Block, str]] = []
        #: Whether no fault was ever on.
        self.unused = True

    def add(self, fault: FrameFault) -> Callable[[], None]:
        """Apply ``fault`` to frames from now on. Return a function that ends the fault."""
        self._faults, self.unused = (*self._faults, fault), False

        def end() -> None:
            self._faults = tuple(one for one in self._faults if one is not fault)
            self._left += fault.flush()

        return end

    def outgoing(self, block: Block, now: int) -> Block:
        return _through(self._faults, block, RIG, now)

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        return _through(self._faults, block, peer, now)

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        left, self._left = self._left, []
        out = list(left)
        faults = self._faults
        for place, fault in enumerate(faults):
            out += [(_through(faults[place + 1 :], block, peer, now), peer) for block, peer in fault.due(now)]
        return [(join([block for block, _ in group]), peer) for peer, group in _by_sender(out)]


def _through(faults: tuple[FrameFault, ...], block: Block, peer: str, now: int) -> Block:
    for fault in faults:
        if not block.size:
            break
        block = fault.through(block, peer, now)
    return block


def _by_sender(
    blocks: list[tuple[Block, str]],
) -> Iterable[tuple[str, list[tuple[Block, str]]]]:
    """Return consecutive blocks of the same sender as groups, in their order. Empty blocks are left out."""
    runs = itertools.groupby((one for one in blocks if one[0].size), key=lambda one: one[1])
    return [(peer, list(run)) for peer, run in runs]
