"""Motions under amplitude control, and their tables in the report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from bench_protocol.units import FACTORS, mm, mrad
from bench_records.curves import Axis, Curve, curve

TRACK: Final = "track"


class Driven(NamedTuple):
    """A wave, or an octave of a track, under amplitude control. Amplitudes are in m or rad; those of a track are rms
    values.
    """

    axis: str
    wave: str
    frequency: float
    target: float
    command: float
    reached: float
    repetitions: int
    phase: float | None = None  #: of the reached motion relative to the target (rad)

    @property
    def title(self) -> str:
        """The title of the group that its curves belong to."""
        of = f" of {self.target / mm:g} mm" if self.wave != TRACK else ", rms in octaves"
        return f"Amplitude control: {self.axis} {self.wave}{of}"


def drive_curves(driven: Iterable[Driven]) -> list[Curve]:
    """Return the tables of the report: commanded and reached amplitude and repetitions over frequency."""
    kinds: dict[str, dict[float, Driven]] = {}
    for one in driven:
        kinds.setdefault(one.title, {})[one.frequency] = one
    frequency, count, angle = (
        Axis("frequency", "Hz"),
        Axis("repetitions"),
        Axis("phase", "deg", FACTORS["deg"]),
    )
    found = []
    for group, by_frequency in kinds.items():
        waves = [one for _, one in sorted(by_frequency.items())]
        xs = [one.frequency for one in waves]
        unit = ("mrad", mrad) if waves[0].axis.endswith("roll") else ("mm", mm)
        length = Axis("amplitude", *unit)
        tables = [
            ("commanded", length, group, [one.command for one in waves]),
            ("reached", length, group, [one.reached for one in waves]),
            ("repetitions", count, f"{group}, repetitions", [float(one.repetitions) for one in waves]),
        ]
        if waves[0].wave == TRACK:
            tables.insert(0, ("wanted", length, group, [one.target for one in waves]))
            phases = [one.phase or 0.0 for one in waves]
            tables.append(("phase", angle, f"{group}, phase", phases))
        found += [curve(name, frequency, y, xs, values, group=place) for name, y, place, values in tables]
    return found
