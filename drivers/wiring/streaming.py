"""Streaming of set-points from a wiring to its transports, from the first command on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from bench_protocol.arrays import Floats
from bench_protocol.clock import Clock
from bench_protocol.units import NS, ms
from drivers.errors import BenchError, Misuse, Refused
from drivers.wiring.contract import Transport
from drivers.wiring.lines import Description

#: Time for which an active rig may refuse set-points, because single ones may get lost during a change of state.
_REFUSED_FOR: Final = round(300 * ms * NS)
_NEVER: Final = 1 << 62


class Streaming:
    """Passes the set-points of a description to its ``transports``, cycle by cycle."""

    def __init__(self, rig: str, description: Description, transports: Mapping[str, Transport]) -> None:
        self._rig, self._description, self._transports = rig, description, transports
        table = description.table
        #: Table rows of the set-points that have no value until a command sets it. Those that are choices start with
        #: the first choice.
        self._numeric: Final = [
            table.index[name]
            for name, one in description.setpoints.items()
            if not one.given and not table[name].choices
        ]
        self.commanded = False
        self._active_since = _NEVER

    def open(self) -> None:
        """Reset to the state before the first command on this connection."""
        self.commanded, self._active_since = False, _NEVER

    def begin(self, clock: Clock) -> None:
        """Start heartbeats and cyclic messages, and wait until the rig has received some before the first command."""
        if not self.commanded and (received := self._give_life_signs()):
            wait = received + self._description.capabilities.latency
            clock.sleep_until(clock.now() + round(wait * NS))

    def _give_life_signs(self) -> float:
        self.commanded = True
        return max((one.begin() for one in self._transports.values()), default=0.0)

    def send(
        self, values: Floats, offsets: Mapping[int, float], time: int, *, active: bool
    ) -> BenchError | None:
        """Stream set-points (SI, by table row, NaN where nothing is set), with ``offsets`` (SI, by table row) added to
        them.

        ``time`` is the time of the cycle (ns). Return an error, or None. A refusal is an error if it lasts longer than
        `_REFUSED_FOR` while the rig is ``active``.
        """
        self._active_since = min(self._active_since, time) if active else _NEVER
        if not self.commanded:
            if np.isnan(values[self._numeric]).all():
                return None
            self._give_life_signs()
        streams = self._numbers(values, offsets)
        if not any(streams.values()):
            return None
        failure: BenchError | None = None
        for (
            name,
            points,
        ) in streams.items():  # all transports, because the heartbeat may use another one than the set-points
            try:
                self._transports[name].stream(points, time)
            except ValueError as error:  # beyond the range of the rig's numbers; the plan must know it
                failure = failure or Misuse(f"set-points cannot be sent to {self._rig}: {error}")
        return failure or self._refused(time)

    def _refused(self, time: int) -> BenchError | None:
        for name, one in self._transports.items():
            refusal = one.refusal
            if refusal is not None and time - max(refusal.since, self._active_since) > _REFUSED_FOR:
                text = f"{self._rig} refuses set-points on {name}: {refusal.error}"
                error = refusal.error
                return Refused(text, error.code) if isinstance(error, Refused) else type(error)(text)
        return None

    def _numbers(self, values: Floats, offsets: Mapping[int, float]) -> dict[str, dict[str, float]]:
        """Return the rig's numbers by point, for each transport. ``offsets`` (SI, by table row) are added to the
        ``values``. Set-points without a value are left out.
        """
        table = self._description.table
        streams: dict[str, dict[str, float]] = {name: {} for name in self._transports}
        for name, target in self._description.setpoints.items():
            signal, row = table[name], table.index[name]
            value = float(values[row])
            if row in offsets:
                value = min(max(value + offsets[row], signal.low), signal.high)
            number = target.conversion.number(value)
            if not math.isnan(number):
                transport, _, point = target.point.partition(".")
                streams[transport][point] = number
        return streams


def by_transport(points: Iterable[str]) -> dict[str, list[str]]:
    """Return the names of points by transport; the input has full names."""
    found: dict[str, list[str]] = {}
    for point in dict.fromkeys(points):
        transport, _, name = point.partition(".")
        found.setdefault(transport, []).append(name)
    return found
