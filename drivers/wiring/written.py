"""Values in a wiring file: a choice, a value with its unit, or a number of the rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from bench_protocol.signals import Signal
from bench_protocol.suggestion import did_you_mean
from drivers.errors import WiringError
from drivers.wiring.conversion import quantity


def si_value(where: str, signal: Signal, given: object) -> float:
    """Return a value of a signal (a choice, "5 bar", a number without unit) in SI. Raises WiringError if invalid."""
    if isinstance(given, str) and signal.choices:
        if given not in signal.choices:
            raise WiringError(
                f"{where} = {given!r} is not a choice of {signal.name}; {did_you_mean(given, signal.choices)}"
            )
        return float(signal.choices.index(given))
    if isinstance(given, str):
        value = quantity(where, given, signal.si)
    else:
        value = plain_number(where, given)
        if signal.unit != "1":
            raise WiringError(f'{where} = {given!r} has no unit; write it like "{given} {signal.unit}"')
    if not signal.low <= value <= signal.high or (signal.choices and value != round(value)):
        raise WiringError(
            f"{where} = {given!r} is out of the range of {signal.name}; use {signal.range_text()}"
        )
    return value


def plain_number(where: str, given: object) -> float:
    """Return a number of the rig. Raises WiringError for anything else."""
    if isinstance(given, bool) or (isinstance(given, int | float) and math.isfinite(given)):
        return float(given)
    raise WiringError(f"{where} = {given!r} is not a number; write one, such as 0.5")


def order_names(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted names and their values, because TOML reads an unquoted dot as a nested table."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from order_names(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
