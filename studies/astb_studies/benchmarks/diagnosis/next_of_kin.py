"""Effects that are nearly equal: the names that count as similar to a hidden effect, and not as wrong causes."""

from collections.abc import Mapping
from typing import Final

#: Hidden effects, and the similar effects that do not count as wrong causes.
NEAR: Final[Mapping[str, frozenset[str]]] = {
    "maxwell_two": frozenset({"maxwell", "fractional"}),
    "friction_distributed": frozenset({"friction"}),
    "fractional": frozenset({"maxwell", "maxwell_two"}),
    "leak_laminar": frozenset({"leak"}),
    "leak": frozenset({"leak_laminar"}),
    "force_lag": frozenset({"force_latency"}),
    "force_latency": frozenset({"force_lag"}),
    "pressure_lag": frozenset({"pressure_latency", "sample_and_hold"}),
    "pressure_latency": frozenset({"pressure_lag", "sample_and_hold"}),
    "sample_and_hold": frozenset({"pressure_lag", "pressure_latency"}),
}


def kin(name: str) -> list[str]:
    """Return the effects similar to one effect, at the same place."""
    kind, _, place = name.partition(".")
    return [f"{other}.{place}" if place else other for other in NEAR.get(kind, ())]
