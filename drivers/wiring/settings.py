"""The settings of a described wiring: written all or none, and confirmed by the rig or remembered."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Mapping

from bench_protocol.clock import Clock
from bench_protocol.modbus import DEVICE_FAILURE
from bench_protocol.units import NS
from drivers.errors import BenchError, NotAvailable, Refused
from drivers.wiring.lines import Description
from drivers.wiring.points import LOOK, Points


class PointSettings:
    """The settings of the rig ``rig``, as listed in ``description``.

    ``apply`` activates written settings, on a rig that stages them.
    """

    def __init__(self, rig: str, description: Description, points: Points, apply: Callable[[], None]) -> None:
        self._rig, self._table, self._points, self._apply = rig, description.table, points, apply
        self._settings = description.settings
        self._known = {name: setting.initial for name, setting in self._settings.items()}

    def await_reported(self, clock: Clock, deadline: int) -> None:
        """Wait until every setting was reported once, or until the ``deadline`` (ns). A setting that is never reported
        stays unknown.
        """
        self._points.await_values([one.read for one in self._settings.values() if one.read], clock, deadline)

    def source(self, name: str) -> tuple[str, ...]:
        """Return the points that report a setting, or () if the rig does not report it."""
        read = self._settings[name].read
        return (read,) if read else ()

    def si(self, name: str, numbers: Mapping[str, float]) -> float:
        """Return the value (SI) of a setting from the ``numbers`` of its points, NaN if it is not known."""
        one = self._settings[name]
        if one.fixed is not None:
            return one.fixed
        return one.conversion.si(numbers[one.read]) if one.read else self._known[name]

    def write(self, values: Mapping[str, float], clock: Clock | None) -> None:
        """Write ``values`` (SI) and wait for confirmation. Raises Refused without confirmation. After any error, the
        old values are written again, as far as they are known.
        """
        numbers = {name: self._number(name, value) for name, value in values.items()}
        written = {name: number for name, number in numbers.items() if number is not None}
        before = self._present_numbers(written)
        try:
            self._points.write({self._settings[name].point: number for name, number in written.items()})
            if written:
                self._apply()
            for name in written:
                self._acknowledged(name, values[name], clock)
        except (BenchError, ValueError):
            with contextlib.suppress(BenchError, ValueError):
                self._points.write(before)
                self._apply()
            raise
        self._known.update({name: values[name] for name in written})

    def _number(self, name: str, value: float) -> float | None:
        """Return the rig's number for ``value`` (SI) of a setting; None if the setting is fixed to this value. Raises
        NotAvailable for a value that the rig cannot have.
        """
        setting, signal = self._settings[name], self._table[name]
        if setting.fixed is not None:
            if abs(value - setting.fixed) > 0.5 * signal.step:
                raise NotAvailable(
                    f"{self._rig} cannot set {name} = {signal.show(value)}: it is always "
                    f"{signal.show(setting.fixed)}; use that value"
                )
            return None
        number = setting.conversion.number(value)
        if math.isnan(number):
            raise NotAvailable(
                f"{self._rig} cannot set {name} = {signal.show(value)}: its wiring has no number for "
                "this choice; add it to choices"
            )
        return number

    def _present_numbers(self, names: Iterable[str]) -> dict[str, float]:
        """Return the points of settings with their present numbers, as far as they are known."""
        numbers = {}
        present = self._points.read(point for name in names for point in self.source(name))
        for name in names:
            setting = self._settings[name]
            numbers[setting.point] = setting.conversion.number(self.si(name, present))
        return {point: number for point, number in numbers.items() if not math.isnan(number)}

    def _acknowledged(self, name: str, value: float, clock: Clock | None) -> None:
        """Wait until the rig reports the new value of a setting. Raises Refused if it does not."""
        setting, signal = self._settings[name], self._table[name]
        if not setting.read or clock is None:
            return
        deadline = clock.now() + round(setting.within * NS)
        while True:
            number = self._points.read([setting.read])[setting.read]
            found = setting.conversion.si(number)
            if abs(found - value) <= setting.tolerance:
                return
            if clock.now() >= deadline:
                shown = (
                    f"{number:g}, which is not one of its choices"
                    if math.isnan(found)
                    else signal.show(found)
                )
                raise Refused(
                    f"{self._rig} did not acknowledge {name} = {signal.show(value)}: {setting.read} "
                    f"still reads {shown} after {setting.within:g} s; check its keys read and within",
                    DEVICE_FAILURE,
                )
            clock.sleep_until(min(deadline, clock.now() + LOOK))
