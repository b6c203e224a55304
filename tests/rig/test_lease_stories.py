"""Stories of three peers who want the bench: a model of thirty lines says who may write, and the rig says the same."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_protocol.can_codec import Encoder
from bench_protocol.table import TABLE

LOST, GONE = 500, 2000  # ticks
SILENT = -(10**9)
PEERS = (1, 2, 3)


class Model:
    """Who holds the bench, by what he has done so far."""

    def __init__(self) -> None:
        self.now = 0
        self.held = False
        self.owner = 0  # the peer whose Modbus connection it is
        self.commander = 0  # the peer whose CAN connection it is
        self.granted = self.commanded = SILENT
        self.watchdog, self.written = 0, 0
        self.lapsed: set[int] = (
            set()
        )  # peers whose connection was silent for too long, and who do not know it yet

    def may_write(self, peer: int, joining: bool = False) -> bool:
        if not self.held:
            return joining or peer not in self.lapsed
        return self.owner == peer or (not self.owner and joining)

    def end(self) -> None:
        self.held, self.owner, self.commander, self.watchdog = False, 0, 0, 0

    def begin(self) -> None:
        self.held, self.granted, self.commander = True, self.now, 0

    def lapse(self) -> None:
        self.lapsed |= {self.owner} - {0}
        self.owner = 0

    def leave(self, wire: str, peer: int) -> None:
        if wire == "modbus":
            self.lapsed.discard(peer)
        if wire == "can" and self.held and self.commander == peer:
            self.commander = 0
            if not self.owner:
                self.end()
        elif wire == "modbus" and self.held and self.owner == peer:
            self.end()

    def pass_time(self, ticks: int) -> None:
        for _ in range(ticks):
            self.now += 1
            if self.watchdog and self.now == self.written + self.watchdog:
                self.lapse()
                self.watchdog = 0
            elif self.held and not self.owner:
                if self.now - max(self.granted, self.commanded) >= LOST:
                    self.end()
            elif self.held and self.commanded >= self.granted and self.silent():
                self.lapse()
                self.end()

    def silent(self) -> bool:
        return self.now - max(self.commanded, self.written) >= GONE


peers = st.sampled_from(PEERS)
waits = st.sampled_from([1, 5, 40, 199, 200, 260, 499, 500, 700, 1999, 2000])
steps = st.one_of(
    st.tuples(st.just("take"), peers),
    st.tuples(st.just("give"), peers),
    st.tuples(st.just("join"), peers),
    st.tuples(st.just("watch"), peers, st.sampled_from([0, 200, 300])),
    st.tuples(st.just("stage"), peers),
    st.tuples(st.just("ask"), peers),
    st.tuples(st.just("return"), peers),
    st.tuples(st.just("command"), peers, st.booleans()),
    st.tuples(st.just("leave"), peers, st.sampled_from(["can", "modbus"])),
    st.tuples(st.just("wait"), waits),
)


class Story:
    """One rig and its model."""

    def __init__(self, commander) -> None:
        self.commander, self.rig, self.model = commander, commander.rig, Model()
        self.encoders = {peer: Encoder(TABLE) for peer in PEERS}
        self.strangers = 0
        self.values = np.zeros(len(TABLE.signals))

    @property
    def token(self) -> int:
        return int.from_bytes(self.commander.ask(b"\x03\0\0\0\x01", "modbus:9")[2:], "big")

    def write(self, peer: int, address: int, word: int, *, allowed: bool) -> bool:
        """Write a register; check that the rig lets exactly those write who may."""
        answer = self.commander.ask(struct.pack(">BHH", 6, address, word), f"modbus:{peer}")
        assert answer == (struct.pack(">BHH", 6, address, word) if allowed else b"\x86\x06")
        self.strangers += not allowed
        return allowed

    def fed(self, peer: int) -> None:
        if self.model.owner == peer:
            self.model.written = self.model.now

    def send(self, peer: int, message: str, **fields: int) -> None:
        """Send a frame, which acts at the beginning of the next tick."""
        for name, value in fields.items():
            self.values[TABLE.index[name.replace("_", ".", 1)]] = value
        encoder = self.encoders[peer]
        self.rig.receive(encoder.encode(self.values, encoder.rows([message]), 0), f"can:{peer}")

    def wait(self, ticks: int) -> None:
        self.rig.run(ticks)
        self.model.pass_time(ticks)

    # -- steps ---------------------------------------------------------------------------------------------------

    def take(self, peer: int) -> None:
        model = self.model
        joins = not model.held
        if self.write(
            peer, 0, 0x10000 - 1 if self.token == 1 else 1, allowed=model.may_write(peer, joining=joins)
        ):
            model.lapsed.discard(peer)
            if not model.held:
                model.begin()
                model.watchdog = 0
            model.owner = peer
            self.fed(peer)

    def give(self, peer: int) -> None:
        model = self.model
        if self.write(peer, 0, 0, allowed=model.may_write(peer, joining=not model.held)):
            model.lapsed.discard(peer)
            if model.owner == peer:
                model.end()

    def join(self, peer: int) -> None:
        if (token := self.token) and self.write(
            peer, 0, token, allowed=self.model.may_write(peer, joining=True)
        ):
            self.model.lapsed.discard(peer)
            self.model.owner = peer
            self.fed(peer)

    def watch(self, peer: int, milliseconds: int) -> None:
        holds = self.model.held and self.model.owner == peer
        if self.write(peer, 1, milliseconds, allowed=holds):
            self.model.watchdog = milliseconds
            self.fed(peer)

    def stage(self, peer: int) -> None:
        (answer,) = self.commander.stage(f"modbus:{peer}", generator_amplitude=0.01 * peer)
        allowed = self.model.may_write(peer)
        assert answer[0] == (0x10 if allowed else 0x90)
        self.strangers += not allowed
        if allowed:
            self.fed(peer)

    def ask(self, peer: int) -> None:
        self.send(peer, "LeaseRequest", lease_nonce=peer, lease_token=0)
        if not self.model.held:
            self.model.begin()
        self.wait(1)

    def hand_back(self, peer: int) -> None:
        if token := self.token:
            self.send(peer, "LeaseRequest", lease_nonce=peer, lease_token=token)
            self.model.end()
            self.wait(1)

    def command(self, peer: int, known: bool) -> None:
        token = self.token if known else 0
        model = self.model
        heard = not model.commander or model.commander == peer or model.now - model.commanded >= LOST
        self.rig._decoder.forget()  # who counts how is another story
        self.send(peer, "Control", control_token=token)
        if token and heard:
            model.commander, model.commanded = peer, model.now
        else:
            self.strangers += 1
        self.wait(1)

    def leave(self, peer: int, wire: str) -> None:
        self.rig.peer_lost(f"{wire}:{peer}")
        self.model.leave(wire, peer)

    def check(self) -> None:
        model, values = self.model, self.rig.values
        assert (self.token > 0) is model.held
        assert values[TABLE.index["rig.lease"]] == self.token
        assert (self.rig.lease.owner or "modbus:0") == f"modbus:{model.owner}"
        assert values[TABLE.index["rig.strangers"]] == self.strangers


@pytest.fixture
def fresh(make_rig, commander):
    return lambda: Story(type(commander)(make_rig()))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(story=st.lists(steps, max_size=25))
def test_the_bench_has_one_holder_whatever_three_peers_do(fresh, story) -> None:
    told = fresh()
    told.wait(1)
    for name, *arguments in story:
        {"return": told.hand_back}.get(name, getattr(told, name, None))(*arguments)
        told.check()
