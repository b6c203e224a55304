"""Our own Modbus map: staged settings, actions, contacts, polled readings, identification and the lease."""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from bench_protocol.map_differences import Differences, compare
from bench_protocol.map_file import read_places, sequences
from bench_protocol.messages import HIDDEN_TOKEN
from bench_protocol.modbus import DEVICE_FAILURE, FILE_READ_MAX, NO_AUTHORITY
from bench_protocol.registers import (
    BLOCKS,
    LEASE_ADDRESS,
    PROBE_FLOAT,
    PROBE_WORD,
    WATCHDOG_ADDRESS,
    Register,
)
from bench_protocol.signals import Kind
from bench_protocol.units import ms
from bench_protocol.wires import Table
from drivers.errors import BenchError, LinkLost, MapMismatch, Misuse, NotCommander, Refused
from drivers.wiring.astb.refusals import RigState, action_refusal, settings_refusal

if TYPE_CHECKING:
    from drivers.modbus_port import ModbusPort

_SINGLE: Final = struct.Struct(">f")
_PROBE_REGISTERS: Final = 7
#: Any value but 0 requests the lease.
_ASK: Final = 1
#: Number of attempts to read one block, and to read several blocks, between which a new step of the rig may begin.
_READ_TRIES: Final = (3, 20)


def single(value: float) -> float:
    """Return ``value`` rounded to an IEEE-754 single."""
    return float(_SINGLE.unpack(_SINGLE.pack(value))[0])


def to_words(value: float) -> tuple[int, int]:
    """Return ``value`` as two registers, IEEE-754 single, high word first."""
    word = int.from_bytes(_SINGLE.pack(value), "big")
    return word >> 16, word & 0xFFFF


def from_words(high: int, low: int) -> float:
    """Return the IEEE-754 single in two registers, high word first."""
    return float(_SINGLE.unpack(((high << 16) | low).to_bytes(4, "big"))[0])


def other_map(map_hash: int, agreed: int, detail: str = "") -> MapMismatch | None:
    """Return an error if ``map_hash`` is not the ``agreed`` one, else None."""
    if map_hash == agreed:
        return None
    return MapMismatch(
        f"the rig's map hash is {map_hash:#010x}, that of these drivers is {agreed:#010x}; install the "
        f"same version of the table of signals on both{detail}"
    )


def _spans(places: Mapping[str, str]) -> list[tuple[int, int]]:
    """Return the input registers at both ends of each block of readings in a map."""
    found = sequences(places)
    return [span for block in BLOCKS if (span := block.span(found)) is not None]


class AstbRegisters:
    """Writes settings all or none, triggers actions, and reads signals that CAN does not carry."""

    def __init__(self, table: Table, port: ModbusPort) -> None:
        self._table, self._port = table, port
        self._holding = self._registers("holding", Kind.SETTING)
        self._coils = self._registers("coil", Kind.ACTION)
        self._contacts = self._registers("discrete", Kind.INTERLOCK)
        self._active = self._registers("input", Kind.SETTING)
        self._readings = [
            r
            for r in table.registers
            if r.space == "input"
            and r.encoding == "float32"
            and r.signal in table.index
            and r.signal not in self._active
        ]
        self._spans = _spans(table.places)
        self._absent: Mapping[str, str] = {}
        self._floats = {r.signal: r for r in (*self._active.values(), *self._readings)}
        self._token = 0  # of the lease that this connection took
        self._lock = threading.RLock()

    def _registers(self, space: str, kind: Kind) -> dict[str, Register]:
        return {
            register.signal: register
            for register in self._table.registers
            if register.space == space
            and register.signal in self._table.index
            and self._table[register.signal].kind is kind
        }

    # -- settings ------------------------------------------------------------------------------------------------

    def write(self, values: Mapping[str, float]) -> None:
        """Stage ``values`` (SI, within their ranges) in one request and activate them with APPLY.

        Raises ``Refused`` if the rig rejects them. The active values are then unchanged, and are staged again.
        """
        with self._lock:
            before = self.in_force()  # read each time, because the rig may reset settings by itself
            self._stage(before, values)
            try:
                self.act("action.apply")
            except Refused as refused:
                self._stage(before, {name: before[name] for name in values})
                request = ", ".join(
                    f"{name} = {self._table[name].show(value)}" for name, value in values.items()
                )
                new = [name for name, value in values.items() if single(value) != before[name]]
                reason = self._reason(refused, lambda rig: settings_refusal(new, rig))
                raise Refused(f"the rig refused {request}: {reason}", refused.code) from None

    def _stage(self, known: Mapping[str, float], values: Mapping[str, float]) -> None:
        """Write all registers from the first to the last of ``values`` in one request; other registers between these
        get their ``known`` values.
        """
        addresses = [self._holding[name].address for name in values]
        span = [r for r in self._holding.values() if min(addresses) <= r.address <= max(addresses)]
        words = [word for r in span for word in to_words(values.get(r.signal, known[r.signal]))]
        self._commanding(lambda: self._port.write_registers(span[0].address, words))

    def in_force(self) -> dict[str, float]:
        """Return the active values (SI) of all settings in the rig. Staged values are not included."""
        registers = list(self._active.values())
        words = self._port.read_input(registers[0].address, 2 * len(registers))
        return {r.signal: from_words(*words[2 * k : 2 * k + 2]) for k, r in enumerate(registers)}

    # -- actions, contacts, polled readings ----------------------------------------------------------------------

    def act(self, name: str) -> None:
        """Trigger an action by its name in the table (``action.apply``)."""
        address = self._coils[name].address
        try:
            self._commanding(lambda: self._port.write_coil(address, True))
        except Refused as refused:
            reason = self._reason(refused, lambda rig: action_refusal(name, rig))
            raise Refused(f"{name} was refused in the rig's present state: {reason}", refused.code) from None

    def _reason(self, refused: Refused, explain: Callable[[RigState], str]) -> str:
        """Return as text why the rig refused a request: explained by its state if possible, else its answer."""
        text = ""
        if refused.code == DEVICE_FAILURE:
            with suppress(BenchError):
                text = explain(RigState(self.snapshot(), self.contacts()))
        return f"{text} (Modbus exception {refused.code})" if text else str(refused)

    def contacts(self) -> dict[str, bool]:
        """Return the states of all interlocks (see `contact`) by name, read in one request."""
        first = min(register.address for register in self._contacts.values())
        bits = self._port.read_discrete(first, len(self._contacts))
        return {name: bits[register.address - first] for name, register in self._contacts.items()}

    def snapshot(self) -> dict[str, float]:
        """Return all readings (SI) of one step of the rig: the sequence numbers at the ends of the blocks agree."""
        return self._one_step(self._readings)

    def _one_step(self, readings: Sequence[Register]) -> dict[str, float]:
        """Return ``readings`` (SI) of one step of the rig, with one request for each block that has some of them."""
        spans = [
            span for span in self._spans if any(span[0] < reading.address < span[1] for reading in readings)
        ]
        tries = _READ_TRIES[len(spans) > 1]
        for _ in range(tries):
            blocks = [self._port.read_input(first, last - first + 1) for first, last in spans]
            if len({number for words in blocks for number in (words[0], words[-1])}) <= 1:
                return {
                    reading.signal: from_words(*words[reading.address - first :][:2])
                    for (first, last), words in zip(spans, blocks, strict=True)
                    for reading in readings
                    if first < reading.address < last
                }
        places = " and ".join(str(first) for first, _ in spans)
        raise LinkLost(
            f"the readings from input register {places} on changed during each of {tries} reads, so "
            "they are not of one time; read them again"
        )

    def _readings_now(self, names: Sequence[str]) -> dict[str, float]:
        """Return several readings (SI) of one step; NaN if the rig has no value."""
        here = [self._floats[name] for name in names if name not in self._absent]
        return dict.fromkeys(names, math.nan) | self._one_step(here)

    def contact(self, name: str) -> bool:
        """Return the state of an interlock. True means what its description in the table of signals states, such as
        "The hard-wired emergency stop is pressed".
        """
        return self._port.read_discrete(self._contacts[name].address, 1)[0]

    def reading(self, name: str) -> float:
        """Return one reading or active setting (SI) through Modbus; NaN if the rig has no value."""
        if name in self._absent:
            return math.nan
        return from_words(*self._port.read_input(self._floats[name].address, 2))

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return contacts, active settings and readings (SI), by name.

        Contacts and settings need one request each, readings one request for each block.
        """
        found: dict[str, float] = {}
        readings = self._floats.keys() - self._active.keys()
        for known, one, several in (
            (self._contacts.keys(), self.contact, lambda _: self.contacts()),
            (self._active.keys(), self.reading, lambda _: self.in_force()),
            (readings, self.reading, self._readings_now),
        ):
            requested = [name for name in names if name in known]
            answers = several(requested) if len(requested) > 1 else {name: one(name) for name in requested}
            found.update({name: float(answers[name]) for name in requested})
        if unknown := [name for name in names if name not in found]:
            raise Misuse(
                f"{', '.join(unknown)} is not a reading of the Modbus map; `astb rig signals` lists "
                "the signals"
            )
        return found

    # -- identification and lease --------------------------------------------------------------------------------

    def probe(self) -> int:
        """Return the rig's map hash. Raises `MapMismatch` if the rig has other identification registers."""
        words = self._port.read_input(0, _PROBE_REGISTERS)
        number, word = from_words(*words[3:5]), (words[5] << 16) | words[6]
        if not math.isclose(number, PROBE_FLOAT, rel_tol=1e-6) or word != PROBE_WORD:
            raise MapMismatch(
                f"the probe registers read {number:g} and {word:#010x}, not {PROBE_FLOAT:g} and "
                f"{PROBE_WORD:#010x}; the device sends words or bytes in another order, or it is "
                "another device; check its address and byte order"
            )
        return (words[1] << 16) | words[2]

    def differences(self, map_hash: int) -> Differences:
        """Return the differences between the ASTB table and the rig's map, whose hash is ``map_hash``. Missing readings
        are not requested from then on.

        Raises `MapMismatch` if the rig does not report its map, or if a bench must not run with it.
        """
        try:
            places = read_places(self._port.read_file, FILE_READ_MAX, map_hash)
        except (Refused, ValueError) as error:
            detail = f"; the differences are unknown: {error}"
            raise MapMismatch(str(other_map(map_hash, self._table.map_hash, detail))) from None
        found = compare(self._table, places)
        if found.refused:
            detail = (
                f". These differences must not exist: {'; '.join(found.refused[:3])}. All differences: "
                f"{found}"
            )
            raise MapMismatch(str(other_map(map_hash, self._table.map_hash, detail)))
        self._absent = found.absent
        self._readings = [register for register in self._readings if register.signal not in self._absent]
        self._spans = _spans(places)
        return found

    def take_lease(self) -> int:
        """Become the commander; return the token from the rig. Raises ``NotCommander`` if another client has the
        lease.
        """
        self._lease([_ASK])
        self._token = self.holder()
        return self._token

    def join_lease(self, token: int) -> None:
        """Rejoin the lease that this connection held with ``token``. Raises ``NotCommander`` if it has ended."""
        self._lease([token])

    def return_lease(self) -> None:
        """Release the lease."""
        self._lease([0])

    def holder(self) -> int:
        """Return the lease register: the token if this connection holds the lease, another number if another client
        holds it, 0 if it is free.
        """
        return self._port.read_holding(LEASE_ADDRESS, 1)[0]

    def holder_text(self) -> str:
        """Return as text which client holds the lease."""
        if not self.holder():
            return "no client"
        token, port = self.reading("rig.lease"), self.reading("rig.holder")
        holder = (
            "a commander that does not send on CAN yet"
            if token == HIDDEN_TOKEN
            else f"the commander with token {token:.0f}"
        )
        where = f"at TCP port {port:.0f}; `ss -tnp` shows its program" if port > 0 else "somewhere on CAN"
        return f"{holder}, {where}"

    def watch(self, within: float) -> None:
        """Set the time limit of the watchdog to ``within`` s (up to 10; 0: off). If no write follows in time, the rig
        holds the bench.
        """
        self._commanding(lambda: self._port.write_registers(WATCHDOG_ADDRESS, [round(within / ms)]))

    def between_requests(self, call: Callable[[], None]) -> None:
        """Call ``call`` now, or after the request for which this thread is waiting."""
        self._port.between_requests(call)

    def _lease(self, words: Sequence[int]) -> None:
        self._commanding(lambda: self._port.write_registers(LEASE_ADDRESS, words))

    def _commanding(self, request: Callable[[], None]) -> None:
        try:
            request()
        except Refused as refused:
            if refused.code != NO_AUTHORITY:
                raise
            raise NotCommander(self._lease_lost()) from refused

    def _lease_lost(self) -> str:
        """Return as text the reason why the rig refuses all requests of this connection."""
        token = self.holder()
        if not self._token:
            return (
                f"the bench is held by {self.holder_text()}; wait until that client releases the bench, or "
                "until it was silent and the bench is safe"
            )
        if token == self._token:
            return (
                "nothing was written on this connection for too long, so the bench refuses it; connect again"
            )
        return (
            "this commander lost the bench, because it was silent for too long, its connection broke, or the "
            f"rig was restarted ({self.holder_text()} holds the bench now); inspect the bench, then connect again to "
            "take it"
        )
