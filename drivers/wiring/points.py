"""The points of all transports of a wiring, by their full names: TRANSPORT.POINT."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from bench_protocol.clock import Clock
from bench_protocol.units import NS, ms
from drivers.errors import LinkLost, WiringError
from drivers.wiring.contract import Transport
from drivers.wiring.streaming import by_transport

#: Period of polling whether a rig has accepted a setting, or responds.
LOOK: Final = round(20 * ms * NS)


class Points:
    """Reads and writes points over the ``transports`` that have them, in as few messages as possible."""

    def __init__(self, transports: Mapping[str, Transport]) -> None:
        self._transports = transports

    def require(self, key: str, point: str, *, writable: bool) -> None:
        """Raise WiringError with the ``key`` for a point that does not exist, or cannot be written."""
        transport, _, name = point.partition(".")
        try:
            self._transports[transport].require(name, writable=writable)
        except WiringError as error:
            raise WiringError(f"{key} = {point!r}: {error}") from None

    def stale(self, point: str) -> float:
        """Return the age (s) above which a point is stale; 0 if it is polled on request."""
        transport, _, name = point.partition(".")
        return self._transports[transport].stale(name)

    def read(self, points: Iterable[str]) -> dict[str, float]:
        """Return points with one request to each transport."""
        found = {}
        for transport, names in by_transport(points).items():
            numbers = self._transports[transport].read(names)
            found.update({f"{transport}.{name}": numbers[name] for name in names})
        return found

    def await_values(self, points: Sequence[str], clock: Clock, deadline: int) -> dict[str, float]:
        """Return points once all have a value, or at the ``deadline`` (ns), then with NaN for those without a value."""
        while True:
            values = self.read(points)
            if not any(map(math.isnan, values.values())) or clock.now() >= deadline:
                return values
            clock.sleep_until(min(deadline, clock.now() + LOOK))

    def await_news(self, rig: str, clock: Clock, deadline: int, within: float) -> None:
        """Wait for input on every transport that receives without request. Raises LinkLost at the ``deadline`` (ns);
        its text states the time ``within`` (s).
        """
        for name, transport in self._transports.items():
            while transport.period > 0 and math.isinf(transport.alive()):
                if clock.now() >= deadline:
                    raise LinkLost(
                        f"{rig} is silent: no value came on transport {name} within {within:g} s; check its connection"
                    )
                clock.sleep_until(min(deadline, clock.now() + LOOK))

    def write(self, points: Mapping[str, float]) -> None:
        """Write points in the given order, those of one transport together."""
        for transport, names in by_transport(points).items():
            self._transports[transport].write({name: points[f"{transport}.{name}"] for name in names})
