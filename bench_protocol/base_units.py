"""SI units in base units: the exponents of kg, m, s, A, K, mol, cd and rad."""

import re
from collections.abc import Mapping
from typing import Final

BASES: Final = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_EXPONENTS: Final[dict[str, dict[str, int]]] = {
    "1": {},
    **{base: {base: 1} for base in BASES},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "C": {"A": 1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of an SI unit as this project writes it, such as ``N*m/(rad*Pa)``; ValueError for others."""
    above, _, below = unit.partition("/")
    total = dict.fromkeys(BASES, 0)
    for text, sign in ((above, 1), (below.strip("()"), -1)):
        for part in filter(None, text.split("*")):
            found = re.fullmatch(r"([A-Za-z]+|1)(\d*)", part)
            if found is None or found[1] not in _EXPONENTS:
                raise ValueError(f"unit {unit!r} has a part {part!r} that is none of {', '.join(_EXPONENTS)}")
            for base, power in _EXPONENTS[found[1]].items():
                total[base] += sign * power * int(found[2] or 1)
    return {base: power for base, power in total.items() if power}


def written(exponents: Mapping[str, int]) -> str:
    """Return the unit of these exponents in base units, such as ``m3/s``."""

    def product(sign: int) -> list[str]:
        powers = {base: sign * exponents.get(base, 0) for base in BASES}
        return [base + (str(power) if power > 1 else "") for base, power in powers.items() if power > 0]

    above, below = product(1), product(-1)
    over = f"/({'*'.join(below)})" if len(below) > 1 else "".join(f"/{one}" for one in below)
    return ("*".join(above) or "1") + over
