"""A seeded mutator: takes valid inputs and kept seeds and changes them as bugs like it; the same for the same seed."""

import random
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

SEEDS = Path(__file__).parent / "seeds"
_NUMBERS = re.compile(rb"[0-9A-Fa-f]+")
#: Numbers at which widths, signs and limits change.
_EDGES = (
    0,
    1,
    7,
    8,
    9,
    0x7F,
    0x80,
    0xFF,
    0x100,
    0x7FF,
    0x800,
    0x7FFF,
    0x8000,
    0xFFFF,
    0x1FFFFFFF,
    0x20000000,
)
_EDGES += (2**31 - 1, 2**31, 2**32 - 1, 2**32, 9_223_372_036, 9_223_372_037, 2**63 - 1, 2**63, 2**64)
_BYTES = b"\0\1\x7f\x80\xff<> \t\n.+-,0aF"


def seeds(name: str) -> list[bytes]:
    """Return the kept inputs of a target: one a line in Python's spelling of bytes, without quotes."""
    lines = (SEEDS / f"{name}.txt").read_text(encoding="ascii").splitlines()
    return [line.encode().decode("unicode_escape").encode("latin-1") for line in lines]


def keep(name: str, data: bytes) -> None:
    """Keep an input that has found something."""
    with (SEEDS / f"{name}.txt").open("a", encoding="ascii") as file:
        file.write(repr(data)[2:-1].replace("\\'", "'") + "\n")


class Mutator:
    """Makes inputs of ``valid`` ones: text by its numbers and words, anything by its bits, bytes and parts."""

    def __init__(self, valid: Sequence[bytes], seed: int, *, text: bool) -> None:
        self._valid, self._text = list(valid), text
        self._chance = random.Random(f"fuzz {seed}")
        self._ways = (self._flip, self._byte, self._cut, self._double, self._splice, self._insert)
        if text:
            self._ways += (self._number, self._number, self._space)

    def inputs(self, count: int) -> Iterator[bytes]:
        """Yield ``count`` inputs."""
        for _ in range(count):
            yield self.next()

    def next(self) -> bytes:
        """Return one input: a valid one in twenty, else one with up to four changes."""
        chance = self._chance
        data = bytearray(chance.choice(self._valid))
        for _ in range(0 if chance.random() < 0.05 else 1 + int(4 * chance.random() ** 2)):
            if not data:
                break
            data = chance.choice(self._ways)(data, int(chance.random() * len(data)))
        return bytes(data)

    def _flip(self, data: bytearray, place: int) -> bytearray:
        data[place] ^= 1 << int(8 * self._chance.random())
        return data

    def _byte(self, data: bytearray, place: int) -> bytearray:
        data[place] = self._chance.choice(_BYTES)
        return data

    def _cut(self, data: bytearray, place: int) -> bytearray:
        del data[place : place + 1 + int(8 * self._chance.random() ** 2)]
        return data

    def _double(self, data: bytearray, place: int) -> bytearray:
        end = place + 1 + int(16 * self._chance.random() ** 2)
        return data[:end] + data[place:]

    def _splice(self, data: bytearray, place: int) -> bytearray:
        other = self._chance.choice(self._valid)
        return data[:place] + other[int(self._chance.random() * len(other)) :]

    def _insert(self, data: bytearray, place: int) -> bytearray:
        data[place:place] = bytes([self._chance.choice(_BYTES)]) * (1 + int(20 * self._chance.random() ** 4))
        return data

    def _number(self, data: bytearray, place: int) -> bytearray:
        found = _NUMBERS.search(data, place)
        if found:
            number = self._chance.choice(_EDGES)
            data[found.start() : found.end()] = (b"%x" if self._chance.random() < 0.5 else b"%d") % number
        return data

    def _space(self, data: bytearray, place: int) -> bytearray:
        place = data.find(b" ", place)
        if place >= 0:
            data[place : place + 1] = self._chance.choice((b"", b"  ", b"\t", b" \t ", b"\n", b" " * 9))
        return data
