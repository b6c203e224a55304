"""What the bench recorded for the identification, out of the curves of results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import tau
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from astb_studies.paper.identification.fits import Floats, NotIdentified
from astb_studies.paper.sweeps.pressure import AMPLITUDES, SLOW
from bench_protocol.units import mm
from test_plans.loads import Load
from test_plans.steps.tables import DAMPING, STORAGE

if TYPE_CHECKING:
    from bench_records.curves import Curve


@dataclass(frozen=True, slots=True)
class Isolated:
    """What was read of one spring shut off from its auxiliary chamber, step by step (SI), under one load."""

    preload: float
    height: Floats
    shear: Floats
    pressure: Floats  #: gauge
    temperature: Floats
    vertical: Floats
    lateral: Floats
    sheared: npt.NDArray[np.bool_]  #: steps to the side; the others are steps of height


def isolated(curves: Iterable[Curve], load: Load) -> Isolated:
    """Return the steps of plan ``lateral_offset`` under ``load``; NotIdentified if the curves do not hold them."""
    kept = list(curves)

    def both(quantity: str) -> Floats:
        parts = [
            _ys(kept, f"Isolated bellows {what}: {quantity}", load.name) for what in ("sheared", "lifted")
        ]
        return np.concatenate(parts)

    sheared = _ys(kept, "Isolated bellows sheared: height", load.name).size
    height = both("height")
    return Isolated(
        load.preload,
        height,
        both("lateral displacement"),
        both("pressure"),
        both("temperature"),
        both("vertical force"),
        both("lateral force"),
        np.arange(height.size) < sheared,
    )


@dataclass(frozen=True, slots=True)
class Sheared:
    """First harmonics of the lateral stiffness per spring: pressure (Pa gauge), amplitude (m), K (N/m), complex."""

    pressure: Floats
    amplitude: Floats
    stiffness: npt.NDArray[np.complex128]


def sheared(curves: Iterable[Curve], load: Load) -> Sheared:
    """Return what a plan ``lateral_pressure`` around ``load`` found; NotIdentified if the curves do not hold it."""
    kept = list(curves)
    pressure, amplitude, stiffness = [], [], []
    for size in AMPLITUDES:
        name = f"{size / mm:g} mm"
        group = f"Lateral {STORAGE[0]} per spring, {load.name}"
        storage = _ys(kept, group, name)
        damping = _ys(kept, f"Lateral {DAMPING[0]} per spring, {load.name}", name)
        pressure.append(_xs(kept, group, name))
        amplitude.append(_ys(kept, f"Lateral amplitude per spring, {load.name}", name))
        stiffness.append(storage + 1j * tau * SLOW * damping)
    return Sheared(np.concatenate(pressure), np.concatenate(amplitude), np.concatenate(stiffness))


def _curve(curves: Sequence[Curve], group: str, name: str) -> Curve:
    for one in curves:
        if (one.group, one.name) == (group, name):
            return one
    raise NotIdentified(f"there is no curve {name!r} of {group!r}: it comes from another plan")


def _xs(curves: Sequence[Curve], group: str, name: str) -> Floats:
    return np.array(_curve(curves, group, name).xs, np.float64)


def _ys(curves: Sequence[Curve], group: str, name: str) -> Floats:
    return np.array(_curve(curves, group, name).ys, np.float64)
