"""The present value of every signal that the rig reports, with its age and its quality."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum

from bench_protocol.units import NS
from drivers.receiver import Receiver
from drivers.settings import UNKNOWN
from drivers.wiring.contract import refuse_absent


class Quality(StrEnum):
    """The validity of a reading."""

    GOOD = "good"
    STALE = "stale"  #: the last sample is too old
    MISSING = "missing"  #: no sample has arrived yet
    UNAVAILABLE = "unavailable"  #: the rig reports that it has no value


@dataclass(frozen=True, slots=True)
class Sample:
    """A value (SI, NaN unless good), its age (s, infinite before the first) and its quality."""

    value: float
    age: float
    quality: Quality


class Readings:
    """The present value of every measurement and status row: the latest sample, or polled on request.

    Raises NotAvailable for a signal that the rig does not have.
    """

    def __init__(self, receiver: Receiver, slow: Callable[[str], float]) -> None:
        self._receiver, self._slow = receiver, slow
        self._wiring, self._table, self._clock = receiver.wiring, receiver.table, receiver.clock
        self._limits: list[int] = []
        self._seen: dict[str, None] | None = None
        self.renew()

    def renew(self) -> None:
        """Read from the wiring the ages above which samples are stale; they are known once it is connected."""
        self._limits = [int(limit) for limit in self._wiring.freshness]

    def sample(self, name: str) -> Sample:
        """Return value, age and quality of the signal ``name``. Raises KeyError if the table has no such signal."""
        row = self._table.index[self._table[name].name]
        if self._seen is not None:
            self._seen[name] = None
        if self._limits[row] == 0:
            value = self._polled(name)
            return Sample(value, 0.0, Quality.UNAVAILABLE if math.isnan(value) else Quality.GOOD)
        value, time = self._receiver.latest(row)
        if time < 0:
            return Sample(math.nan, math.inf, Quality.MISSING)
        age = max(0, self._clock.now() - time)
        if age > self._limits[row]:
            return Sample(math.nan, age / NS, Quality.STALE)
        return Sample(value, age / NS, Quality.UNAVAILABLE if math.isnan(value) else Quality.GOOD)

    def value(self, name: str) -> float:
        """Return the value of ``name`` (SI); NaN unless its quality is good."""
        if self._seen is not None:
            self._seen[name] = None
        return self.glimpse(name) if self._limits[self._table.index[name]] else self._polled(name)

    def glimpse(self, name: str) -> float:
        """Return the value (SI) of the latest sample, NaN if it is stale.

        Unlike `value`, this does not store that the signal was read, so the message of a failed wait does not list the
        signal. Other threads therefore use it.
        """
        row = self._table.index[name]
        value, time = self._receiver.latest(row)
        return value if time >= 0 and self._clock.now() - time <= self._limits[row] else math.nan

    def value_or_nan(self, name: str) -> float:
        """Return the value of ``name`` (SI) as :meth:`value` does, but NaN if the rig does not have it."""
        return math.nan if name in self._wiring.absent else self.value(name)

    def known(self, name: str) -> float:
        """Return the value of ``name`` (SI) known without a request to the rig; NaN if there is none."""
        return self.value(name) if self._limits[self._table.index[name]] else math.nan

    def unknown(self, name: str) -> str:
        """Return as text why `known` has no value."""
        if not self._limits[self._table.index[name]]:
            return "read when asked"
        return _quality(self.sample(name))

    def choice(self, name: str) -> str:
        """Return the name of the state of the signal ``name``; ``"unknown"`` unless its quality is good."""
        value = self.value(name)
        choices = self._table[name].choices
        return choices[round(value)] if not math.isnan(value) and 0 <= value < len(choices) else UNKNOWN

    def show(self, name: str) -> str:
        """Return ``name = value unit`` as text, or why there is no value."""
        sample = self.sample(name)
        if sample.quality is Quality.GOOD:
            return f"{name} = {self._table[name].show(sample.value)}"
        return f"{name} is {_quality(sample)}"

    def _polled(self, name: str) -> float:
        refuse_absent(self._wiring, name)
        return self._slow(name)

    @contextmanager
    def watched(self) -> Iterator[dict[str, None]]:
        """Collect the names that are read inside the block, for the message of a failed wait."""
        seen: dict[str, None] = {}
        self._seen = seen
        try:
            yield seen
        finally:
            self._seen = None


def _quality(sample: Sample) -> str:
    since = f" for {sample.age:.3g} s" if sample.quality is Quality.STALE else ""
    return f"{sample.quality}{since}"
