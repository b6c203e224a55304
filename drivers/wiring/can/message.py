"""One message of a CAN transport: coding, protection, values and state of transmission."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench_protocol.account import Account
from bench_protocol.dbc_decoding import Decoding
from bench_protocol.frames import LENGTH_MAX
from drivers.wiring.can.keys import MessageKeys
from drivers.wiring.can.protection import Checksum

if TYPE_CHECKING:
    from cantools.database.can import Message as Coding


@dataclass(slots=True)
class Message:
    """One message: coding, protection, values and state of transmission."""

    name: str
    coding: Coding
    decoding: Decoding
    keys: MessageKeys
    stale: float  #: s without a frame after which its points are stale
    nulls: dict[str, list[float]]
    limits: dict[str, tuple[float, float]]  #: lowest and highest number of each signal in its coding
    every: float = 0.0  #: period of sending (s); 0 to send when written
    counter_period: int = 0
    checksum: Checksum | None = None
    checksum_coding: Coding | None = None  #: coding of the checksum alone
    checksum_mask: int = 0
    given: dict[str, float] = field(default_factory=dict)  #: values sent before the first write, by signal
    values: dict[str, float] = field(default_factory=dict)  #: present values to send, by signal
    count: int = -1  #: last counter sent
    last_counter: int = -1  #: last counter received
    when: int = -1  #: ns, last reception
    points: dict[str, str] = field(default_factory=dict)  #: names of its points, by signal
    refused: str = ""  #: why the message is unusable, by the DBC
    source: int | None = None  #: J1939: address of the accepted sender
    source_when: int = -1  #: ns, last reception from there
    _placed: dict[int, int] = field(
        default_factory=dict
    )  #: bits of a frame with only the checksum, by its value

    def begin(self) -> None:
        """Reset values, counters and times for a new connection."""
        self.values, self.count, self.last_counter, self.when = dict(self.given), -1, -1, -1
        self.source, self.source_when = self.keys.source, -1

    @property
    def j1939(self) -> bool:
        """Whether the message is identified by its group, for any sender."""
        return self.decoding.message.j1939

    @property
    def fd(self) -> bool:
        """Whether the message is sent as a CAN FD frame, provided that the bus supports CAN FD."""
        return bool(self.coding.is_fd) or self.coding.length > LENGTH_MAX

    @property
    def identifier(self) -> int:
        """The identifier of sent frames."""
        own = self.j1939 and self.keys.source is not None
        return self.coding.frame_id & ~0xFF | (self.keys.source or 0) if own else self.coding.frame_id

    @property
    def guards(self) -> set[str]:
        """The signals that the transport sets itself: counter and checksum."""
        own = {self.keys.counter, self.keys.checksum["signal"] if self.keys.checksum else None}
        return {name for name in own if name}

    @property
    def selector(self) -> str:
        """The signal with the page number; empty without pages."""
        selectors = [signal.name for signal in self.coding.signals if signal.is_multiplexer]
        return selectors[0] if selectors else ""

    @property
    def sendable(self) -> bool:
        """Whether the message can be sent: its pages must not be nested."""
        return sum(signal.is_multiplexer for signal in self.coding.signals) <= 1

    def unreadable(self, signal: str) -> str:
        """Return as text why no frame has a value of ``signal``; empty if frames have one."""
        if signal in self.decoding.outside:
            return f"the signal does not fit into the {self.coding.length} bytes of {self.name}"
        twice = [one.name for one in self.coding.signals].count(signal) > 1
        return f"{self.name} has two signals of this name" if twice else ""

    def pages(self) -> list[int]:
        """Return its page numbers, which are values of the selector; none without pages."""
        return sorted({page for signal in self.coding.signals for page in signal.multiplexer_ids or ()})

    def page_of(self, signal: str) -> int | None:
        """Return the page of ``signal``; None if all pages have it."""
        ids = self.coding.get_signal_by_name(signal).multiplexer_ids
        return ids[0] if ids else None

    def on_page(self, page: int | None) -> list[str]:
        """Return the signals of a page that need a value, without those set by the transport."""
        return [
            signal.name
            for signal in self.coding.signals
            if signal.name not in self.guards
            and signal.name != self.selector
            and (signal.multiplexer_ids is None or page in signal.multiplexer_ids)
        ]

    def missing(self, page: int | None) -> list[str]:
        """Return the signals of a page that have no value yet."""
        return [name for name in self.on_page(page) if name not in self.values]

    def encode(self, page: int | None) -> bytes:
        """Return the data of the next frame of a page, with its counter and checksum."""
        signals = {name: self.values[name] for name in self.on_page(page)}
        if self.selector:
            signals[self.selector] = page if page is not None else self.values.get(self.selector, 0)
        if self.keys.counter:
            self.count = (self.count + 1) % self.counter_period
            signals[self.keys.counter] = self.count
        if self.checksum is None or not self.keys.checksum:
            return bytes(self.coding.encode(signals, strict=False))
        data = bytes(self.coding.encode({**signals, self.keys.checksum["signal"]: 0}, strict=False))
        bare = int.from_bytes(data, "big") & ~self.checksum_mask
        return (bare | self._checksum_bits(self.checksum(self.identifier, data))).to_bytes(len(data), "big")

    def sound(self, data: bytes) -> bool:
        """Return whether the checksum of a received frame is correct; False if the frame ends before it."""
        if self.checksum is None:
            return True
        more = 8 * (len(data) - self.coding.length)  # bits; a frame may be longer or shorter than described
        mask = _shifted(self.checksum_mask, more)
        if _shifted(mask, -more) != self.checksum_mask:
            return False
        bits = int.from_bytes(data, "big")
        bare = (bits & ~mask).to_bytes(len(data), "big")
        return bits & mask == _shifted(self._checksum_bits(self.checksum(self.identifier, bare)), more)

    def _checksum_bits(self, checksum: int) -> int:
        """Return a frame, as an integer, that has ``checksum`` in its place and 0 in all other bits."""
        bits = self._placed.get(checksum)
        if bits is None:
            assert self.checksum_coding is not None and self.keys.checksum is not None
            alone = self.checksum_coding.encode({self.keys.checksum["signal"]: checksum}, scaling=False)
            bits = self._placed[checksum] = int.from_bytes(alone, "big")
        return bits

    def decode(self, data: bytes) -> dict[str, float]:
        """Return the numbers of the points that a received frame contains; NaN for "not available"."""
        names = self.points
        found = {names[signal]: value for signal, value in self.decoding.values(data, Account())}
        for signal, nulls in self.nulls.items():
            if found.get(names[signal]) in nulls:
                found[names[signal]] = math.nan
        return found


def _shifted(bits: int, by: int) -> int:
    return bits << by if by >= 0 else bits >> -by
