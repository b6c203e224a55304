"""The lease: who holds the bench on both buses, the token of this holder, and the end of the lease."""

from collections.abc import Callable
from random import Random, SystemRandom
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.e2e import mark_of
from bench_protocol.messages import HIDDEN_TOKEN
from bench_protocol.rates import TICK
from bench_protocol.table import TABLE
from bench_protocol.units import ms
from bench_sim.rig.controls import LOST_TICKS, Happened
from bench_sim.rig.peers import PORT_MASK, is_can, sender_of

_LEASE_ROW: Final = TABLE.index["rig.lease"]
_HOLDER_ROW: Final = TABLE.index["rig.holder"]
_NONCE_ROW: Final = TABLE.index["lease.nonce"]
_REQUEST_IDENTIFIER: Final = TABLE.messages[TABLE.message_index["LeaseRequest"]].identifier
_STRANGERS_ROW: Final = TABLE.index["rig.strangers"]
_STRANGER_ROW: Final = TABLE.index["rig.stranger"]
_IDENTIFIER_ROW: Final = TABLE.index["rig.stranger_identifier"]


class Lease:
    """The lease of one rig. Its state is in the tick's ``controls`` and in the signals ``values`` (SI, by table row).

    A lease is granted to a Modbus connection and ends when that connection closes. Or it is granted on request to a
    CAN connection, and ends when that connection is silent or closes. The holder has at most one connection on each
    bus. A connection is identified by its name, never by a port or by a token that other clients can read.

    If the lease is granted on Modbus, only that connection can read the token. The first CAN connection that commands
    with the token belongs to the holder. When this CAN connection closes, the token changes.

    If the lease is granted on CAN, every Modbus connection reads a key of its own instead of the token. The CAN
    connection of the holder sends the key of the Modbus connection that may join.

    A lease also ends when the commander is silent on both buses for too long, because an open connection does not
    prove that the client still runs. A connection that has lost the lease in this way is refused until it requests the
    lease again.

    ``on_change`` is called when the holder of the bench changes or leaves. ``on_end`` is called when the bench loses
    its holder, or the holder loses one of its two connections.
    """

    def __init__(
        self,
        controls: Any,
        values: npt.NDArray[np.float64],
        seed: int,
        *,
        on_change: Callable[[], None],
        on_end: Callable[[], object],
    ) -> None:
        self._controls, self._values = controls, values
        self._on_change, self._on_end = on_change, on_end
        self._chance = Random(f"token {seed}")
        self._key_chance = Random(f"key {seed}")
        self._keys: dict[str, int] = {}
        self._last = 0
        #: The Modbus connection that holds the bench; None without a holder, or for a holder with CAN only.
        self.owner: str | None = None
        self.watchdog_ms = 0
        #: The Modbus connection that held this lease before the watchdog of its writes ran out; it may join again.
        self._former: str | None = None
        #: Modbus connections that lost the lease because of silence, and have not requested it again.
        self._lapsed: frozenset[str] = frozenset()
        controls["commander"] = -1
        controls["command_tick"] = -1  # before any lease
        controls["write_deadline"] = -1

    @property
    def token(self) -> int:
        """Return the token of the holder, or 0 without a holder."""
        return int(self._controls["token"])

    def draw_unpredictably(self) -> None:
        """Use random numbers of the operating system for tokens and keys, so that no client can predict them."""
        self._chance = self._key_chance = SystemRandom()

    # -- what peers may do ---------------------------------------------------------------------------------------

    def open_to(self, peer: str, word: int | None = None) -> bool:
        """Return whether the Modbus connection ``peer`` may write. ``word`` is the value for the lease register, or
        None.

        Without a holder every connection may write, so a command-line client needs no lease. A connection that has
        lost the lease because of silence must write the lease register first.
        """
        if self.owner is not None:
            return self.owner == peer
        if self.token == 0:
            return word is not None or peer not in self._lapsed
        return peer == self._former and self.token == word

    def word_for(self, peer: str) -> int:
        """Return the content of the lease register for the Modbus connection ``peer``.

        It is the token for the holder (and for its former connection, which may join again), 0 without a holder, and a
        different key for each other connection.
        """
        if self.token == 0:
            return 0
        if peer in (self.owner, self._former):
            return self.token
        if peer not in self._keys:
            self._keys[peer] = self._unused(self._key_chance)
        return self._keys[peer]

    def holds(self, peer: str) -> bool:
        """Return whether ``peer`` is one of the connections of the holder."""
        if is_can(peer):
            return bool(self._controls["commander"] == sender_of(peer))
        return self.owner is not None and self.owner == peer

    def commands(self, peer: str) -> bool:
        """Return whether ``peer`` is a connection of the holder, and the holder sends commands on CAN at present."""
        c = self._controls
        return self.holds(peer) and c["commander"] >= 0 and c["tick"] - c["command_tick"] < LOST_TICKS

    def refuse(self, peer: str, identifier: int = 0) -> None:
        """Count a refused request that only the holder may send. ``identifier`` is that of a CAN frame, or 0 for
        Modbus.
        """
        self._count(sender_of(peer), identifier)

    # -- taking and returning ------------------------------------------------------------------------------------

    def write(self, peer: str, word: int) -> None:
        """Write ``word`` to the lease register for ``peer``, which must be allowed. 0 returns the lease; other values
        take, join or keep it.
        """
        self._lapsed -= {peer}
        if word == 0:
            if self.owner == peer:
                self._end_lease()
        elif self.owner is None:
            if self.token == 0:
                self._grant(self._draw())
            self._join(peer)

    def ask(self) -> None:
        """Handle a lease request on CAN. 0 requests the lease, the token returns it, and a key admits a Modbus
        connection.
        """
        c = self._controls
        c["asked"] = 0
        sender, word = int(c["asked_sender"]), int(c["asked_token"])
        if self.token == 0:
            if word == 0:
                self._values[_NONCE_ROW] = c["asked_nonce"]
                self._values[_HOLDER_ROW] = sender & PORT_MASK
                self._grant(self._draw(), sender)
                c["expiring"] = 1
        elif c["commander"] != sender:
            if word != 0:
                self._count(sender, _REQUEST_IDENTIFIER)
        elif word == self.token:
            self._end_lease()
        elif self.owner is None and word != 0:
            for peer, key in list(self._keys.items()):
                if key == word:
                    self._join(peer)

    def peer_lost(self, peer: str) -> None:
        """Handle a closed connection. If it belongs to the holder, the lease ends, or the holder loses its CAN
        connection.
        """
        self._lapsed -= {peer}
        self._keys.pop(peer, None)
        if peer == self._former:
            self._former = None
        if not self.holds(peer):
            return
        if self.owner is None or self.owner == peer:
            self._end_lease()
        else:
            self._hand_out(self._draw())  # all clients of the bus have read the old token
            self._on_end()

    def decide(self, happened: Happened) -> None:
        """Handle the events of the tick that concern the holder."""
        if Happened.WRITES_LOST in happened:
            # Treat the connection as closed; a holder that still commands on CAN may join again.
            self.watch(0)
            self._lapse()
            self._former, self.owner = self.owner, None
            self._values[_HOLDER_ROW] = max(0, int(self._controls["commander"])) & PORT_MASK
            self._controls["expiring"] = 1
            self._on_end()
        if Happened.LEASE_LOST in happened:
            self._lapse()
            self._end_lease()

    # -- the watchdog of the holder's writes ---------------------------------------------------------------------

    def watch(self, milliseconds: int) -> None:
        """Set the time limit (ms) between two writes of the holder, and restart it. 0 means no limit."""
        self.watchdog_ms = milliseconds
        self.feed()

    def feed(self) -> None:
        """Restart the time limit after a write of the holder."""
        c, ticks = self._controls, round(self.watchdog_ms * ms / TICK)
        c["write_tick"] = c["tick"]
        c["write_deadline"] = c["tick"] + ticks if ticks else -1

    # -- inside --------------------------------------------------------------------------------------------------

    def _lapse(self) -> None:
        if self.owner is not None:
            self._lapsed |= {self.owner}

    def _join(self, peer: str) -> None:
        """Make ``peer`` the Modbus connection of the holder."""
        self._keys.pop(peer, None)
        self.owner, self._former = peer, None
        self._controls["expiring"] = 0
        self._values[_HOLDER_ROW] = sender_of(peer) & PORT_MASK

    def _count(self, sender: int, identifier: int) -> None:
        self._values[_STRANGERS_ROW] += 1
        self._values[_STRANGER_ROW] = sender & PORT_MASK
        self._values[_IDENTIFIER_ROW] = identifier

    def _draw(self) -> int:
        """Return a new token. Its mark in the CRC of set-points differs from the marks of token 0 and of the last
        token.
        """
        marks = (mark_of(0), mark_of(self._last))
        while mark_of(token := self._unused(self._chance)) in marks:
            pass
        self._last = token
        return token

    def _unused(self, chance: Random) -> int:
        """Return a random number that is neither the token nor a key."""
        while (word := chance.randrange(1, 0x10000)) in (HIDDEN_TOKEN, self.token, *self._keys.values()):
            pass
        return word

    def _hand_out(self, token: int, commander: int = -1) -> None:
        """Set the ``token`` of the holder, and its CAN connection ``commander`` (-1: none known). The signals show the
        token only with a known commander, whose frames show it anyway.
        """
        c = self._controls
        c["token"], c["commander"] = token, commander
        c["suspects"] = c["tries"] = 0
        self._values[_LEASE_ROW] = HIDDEN_TOKEN if token and commander < 0 else token

    def _grant(self, token: int, commander: int = -1) -> None:
        self._controls["granted"] = self._controls["tick"]
        self._hand_out(token, commander)
        self._on_change()

    def _end_lease(self) -> None:
        self.watch(0)
        self.owner = self._former = None
        self._values[_HOLDER_ROW] = 0
        self._controls["expiring"] = 0
        self._grant(0)
        self._on_end()
