"""The chain of stages on the bus: in order, both ways, with stored frames, and empty without stages."""

from collections.abc import Iterable

import pytest

from bench_protocol.clock import VirtualClock
from bench_protocol.frames import Block, empty_block, frame, join
from bench_sim.rig.can_bus import RIG, CanBus, Stage
from bench_sim.rig.controls import TICK_NS


class Hearers:
    """A server and a rig that store their inputs."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.bus = CanBus(
            lambda block, peer: self.rig.append((*ids(block), peer)), self.clock, self.clock.now
        )
        self.bus.connect(self)
        self.rig: list[tuple[int | str, ...]] = []
        self.clients: list[tuple[int | str, ...]] = []

    def publish(self, block: Block) -> None:
        self.clients.append((*ids(block), RIG))

    def relay(self, block: Block, peer: str) -> None:
        self.clients.append((*ids(block), peer))


def ids(block: Block) -> list[int]:
    return block["id"].tolist()


class Marking(Stage):
    """Appends a frame with its own identifier to every block."""

    def __init__(self, mark: int, rank: int = Stage.FAULT) -> None:
        self.mark, self.rank = mark, rank
        self.left: list[str] = []

    def outgoing(self, block: Block, now: int) -> Block:
        return join([block, frame(self.mark, b"")])

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        return join([block, frame(self.mark, b"")])

    def forget(self, peer: str) -> None:
        self.left.append(peer)


class Keeping(Stage):
    """Keeps everything until it is 3 ms old."""

    rank = Stage.PACE

    def __init__(self) -> None:
        self.kept: list[tuple[int, Block, str]] = []

    def outgoing(self, block: Block, now: int) -> Block:
        return self.incoming(block, RIG, now)

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        self.kept.append((now + 3 * TICK_NS, block, peer))
        return empty_block()

    def due(self, now: int) -> Iterable[tuple[Block, str]]:
        ready = [(block, peer) for time, block, peer in self.kept if time <= now]
        self.kept = [one for one in self.kept if one[0] > now]
        return ready


def test_an_empty_chain_hands_on_the_very_block() -> None:
    received = Hearers()
    block = frame(1, b"x")
    assert received.bus.carry(block, "a") is block
    received.bus.publish(block)
    assert received.clients == [(1, RIG)]
    assert received.rig == [], "a node does not hear itself"


def test_both_ways_lead_through_the_stages_in_the_order_of_their_rank() -> None:
    received = Hearers()
    for stage in (Marking(9, Stage.RECORD), Marking(5), Marking(6)):
        received.bus.add(stage)
    received.bus.publish(frame(1, b""))
    assert received.clients == [(1, 5, 6, 9, RIG)]
    assert ids(received.bus.carry(frame(2, b""), "a")) == [2, 5, 6, 9]


def test_kept_frames_pass_the_later_stages_when_due() -> None:
    received = Hearers()
    before, keeping, behind = Marking(5), Keeping(), Marking(9, Stage.RECORD)
    for stage in (before, keeping, behind):
        received.bus.add(stage)
    received.bus.publish(frame(1, b""))
    assert received.bus.carry(frame(2, b""), "a").size == 0
    received.clock.sleep_until(3 * TICK_NS - 1)
    assert received.clients == received.rig == []
    received.clock.sleep_until(3 * TICK_NS)
    assert received.clients == [(1, 5, 9, RIG), (2, 5, 9, "a")]
    assert received.rig == [(2, 5, 9, "a")], "its own frames do not come back to the rig"


def test_a_stage_that_is_taken_out_acts_no_more_and_the_clock_rests() -> None:
    received = Hearers()
    stage = Marking(5)
    received.bus.add(stage)
    received.bus.forget("a")
    received.bus.remove(stage)
    received.bus.forget("b")
    assert stage.left == ["a"]
    received.bus.publish(frame(1, b""))
    assert received.clients == [(1, RIG)]
    with pytest.raises(ValueError, match="not on the bus"):
        received.bus.remove(stage)
