"""Effects that are nearly one another: what may be said of one without accusing anybody wrongly."""

from collections.abc import Mapping
from typing import Final

#: A truth that is nearly something else, and what else may be said of it without accusing anybody wrongly.
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
    """The next of kin of an effect at the same place."""
    kind, _, place = name.partition(".")
    return [f"{other}.{place}" if place else other for other in NEAR.get(kind, ())]
