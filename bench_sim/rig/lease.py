"""The lease: who holds the bench, over both protocols, by which token, and when that ends."""

from collections.abc import Callable
from random import Random
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.e2e import mark_of
from bench_protocol.rates import TICK
from bench_protocol.table import TABLE
from bench_protocol.units import ms
from bench_sim.rig.controls import LOST_TICKS, Happened
from bench_sim.rig.peers import is_can, port_of

_LEASE_ROW: Final = TABLE.index["rig.lease"]
_HOLDER_ROW: Final = TABLE.index["rig.holder"]
_NONCE_ROW: Final = TABLE.index["lease.nonce"]
_STRANGERS_ROW: Final = TABLE.index["rig.strangers"]
_STRANGER_ROW: Final = TABLE.index["rig.stranger"]
_IDENTIFIER_ROW: Final = TABLE.index["rig.stranger_identifier"]


class Lease:
    """The lease of one rig, in the tick's ``controls`` and the signals in ``values`` (SI, by table row).

    It is granted to a Modbus connection, and ends with it, or to whoever asks on CAN, and ends when he falls silent.
    One that was granted on CAN may be joined by one Modbus connection that writes its token. That of a commander ends,
    too, when he has been silent on both wires for long enough that the bench is safe: his connections may be open and
    nobody behind them. A connection that has lost the lease so is refused until it asks for it again.

    ``on_change`` is called when the bench has a new holder or none, ``on_end`` when the holder of the bench, or one of
    the two wires to it, is gone.
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
        self._last = 0
        #: The Modbus connection that holds the bench; None for nobody, or somebody who has only CAN.
        self.owner: str | None = None
        self.watchdog_ms = 0
        #: Modbus connections that held the bench, were silent for too long, and do not know yet that they lost it.
        self._lapsed: frozenset[str] = frozenset()
        controls["commander"] = -1
        controls["write_deadline"] = -1

    @property
    def token(self) -> int:
        """The token of the holder, 0 while nobody holds the bench."""
        return int(self._controls["token"])

    def shuffle(self, entropy: int) -> None:
        """Draw other tokens than another rig of the same seed: its commander may still be on the bus."""
        self._chance = Random(f"token {entropy}")

    # -- what peers may do ---------------------------------------------------------------------------------------

    def open_to(self, peer: str, word: int | None = None) -> bool:
        """Return whether the Modbus connection ``peer`` may write, ``word`` to the lease register if at all.

        While nobody holds the bench everybody may, a hand with a command-line client needs no ceremony; but not who
        has lost it and goes on as if it were his.
        """
        if self.owner is not None:
            return self.owner == peer
        if self.token == 0:
            return word is not None or peer not in self._lapsed
        return self.token == word

    def holds(self, peer: str) -> bool:
        """Return whether ``peer`` is a connection of the holder."""
        if is_can(peer):
            return bool(self._controls["commander"] == port_of(peer))
        return self.owner is not None and self.owner == peer

    def commands(self, peer: str) -> bool:
        """Return whether ``peer`` is a connection of the holder, who is commanding on CAN."""
        c = self._controls
        return self.holds(peer) and c["commander"] >= 0 and c["tick"] - c["command_tick"] < LOST_TICKS

    def refuse(self, peer: str, identifier: int = 0) -> None:
        """Count what only the holder may ask for: a Modbus request of ``peer``, or its frame with ``identifier``."""
        self._values[_STRANGERS_ROW] += 1
        self._values[_STRANGER_ROW] = port_of(peer)
        self._values[_IDENTIFIER_ROW] = identifier

    # -- taking and returning ------------------------------------------------------------------------------------

    def write(self, peer: str, word: int) -> None:
        """Do what ``peer``, who may, wants with ``word`` in the lease register: take, join or keep it; 0 returns it."""
        self._lapsed -= {peer}
        if word == 0:
            if self.owner == peer:
                self._end()
        elif self.owner is None:
            if self.token == 0:
                self._grant(self._draw())
            self.owner = peer
            self._controls["expiring"] = 0
            self._values[_HOLDER_ROW] = port_of(peer)

    def ask(self) -> None:
        """Answer the request that came on CAN: 0 asks for the lease, its token returns it."""
        c = self._controls
        c["asked"] = 0
        if c["asked_token"] == 0 and self.token == 0:
            self._values[_NONCE_ROW] = c["asked_nonce"]
            self._values[_HOLDER_ROW] = c["asked_sender"]
            self._grant(self._draw())
            c["expiring"] = 1
        elif self.token != 0 and c["asked_token"] == self.token:
            self._end()

    def peer_lost(self, peer: str) -> None:
        """Note that a connection is closed; the holder's ends the lease, or the CAN side of it."""
        self._lapsed -= {peer}
        if not self.holds(peer):
            return
        if self.owner is None or self.owner == peer:
            self._end()
        else:
            self._controls["commander"] = -1
            self._on_end()

    def decide(self, happened: Happened) -> None:
        """Act on what the tick has seen of the holder."""
        if Happened.WRITES_LOST in happened:
            # Its connection is as good as closed; who goes on commanding on CAN may join again.
            self.watch(0)
            self._lapse()
            self.owner = None
            self._values[_HOLDER_ROW] = max(0, int(self._controls["commander"]))
            self._controls["expiring"] = 1
            self._on_end()
        if Happened.LEASE_LOST in happened:
            self._lapse()
            self._end()

    # -- the watchdog of the holder's writes ---------------------------------------------------------------------

    def watch(self, milliseconds: int) -> None:
        """Expect the holder's next write within so many milliseconds from now and from each write; 0 stops."""
        self.watchdog_ms = milliseconds
        self.feed()

    def feed(self) -> None:
        """Note that the holder has written something."""
        c, ticks = self._controls, round(self.watchdog_ms * ms / TICK)
        c["write_tick"] = c["tick"]
        c["write_deadline"] = c["tick"] + ticks if ticks else -1

    # -- inside --------------------------------------------------------------------------------------------------

    def _lapse(self) -> None:
        if self.owner is not None:
            self._lapsed |= {self.owner}

    def _draw(self) -> int:
        """Return a token that the CRC of a set-point tells from none at all, and from the last holder's."""
        marks = (mark_of(0), mark_of(self._last))
        while mark_of(token := self._chance.randrange(1, 0x10000)) in marks:
            pass
        self._last = token
        return token

    def _grant(self, token: int) -> None:
        c = self._controls
        c["token"], c["granted"], c["commander"] = token, c["tick"], -1
        self._values[_LEASE_ROW] = token
        self._on_change()

    def _end(self) -> None:
        self.watch(0)
        self.owner = None
        self._values[_HOLDER_ROW] = 0
        self._controls["expiring"] = 0
        self._grant(0)
        self._on_end()
