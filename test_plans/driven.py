"""Waves under amplitude control, and their tables in the report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from bench_protocol.units import mm
from bench_records.curves import Axis, Curve, curve


class Driven(NamedTuple):
    """A wave under amplitude control; amplitudes in m."""

    axis: str
    wave: str
    frequency: float
    wanted: float
    command: float
    reached: float
    repetitions: int


def drive_curves(driven: Iterable[Driven]) -> list[Curve]:
    """Return the tables of the report: commanded and reached amplitude and repetitions over frequency."""
    kinds: dict[tuple[str, str, float], dict[float, Driven]] = {}
    for one in driven:
        kinds.setdefault((one.axis, one.wave, one.wanted), {})[one.frequency] = one
    frequency, length, count = Axis("frequency", "Hz"), Axis("amplitude", "mm", mm), Axis("repetitions", "")
    found = []
    for (axis, wave, wanted), by_frequency in kinds.items():
        waves = [one for _, one in sorted(by_frequency.items())]
        group = f"Amplitude control: {axis} {wave} of {wanted / mm:g} mm"
        for name, y, values in (
            ("commanded", length, [one.command for one in waves]),
            ("reached", length, [one.reached for one in waves]),
            ("repetitions", count, [float(one.repetitions) for one in waves]),
        ):
            xs = [one.frequency for one in waves]
            place = group if y is length else f"{group}, repetitions"
            found.append(curve(name, frequency, y, xs, values, group=place))
    return found
