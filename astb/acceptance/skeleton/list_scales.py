"""Scale factors and sizes of the numbers in a list of registers; ambiguous cells are left out, never guessed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from astb.acceptance.skeleton.list_words import ORDERS, SCALING, TYPES, WORDS
from drivers.errors import WiringError

#: An exponent of ten that a register may have.
_EXPONENT_MAX: Final = 12
#: Units of a size column: registers, bytes and bits, each with the number that fills one register.
_SIZES: Final = (1, 2, 16)
#: Cells that change no number.
_NOTHING: Final = re.compile(r"|[-–—]|none|n/?a|x?\s*1([.,]0+)?|1\s*/\s*1|1:1|10\^0", re.IGNORECASE)


class LeftOut(Exception):
    """A point that is not filled in, because a cell of its row is not understood; the text is the reason."""


def kind_of(where: str, text: str) -> tuple[str, tuple[str, str] | None]:
    """Return the data type, and the order of words and bytes, for a text such as FLOAT32 CDAB, INT32 (word swapped), or
    32 bit float. The order is None if the text does not state it.
    """
    if not text:
        return "", None
    words = re.sub(r"[-_()\[\],;]+", " ", text.lower())
    order = None
    for name in sorted(WORDS, key=len, reverse=True):
        if re.search(rf"(?<![a-z]){re.escape(name)}(?![a-z])", words):
            order = ORDERS[WORDS[name]]
            words = re.sub(rf"(?<![a-z]){re.escape(name)}(?![a-z])", " ", words)
            break
    plain = words.replace(" ", "").replace("bits", "").replace("integer", "int")
    plain = plain.replace("bit", "") if plain != "bit" else plain
    plain = re.sub(r"^(16|32|64)(\D+)$", r"\2\1", plain)
    kind = TYPES.get(plain)
    if kind is None:
        known = ", ".join(dict.fromkeys(TYPES.values()))
        raise WiringError(
            f"{where}, column type: {text!r} is unknown; use {known}, followed by ABCD, CDAB, BADC or DCBA if necessary"
        )
    return kind, order


def comma_in(scales: Sequence[str]) -> bool:
    """Whether the factors of a list have decimal commas."""
    return any(re.search(r"\d,\d", scale) for scale in scales)


def scale_of(where: str, text: str, commas: bool, key: str = "scale") -> float:
    """Return the number in a cell, 1 for an empty cell.

    Raises WiringError if the text is not a number, or is ambiguous.
    """
    if not text:
        return 1.0
    wrong = WiringError(f"{where}: {key} = {text!r} must be a number, such as 0.01 or 1/100")
    if commas and "." in text:
        raise WiringError(
            f"{where}: {key} = {text!r} has a decimal point, but other rows have decimal commas; use one of them"
        )
    if re.fullmatch(r"[-+]?[1-9]\d{0,2},\d{3}", text):
        raise WiringError(
            f"{where}: {key} = {text!r} may be a thousand or have three decimals; write the number with a decimal point"
        )
    parts = text.replace(",", ".").split("/")
    try:
        numbers = [float(part) for part in parts if "_" not in part]
        scale = numbers[0] / numbers[1] if len(parts) == 2 else numbers[0]
    except (ValueError, IndexError, ZeroDivisionError):
        raise wrong from None
    if len(numbers) != len(parts) or len(parts) > 2 or not 0.0 < abs(scale) < float("inf"):
        raise wrong
    return scale


def factor_of(text: str, column: str, exponents: bool) -> float:
    """Return the factor in a column such as "Scale factor" or "SF". Raises LeftOut if it is ambiguous.

    With ``exponents``, the cell is a power of ten. Otherwise a factor above 1 is ambiguous, because it may multiply or
    divide.
    """
    plain = text.replace(",", ".").removeprefix("10^").strip()
    if exponents or text.startswith("10^"):
        if re.fullmatch(r"[-+]?\d{1,2}(\.0+)?", plain) and abs(float(plain)) <= _EXPONENT_MAX:
            return float(10.0 ** int(float(plain)))
        raise LeftOut(
            f"column {column} has {text!r}, which is not an exponent of ten; use a whole number from "
            "-12 to 12"
        )
    if not text:
        return 1.0
    try:
        scale = scale_of("", text, False)
    except WiringError:
        raise LeftOut(f"column {column} has {text!r}, which is not a number; use a column scale") from None
    if not 0.0 < scale <= 1.0:
        raise LeftOut(
            f"column {column} has {text}, which may be a multiplier or a divisor; use a column multiplier or divisor"
        )
    return scale


def are_exponents(cells: Sequence[str]) -> bool:
    """Whether the cells of a column "SF" are powers of ten, as in SunSpec: integers, at least one of them negative."""
    found = [cell.replace(",", ".") for cell in cells if cell]
    whole = all(re.fullmatch(r"[-+]?\d{1,2}", cell) for cell in found)
    return whole and any(cell.startswith("-") for cell in found)


def unread_scaling(names: Sequence[str], used: Sequence[int], cells: Sequence[str]) -> str:
    """Return a text on the first unread column whose cell may change the number of a row; "" if there is none."""
    for index, name in enumerate(names):
        cell = cells[index].strip() if index < len(cells) else ""
        if index in used or not SCALING.search(name.lower()) or _NOTHING.fullmatch(cell):
            continue
        if not re.fullmatch(r"0([.,]0+)?", cell):
            return f"column {name} with {cell!r} may change the numbers, but its meaning is unknown; use a column scale"
    return ""


def size_units(head: str, sizes: Sequence[tuple[str, int]]) -> set[int]:
    """Return the possible units of a size column, each as its number per register: 1 (registers), 2 (bytes), 16 (bits).

    ``sizes`` are pairs of a cell and the number of registers that the type states, 0 if unknown. A unit is possible if
    all cells agree with it.
    """
    units = {"word": 1, "regist": 1, "byte": 2, "bit": 16}
    found = {unit for word, unit in units.items() if word in head.lower()} or set(_SIZES)
    numbers = [(int(cell), known) for cell, known in sizes if cell.isdigit()]
    if any(number == 1 and known != 0 for number, known in numbers):
        return found & {1}
    return {
        unit
        for unit in found
        if all(number == known * unit if known else number % unit == 0 for number, known in numbers)
    }


def sized_type(kind: str, explicit: bool, size: str, units: set[int]) -> str:
    """Return the data type with its size from the cell ``size``.

    Raises LeftOut if type and size contradict each other, or if the size is ambiguous.
    """
    if not size or kind == "bit":
        return kind
    if not size.isdigit() or not int(size):
        raise LeftOut(f"its size {size!r} is not a number; write a number of registers, bytes or bits")
    may = {int(size) // unit for unit in units or _SIZES if int(size) % unit == 0}
    wide = {"16": 1, "32": 2, "64": 4}.get(kind[-2:], 1)
    if explicit and wide in may:
        return kind
    fit = may & {1, 2, 4}
    if explicit or len(fit) != 1:
        raise LeftOut(
            f"its number of registers is unknown (size {size}, type {kind or 'unknown'}); state both"
        )
    registers = fit.pop()
    if not kind and registers > 1:
        raise LeftOut(f"its data type is missing ({registers} registers); state the type")
    return f"{kind.rstrip('0123456789')}{16 * registers}" if kind else kind


def null_of(text: str, kind: str) -> str:
    """Return the raw value that marks a missing value, as text for the wiring; "" if the cell states none.

    Raises LeftOut if the cell is not a number.
    """
    if not text or text.lower() in ("nan", "-"):
        return ""
    plain = re.sub(r"^16#|(?<=[0-9a-f])h$", "", text.strip().lower())
    try:
        number = int(plain, 16) if plain != text.strip().lower() else int(plain, 0)
    except ValueError:
        try:
            return f"{float(text.replace(',', '.')):.12g}"
        except ValueError:
            raise LeftOut(
                f"its code for a missing value, {text!r}, is not a number; write it as 32767 or 0x7FFF"
            ) from None
    bits = int(kind[-2:]) if kind.startswith("int") else 0
    return str(number - (1 << bits) if bits and number >= 1 << bits - 1 else number)


def shared_registers(places: Mapping[str, tuple[str, int, int, str]]) -> list[str]:
    """Return a text on each pair of points on the same register.

    ``places``: table, address, number of registers and bit, by name.
    """
    found = []
    ordered = sorted(places.items(), key=lambda one: one[1][:2])
    for index, (name, (table, address, size, bit)) in enumerate(ordered):
        for other, (there, at, _, its_bit) in ordered[index + 1 :]:
            if there != table or at >= address + size:
                break
            if not (bit and its_bit and bit != its_bit):
                found.append(f"{name} and {other} are both on {table} register {at}; correct one of them")
    return found
