"""The parameter file that an identification begins with, and the one that it writes."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from astb_studies.paper.identification.fits import Fit, Floats, NotIdentified
from bench_protocol.units import FACTORS


class Known:
    """The parameters of a file (SI), by name; one number for both springs."""

    def __init__(self, base: str) -> None:
        self.entries: dict[str, Any] = {}
        for section in tomllib.loads(base).values():
            self.entries |= {name: one for name, one in section.items() if isinstance(one, dict)}

    def all(self, name: str) -> Floats:
        """Return every number of a parameter; NotIdentified if the file lacks it or its unit is strange."""
        entry = self.entries.get(name)
        if entry is None:
            raise NotIdentified(f"the base parameter file has no {name}")
        if entry["unit"] not in FACTORS:
            raise NotIdentified(f"{name} is in {entry['unit']}; {', '.join(FACTORS)} are known")
        return np.atleast_1d(np.array(entry["value"], np.float64)) * FACTORS[entry["unit"]]

    def __getitem__(self, name: str) -> float:
        return float(self.all(name).mean())


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A value (SI) with its confidence interval of 95 %."""

    value: float
    low: float
    high: float


def fitted_values(found: Fit, names: Iterable[str]) -> dict[str, FittedValue]:
    """Return the named values of a fit with their intervals."""
    return {name: FittedValue(found[name], *found.interval(name)) for name in names}


_ENTRY: Final = r"^{name} = \{{.*\}}$"


def write_parameters(path: Path | str, base: str, fitted: Mapping[str, FittedValue], source: str) -> Path:
    """Write ``base`` (the text of a parameter file) with the ``fitted`` values in place of its own; return the path.

    Each gets the provenance "measured", its interval and ``source``, which names the record. NotIdentified, and no
    file, for a parameter that the base lacks or a value outside its range there.
    """
    entries = Known(base).entries
    text = base
    for name, one in fitted.items():
        entry = entries.get(name)
        if entry is None:
            raise NotIdentified(f"the base parameter file has no {name}")
        unit = entry["unit"]
        value, low, high = (number / FACTORS[unit] for number in (one.value, one.low, one.high))
        if not entry["min"] <= value <= entry["max"]:
            raise NotIdentified(
                f"{name} = {value:.6g} {unit} is outside {entry['min']:g} to {entry['max']:g} {unit}"
            )
        told = f"{source}; 95 % within {low:.5g} to {high:.5g} {unit}".replace("\\", "/").replace('"', "'")
        line = (
            f'{{ value = {value:.7g}, unit = "{unit}", min = {entry["min"]}, max = {entry["max"]}, '
            f'provenance = "measured", source = "{told}" }}'
        )
        text, count = re.subn(
            _ENTRY.format(name=re.escape(name)),
            f"{name} = {line}".replace("\\", r"\\"),
            text,
            flags=re.MULTILINE,
        )
        if count != 1:
            raise NotIdentified(
                f"{name} stands {count} times on a line of its own in the base file; once is right"
            )
    target = Path(path)
    target.write_text(text, encoding="utf-8", newline="\n")
    return target
