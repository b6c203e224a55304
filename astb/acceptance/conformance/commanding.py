"""Tests of command rights: the lease, invalid settings, and commands that a rig must ignore. They move nothing."""

import struct
from collections.abc import Callable
from contextlib import closing
from typing import TYPE_CHECKING, Final

import numpy as np

from astb.acceptance.conformance.leaving import leave, note_rest, take
from astb.acceptance.conformance.raw_access import ModbusConnection, RawAccess
from astb.acceptance.conformance.report import Notebook
from bench_protocol.can_codec import Encoder
from bench_protocol.clock import Task
from bench_protocol.frames import Block
from bench_protocol.messages import TOKEN
from bench_protocol.modbus import DEVICE_FAILURE, ILLEGAL_VALUE, NO_AUTHORITY
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.registers import LEASE_ADDRESS, WATCHDOG_ADDRESS
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms, s

if TYPE_CHECKING:
    from drivers.can_port import CanPort

_CYCLE: Final = 1.0 / COMMAND_RATE
#: The rig reports its counters ten times a second.
TOLD: Final = 250 * ms
#: Longest time of a rig from power-on to DISABLED.
READY_WITHIN: Final = 10 * s
#: Number of wrong frames of each kind.
WRONG: Final = 5


class Stream:
    """Sends the commands of one lease holder every 20 ms, until it is stopped."""

    def __init__(self, access: RawAccess, token: int) -> None:
        self._access, self._encoder = access, Encoder(TABLE)
        self.values = np.full(len(TABLE.signals), np.nan)
        for bit in ("enable", "hold", "active", "reset"):
            self.set(f"control.{bit}", 0.0)
        self.set(TOKEN, token)
        self._encoder.bind(token)
        self._rows = self._encoder.rows(["Control"])
        self._task: Task | None = None

    def set(self, name: str, value: float) -> None:
        """Send this value of a command (SI) from the next cycle on."""
        self.values[TABLE.index[name]] = value

    def carry(self, *messages: str) -> None:
        """Send these messages in each cycle, from the next cycle on, in this order."""
        self._rows = self._encoder.rows(messages)

    def start(self) -> None:
        """Start sending."""
        self._task = self._access.clock.every(round(_CYCLE * NS), self.send)

    def stop(self) -> None:
        """Stop sending."""
        if self._task:
            self._task.cancel()
            self._task = None

    def send(self, change: Callable[[Block], None] | None = None, port: "CanPort | None" = None) -> None:
        """Send one block of commands.

        ``change`` edits the block first; ``port`` is used instead of the listener's port.
        """
        block = self._encoder.encode(self.values, self._rows, self._access.clock.now())
        if change:
            change(block)
        (port or self._access.listener.port).send(block)


def command(access: RawAccess) -> list[Notebook]:
    """Test commands with and without the lease, and return the findings. The state of the bench does not change."""
    line = access.modbus()
    leases, settings, commands, left = (
        Notebook("lease"),
        Notebook("settings"),
        Notebook("commands"),
        Notebook("settings after a command"),
    )
    if (code := line.write(LEASE_ADDRESS, struct.pack(">H", 1))) != 0:
        leases.skip("all tests", f"another client has the lease (exception {code})")
        return [leases]
    shown = False
    try:
        token = line.words(LEASE_ADDRESS, 1, function=3)[0]
        leases.note("token after a request", token != 0, "not 0" if token else "0", "not 0")
        _lease(access, leases, token)
        _settings(line, settings)
        if access.wait_for(lambda: access.listener.state == "DISABLED", READY_WITHIN):
            _commands(access, token, commands)
            if not (shown := leave(line, targets=False)):
                left.skip("settings", "the rig did not apply them")
        else:
            why = f"the bench is {access.listener.state}, but must be DISABLED"
            commands.skip("all tests", why)
            left.skip("settings", why)
    finally:
        line.write(LEASE_ADDRESS, b"\0\0")
    after = line.words(LEASE_ADDRESS, 1, function=3)[0]
    leases.note(
        "lease after writing 0",
        after == 0,
        "free" if after == 0 else "not free",
        "free",
    )
    _joins(access, leases)
    if shown:
        _ends(access, left)
    return [leases, settings, commands, left]


def _ends(access: RawAccess, book: Notebook) -> None:
    """Check that settings have their rest values after the lease was returned, and after a connection with the lease
    was closed.
    """
    note_rest(access, book, "return of the lease")
    line = access.modbus()
    if take(line) and leave(line, targets=False):
        line.close()
        note_rest(access, book, "end of the connection")


def _joins(access: RawAccess, book: Notebook) -> None:
    """Take the lease on CAN alone, and check which Modbus connections may join it."""
    encoder, values, port = Encoder(TABLE), np.zeros(len(TABLE.signals)), access.listener.port
    rows = encoder.rows(["LeaseRequest"])

    def request(token: int) -> None:
        values[TABLE.index["lease.nonce"]], values[TABLE.index["lease.token"]] = nonce, token
        port.send(encoder.encode(values, rows, access.clock.now()))

    def answered() -> bool:
        listener = access.listener
        return listener.latest("lease.nonce") == nonce and listener.latest("rig.lease") > 0

    nonce = int(np.nan_to_num(access.listener.latest("lease.nonce"))) ^ 0x5A5A
    request(0)
    granted = access.wait_for(answered, TOLD)
    book.note("request on CAN", granted, "granted" if granted else "no answer", "granted")
    if not granted:
        return
    token = int(access.listener.latest("rig.lease"))
    line, other, stream = access.modbus(), access.modbus(), Stream(access, token)
    stream.start()
    try:
        joins = other.write(LEASE_ADDRESS, struct.pack(">H", token))
        book.refusal("another Modbus client writes the token that it read on CAN", joins, NO_AUTHORITY)
        request(line.words(LEASE_ADDRESS, 1, function=3)[0])
        access.wait(2 * _CYCLE)
        code = line.write(LEASE_ADDRESS, struct.pack(">H", token))
        found = "accepted" if code == 0 else f"exception {code}"
        book.note("the lease holder on CAN allows a Modbus connection", code == 0, found, "accepted")
    finally:
        stream.stop()
        request(token)
        access.wait(2 * _CYCLE)
        line.close()
        other.close()


def _lease(access: RawAccess, book: Notebook, token: int) -> None:
    other = access.modbus()
    hidden = other.words(LEASE_ADDRESS, 1, function=3)[0] != token
    found = "a different number" if hidden else "the token"
    book.note("another client reads the token before the first command", hidden, found, "a different number")
    before = _reported(access, "rig.strangers")
    book.refusal("another client requests the lease", other.write(LEASE_ADDRESS, b"\0\1"), NO_AUTHORITY)
    setting = TABLE["generator.cycles"]
    book.refusal(
        "another client writes a setting", other.write(setting.address or 0, _float(1.0)), NO_AUTHORITY
    )
    book.refusal(
        "another client triggers an action", other.press(TABLE["action.air_low"].address or 0), NO_AUTHORITY
    )
    book.refusal(
        "another client writes to the watchdog", other.write(WATCHDOG_ADDRESS, b"\0\0"), NO_AUTHORITY
    )
    counted = _reported(access, "rig.strangers") - before
    book.note("rig.strangers counts refused clients", counted == 4, f"{counted:g}", "4")


def _settings(line: ModbusConnection, book: Notebook) -> None:
    for name in ("generator.frequency", "air.left_target"):
        signal = TABLE[name]
        address = signal.address or 0
        staged = line.words(address, 2, function=3)
        for what, value in (
            ("NaN", np.nan),
            ("infinity", np.inf),
            ("above its range", signal.high + 2.0 * (signal.high - signal.low)),
            ("below its range", signal.low - 2.0 * (signal.high - signal.low)),
        ):
            book.refusal(f"{name}, {what}", line.write(address, _float(value)), ILLEGAL_VALUE)
        book.refusal(f"{name}, one register of the float", line.write(address, b"\0\0"), ILLEGAL_VALUE)
        same = line.words(address, 2, function=3) == staged
        book.note(
            f"{name}, after these refused writes", same, "unchanged" if same else "changed", "unchanged"
        )
    choice = TABLE["vertical.control"]
    book.refusal(
        "vertical.control = 0.5 (no valid choice)",
        line.write(choice.address or 0, _float(0.5)),
        ILLEGAL_VALUE,
    )
    book.refusal(
        "watchdog time of 60 s", line.write(WATCHDOG_ADDRESS, struct.pack(">H", 60_000)), ILLEGAL_VALUE
    )
    run = TABLE["action.program_run"].address or 0
    book.refusal("start of the function generator outside ACTIVE", line.press(run), DEVICE_FAILURE)


def _commands(access: RawAccess, token: int, book: Notebook) -> None:
    stream = Stream(access, token)

    def counted(
        counter: str, change: Callable[[Block], None] | None = None, port: "CanPort | None" = None
    ) -> float:
        before = _reported(access, counter)
        for _ in range(WRONG):
            stream.send(change, port)
            access.wait(_CYCLE)
        return _reported(access, counter) - before

    def note(
        what: str,
        counter: str,
        right: int,
        change: Callable[[Block], None] | None = None,
        port: "CanPort | None" = None,
    ) -> None:
        found = counted(counter, change, port)
        book.note(what, found == right, f"{counter} counts {found:g} of {WRONG}", f"{right} of {WRONG}")

    note("valid commands", "rig.rejected_commands", 0)
    note("commands with a wrong CRC", "rig.rejected_commands", WRONG, _spoil)
    stream.values[TABLE.index[TOKEN]] = token ^ 0x5A5A
    note("commands with a wrong token", "rig.strangers", WRONG)
    stream.set(TOKEN, token)
    stream.send()  # a holder without valid commands for 2 s loses the lease
    other = "commands with the right token from another connection"
    if access.listener.port.local_ports:
        with closing(access.can()) as port:
            note(other, "rig.strangers", WRONG, port=port)
    else:
        book.skip(other, "frames on this bus do not identify their sender")
    for bit in ("hold", "active"):
        stream.set(f"control.{bit}", 1.0)
    counted("rig.rejected_commands")
    state = access.listener.state
    book.note("bits H and M in the state DISABLED", state == "DISABLED", state, "DISABLED")
    for signal in TABLE.of_kind(Kind.SETPOINT):
        if signal.name.endswith("_setpoint"):
            stream.set(signal.name, np.nan)
    stream.carry("DisplacementSetpoints")
    note("set-points marked as not available", "rig.refused_setpoints", 0)
    # The field has codes beyond the range of its signal.
    beyond = TABLE["lateral.displacement_setpoint"]
    stream.set(beyond.name, 1.05 * beyond.high)
    note("set-points out of range", "rig.refused_setpoints", WRONG)


def _spoil(block: Block) -> None:
    block["data"][:, 0] ^= 0x5A


def _reported(access: RawAccess, counter: str) -> float:
    access.wait(TOLD)
    return access.listener.latest(counter)


def _float(value: float) -> bytes:
    return struct.pack(">f", value)
