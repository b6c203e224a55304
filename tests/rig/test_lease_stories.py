"""Stories of three peers who want the bench: a model of sixty lines says who may command, and the rig says the same.

All of them come from the same TCP port of different addresses, and each uses every number that it can read.
"""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_protocol.can_codec import Encoder
from bench_protocol.messages import HIDDEN_TOKEN
from bench_protocol.table import TABLE
from bench_sim.rig.controls import TRIES_MAX
from bench_sim.rig.peers import peer_name

LOST, GONE = 500, 2000  # ticks
SILENT = -(10**9)
PEERS = (1, 2, 3)
PORT = 4711


def name(wire: str, peer: int) -> str:
    return peer_name(wire, f"127.0.0.{peer}", PORT, 2 * peer + (wire == "can"))


class Model:
    """Who holds the bench, by what he has done so far."""

    def __init__(self) -> None:
        self.now = 0
        self.held = False
        self.owner = self.former = 0  # the peer whose Modbus connection it is, or was until it was silent
        self.commander = 0  # the peer whose CAN connection it is
        self.granted = self.commanded = SILENT
        self.watchdog, self.written = 0, 0
        self.tries: dict[int, int] = {}  # wrong tokens by peer, while there is no commander
        self.lapsed: set[int] = (
            set()
        )  # peers whose connection was silent for too long, and who do not know it yet

    def may_write(self, peer: int, joining: bool = False) -> bool:
        if not self.held:
            return joining or peer not in self.lapsed
        return self.owner == peer

    def end(self) -> None:
        self.held, self.owner, self.former, self.commander, self.watchdog = False, 0, 0, 0, 0

    def begin(self, commander: int = 0) -> None:
        self.held, self.granted, self.commander, self.tries = True, self.now, commander, {}

    def own(self, peer: int) -> None:
        self.owner, self.former = peer, 0

    def command(self, peer: int, *, right: bool, word: int) -> bool:
        """Return whether a command is the holder's."""
        if self.held and not self.commander and self.tries.get(peer, 0) < TRIES_MAX:
            if right:
                self.commander = peer
            elif word:
                self.tries[peer] = self.tries.get(peer, 0) + 1
        if not (self.held and right and self.commander == peer):
            return False
        self.commanded = self.now
        return True

    def lapse(self) -> None:
        self.lapsed |= {self.owner} - {0}
        self.former, self.owner = self.owner, 0

    def leave(self, wire: str, peer: int) -> None:
        if wire == "modbus":
            self.lapsed.discard(peer)
            self.former = 0 if self.former == peer else self.former
        if wire == "can" and self.held and self.commander == peer:
            self.commander, self.tries = 0, {}
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
#: Which number a peer uses: what all can read, what its own Modbus connection reads, what the last holder had, none.
words = st.sampled_from(["published", "own", "last", "none"])
waits = st.sampled_from([1, 5, 40, 199, 200, 260, 499, 500, 700, 1999, 2000])
steps = st.one_of(
    st.tuples(st.just("take"), peers),
    st.tuples(st.just("give"), peers),
    st.tuples(st.just("join"), peers, words),
    st.tuples(st.just("watch"), peers, st.sampled_from([0, 200, 300])),
    st.tuples(st.just("stage"), peers),
    st.tuples(st.just("ask"), peers),
    st.tuples(st.just("request"), peers, words),
    st.tuples(st.just("let_join"), peers, peers),
    st.tuples(st.just("command"), peers, words),
    st.tuples(st.just("leave"), peers, st.sampled_from(["can", "modbus"])),
    st.tuples(st.just("wait"), waits),
)


class Story:
    """One rig and its model."""

    def __init__(self, commander) -> None:
        self.commander, self.rig, self.model = commander, commander.rig, Model()
        self.encoders = {peer: Encoder(TABLE) for peer in PEERS}
        self.strangers = self.last = 0
        self.values = np.zeros(len(TABLE.signals))

    @property
    def token(self) -> int:
        return self.rig.lease.token

    def truth(self, signal: str) -> float:
        return self.rig.values[TABLE.index[signal]]

    def own_word(self, peer: int) -> int:
        answer = self.commander.ask(b"\x03\0\0\0\x01", name("modbus", peer))
        return int.from_bytes(answer[2:], "big")

    def word(self, peer: int, which: str) -> int:
        match which:
            case "published":
                return int(self.truth("rig.lease"))
            case "own":
                return self.own_word(peer)
            case "last":
                return self.last
        return 0

    def write(self, peer: int, address: int, word: int, *, allowed: bool) -> bool:
        """Write a register; check that the rig lets exactly those write who may."""
        answer = self.commander.ask(struct.pack(">BHH", 6, address, word), name("modbus", peer))
        assert answer == (struct.pack(">BHH", 6, address, word) if allowed else b"\x86\x06")
        self.strangers += not allowed
        return allowed

    def fed(self, peer: int) -> None:
        if self.model.owner == peer:
            self.model.written = self.model.now

    def send(self, peer: int, message: str, **fields: int) -> None:
        """Send a frame, which acts at the beginning of the next tick."""
        for field, value in fields.items():
            self.values[TABLE.index[field.replace("_", ".", 1)]] = value
        encoder = self.encoders[peer]
        self.rig.receive(encoder.encode(self.values, encoder.rows([message]), 0), name("can", peer))

    def wait(self, ticks: int) -> None:
        self.rig.run(ticks)
        self.model.pass_time(ticks)

    # -- steps ---------------------------------------------------------------------------------------------------

    def take(self, peer: int) -> None:
        model = self.model
        if self.write(peer, 0, HIDDEN_TOKEN, allowed=model.may_write(peer, joining=not model.held)):
            model.lapsed.discard(peer)
            if not model.held:
                model.begin()
                model.watchdog = 0
            model.own(peer)
            self.fed(peer)

    def give(self, peer: int) -> None:
        model = self.model
        if self.write(peer, 0, 0, allowed=model.may_write(peer, joining=not model.held)):
            model.lapsed.discard(peer)
            if model.owner == peer:
                model.end()

    def join(self, peer: int, which: str) -> None:
        model = self.model
        if not model.held or not (word := self.word(peer, which)):
            return
        again = not model.owner and model.former == peer and word == self.token
        if self.write(peer, 0, word, allowed=again or model.may_write(peer)):
            model.lapsed.discard(peer)
            model.own(peer)
            self.fed(peer)

    def watch(self, peer: int, milliseconds: int) -> None:
        holds = self.model.held and self.model.owner == peer
        if self.write(peer, 1, milliseconds, allowed=holds):
            self.model.watchdog = milliseconds
            self.fed(peer)

    def stage(self, peer: int) -> None:
        (answer,) = self.commander.stage(name("modbus", peer), generator_amplitude=0.01 * peer)
        allowed = self.model.may_write(peer)
        assert answer[0] == (0x10 if allowed else 0x90)
        self.strangers += not allowed
        if allowed:
            self.fed(peer)

    def ask(self, peer: int) -> None:
        self.send(peer, "LeaseRequest", lease_nonce=peer, lease_token=0)
        if not self.model.held:
            self.model.begin(peer)
        self.wait(1)

    def request(self, peer: int, which: str) -> None:
        """Try to return the bench, with any holder."""
        self._request(peer, self.word(peer, which))

    def let_join(self, peer: int, other: int) -> None:
        """Send what the Modbus connection of ``other`` reads on the CAN connection of ``peer``."""
        self._request(peer, self.own_word(other), other)

    def _request(self, peer: int, word: int, other: int = 0) -> None:
        model = self.model
        if not word:
            return
        self.send(peer, "LeaseRequest", lease_nonce=peer, lease_token=word)
        if model.held and model.commander != peer:
            self.strangers += 1
        elif model.held and word == self.token:
            model.end()
        elif model.held and not model.owner:
            keys = {self.own_word(one): one for one in PEERS}
            if word in keys and (other or word == self.own_word(peer)):
                model.own(keys[word])
        self.wait(1)

    def command(self, peer: int, which: str) -> None:
        word = self.word(peer, which)
        self.rig._decoder.forget()  # who counts how is another story
        self.send(peer, "Control", control_token=word)
        if not self.model.command(peer, right=word == self.token != 0, word=word):
            self.strangers += 1
        self.wait(1)

    def leave(self, peer: int, wire: str) -> None:
        self.rig.peer_lost(name(wire, peer))
        self.model.leave(wire, peer)

    def check(self) -> None:
        model = self.model
        self.last = self.token or self.last
        assert (self.token > 0) is model.held
        hidden = model.held and not model.commander
        assert self.truth("rig.lease") == (HIDDEN_TOKEN if hidden else self.token)
        assert self.rig.lease.owner == (name("modbus", model.owner) if model.owner else None)
        assert self.truth("rig.strangers") == self.strangers
        words = {peer: self.own_word(peer) for peer in PEERS}
        for peer, word in words.items():
            assert (word == self.token) is (not model.held or peer in (model.owner, model.former))


@pytest.fixture
def fresh(make_rig, commander):
    return lambda: Story(type(commander)(make_rig()))


def act_out(fresh, story) -> None:
    truth = fresh()
    truth.wait(1)
    for step, *arguments in story:
        getattr(truth, step)(*arguments)
        truth.check()


def test_a_commander_whose_connection_closed_is_gone_when_it_writes_no_more(fresh) -> None:
    act_out(
        fresh,
        [("take", 1), ("command", 1, "own"), ("leave", 1, "can"), ("wait", 1999), ("wait", 5), ("take", 2)],
    )


many = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@settings(many, max_examples=60)
@given(story=st.lists(steps, max_size=25))
def test_the_bench_has_one_holder_whatever_three_peers_do(fresh, story) -> None:
    act_out(fresh, story)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@settings(many, max_examples=2000)
@given(story=st.lists(steps, min_size=5, max_size=40))
def test_the_bench_has_one_holder_in_2000_stories(fresh, story) -> None:
    act_out(fresh, story)
