"""The readings of a rig for other programs: value and unit, quality, and time of measurement."""

import logging
from datetime import UTC, datetime, timedelta
from math import inf, isfinite, nan
from typing import Final, NamedTuple

from astb.panel.signals import Shown
from astb.panel.watch import Watch
from bench_protocol.units import ms
from drivers.errors import BenchError
from drivers.reading import Quality, Sample

_LOG: Final = logging.getLogger(__name__)
#: Interval between two updates.
PERIOD: Final = 100 * ms
_NO_SAMPLE: Final = Sample(nan, inf, Quality.MISSING)


class ServedReading(NamedTuple):
    """A measurement: ``value`` is in the unit of ``signal``, NaN unless the quality is good.

    ``time`` is None without a sample.
    """

    signal: Shown
    value: float
    quality: Quality
    time: datetime | None


class ServedReadings:
    """The measurements of ``watch``. If reading them fails, none of them has a value."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._fault = ""  # the last unexpected error of reading

    def now(self) -> list[ServedReading]:
        """Return the present readings, one of each measurement."""
        try:
            samples = self._watch.samples()
        except Exception as error:  # any error: otherwise the last values would keep their quality
            if not isinstance(error, BenchError) and repr(error) != self._fault:
                self._fault = repr(error)  # reported once, not ten times a second
                _LOG.exception("the readings of %s could not be read", self._watch.rig.name)
            samples = {}
        return [_served(one, samples.get(one.name, _NO_SAMPLE)) for one in self._watch.shown]

    def none(self) -> list[ServedReading]:
        """Return all measurements without values."""
        return [_served(one, _NO_SAMPLE) for one in self._watch.shown]


def _served(signal: Shown, sample: Sample) -> ServedReading:
    time = datetime.now(UTC) - timedelta(seconds=sample.age) if isfinite(sample.age) else None
    return ServedReading(signal, signal.of(sample.value), sample.quality, time)
