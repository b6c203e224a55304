"""Writer of points to a Modbus device: in as few requests as possible, by the functions that the device supports."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.modbus import BITS_WRITE_MAX, ILLEGAL_FUNCTION, REGISTERS_READ_WRITE_MAX
from drivers.errors import Refused
from drivers.wiring.modbus.keys import IN_PARTS, Writes
from drivers.wiring.modbus.registers import BITS_PER_REGISTER, RegisterPoint

if TYPE_CHECKING:
    from drivers.modbus_port import ModbusPort

Coded = list[tuple[RegisterPoint, list[int]]]
#: Values of the key ``writes`` with which the functions for coils are found by trial.
_FIND_OUT: Final = ("any", "combined")
Ask = Callable[[Callable[["ModbusPort"], Any]], Any]


class Writer:
    """Writes points with as few requests as possible; if the device lacks a function, another one is used."""

    def __init__(self, writes: Writes, request_max: int) -> None:
        self._writes, self._most = writes, request_max
        self._one_register = self._one_coil = writes in ("single", "parts")
        self._many_coils = writes == "multiple"
        self._combined = writes == "combined"

    def write(self, coded: Coded, ask: Ask) -> None:
        """Write ``coded``, points with their register values, in this order; ``ask`` sends one request."""
        for run in self._runs(coded):
            first = run[0][0]
            words = [word for _, part in run for word in part]
            if first.table == "coil":
                self._coils(first.address, [bool(word) for word in words], ask)
            elif first.in_word:
                (word,) = ask(partial(_read_one, first.address))
                for point, (bit,) in run:
                    word = point.with_bit(word, bit)
                self._registers(first.address, [word], [1], ask)
            else:
                self._registers(first.address, words, [point.size for point, _ in run], ask)

    def _registers(self, address: int, words: list[int], sizes: list[int], ask: Ask) -> None:
        if self._combined:
            ask(lambda port: port.exchange_registers(address, words))
            return
        if not self._one_register:
            try:
                ask(lambda port: port.write_registers(address, words))
                return
            except Refused as refused:
                if self._writes != "any" or refused.code != ILLEGAL_FUNCTION:
                    raise _with_hint(refused, sizes) from None
                if self._combines(address, words, ask):
                    return
                if max(sizes) > 1:
                    raise _with_hint(refused, sizes) from None
        for k, word in enumerate(words):
            ask(partial(_write_one, address + k, word))
        self._one_register = True

    def _combines(self, address: int, words: list[int], ask: Ask) -> bool:
        """Write registers by function 23 if the device supports it, and use it from then on; return whether it does."""
        try:
            ask(lambda port: port.exchange_registers(address, words))
        except Refused as refused:
            if refused.code != ILLEGAL_FUNCTION:
                raise
            return False
        self._combined = True
        return True

    def _coils(self, address: int, bits: list[bool], ask: Ask) -> None:
        if self._one_coil or (len(bits) == 1 and not self._many_coils):
            try:
                for k, bit in enumerate(bits):
                    ask(partial(_write_bit, address + k, bit))
                return
            except Refused as refused:
                if self._writes not in _FIND_OUT or refused.code != ILLEGAL_FUNCTION or self._one_coil:
                    raise
                self._many_coils = True
        try:
            ask(lambda port: port.write_coils(address, bits))
        except Refused as refused:
            if self._writes not in _FIND_OUT or refused.code != ILLEGAL_FUNCTION or self._many_coils:
                raise
            self._one_coil = True
            self._coils(address, bits, ask)

    def _runs(self, coded: Coded) -> list[Coded]:
        """Return the groups that can be written with one request each: neighbours in one table, or bits of one word."""
        runs: list[Coded] = []
        for point, words in coded:
            if runs and self._follows(runs[-1], point):
                runs[-1].append((point, words))
            else:
                runs.append([(point, words)])
        return runs

    def _follows(self, run: Coded, point: RegisterPoint) -> bool:
        first, last = run[0][0], run[-1][0]
        if point.table != last.table:
            return False
        if point.in_word or last.in_word:
            return point.in_word and last.in_word and point.address == last.address
        if point.table == "coil":
            limit = min(BITS_WRITE_MAX, BITS_PER_REGISTER * self._most)
        else:
            limit = min(REGISTERS_READ_WRITE_MAX, self._most)
        return point.address == last.end and point.end - first.address <= limit


def _with_hint(refused: Refused, sizes: list[int]) -> Refused:
    if refused.code != ILLEGAL_FUNCTION or max(sizes) < 2:
        return refused
    return Refused(
        f"{refused}; function 6, which it may know, writes a number of {max(sizes)} registers in parts: {IN_PARTS}",
        refused.code,
    )


def _read_one(address: int, port: ModbusPort) -> list[int]:
    return port.read_holding(address, 1)


def _write_one(address: int, word: int, port: ModbusPort) -> None:
    port.write_register(address, word)


def _write_bit(address: int, bit: bool, port: ModbusPort) -> None:
    port.write_coil(address, bit)
