"""Vertical stiffness and damping at the frequencies of the checks, from motions of the springs with sines.

`aw0`, `aw3` and `dynamic_stiffness` measure them: K' and c of a sine of 5 mm at each frequency of the specimen's file.
"""

from collections.abc import Mapping
from math import ceil, tau
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from astb.menu import planned
from bench_protocol.units import kN, s
from bench_protocol.words import SIDES
from diagnosis.contracts import Array, Experiment, Figures
from drivers.errors import NotAvailable
from test_plans.analysis import VERTICAL_CELLS, NotMeasured, Stiffness, first_harmonic, harmonic
from test_plans.analysis.cells import upward_force
from test_plans.description import Description
from test_plans.programmes.motions import Stretch, Wave
from test_plans.specimen import Specimen, ordinary
from test_plans.steps.shaking import AMPLITUDE

#: A sine is measured for this time, at least for two cycles. It lasts as long before this, in addition to fading in.
MEASURED: Final = 1 * s
#: Permitted relative error of the amplitude, because the frame is compliant.
NEAR: Final = 0.1
#: Permitted share of other motion in a sine. A larger share means no sine, or one that fades in or out.
DISTORTED: Final = 0.02
#: A part is as good as the best one if its share of other motion is at most so many times as large, plus rounding.
AS_GOOD: Final = 1.1
ROUNDING: Final = 1e-5


class StiffnessChecks:
    """K' and c at the frequencies of a ``specimen`` under each of its loads, on a ``rig`` of these dimensions."""

    def __init__(self, rig: Description, specimen: Specimen | None = None) -> None:
        self._rig, self._specimen = rig, specimen or ordinary()
        self.experiments: tuple[Experiment, ...] = tuple(
            self._planned(name) for name in self._specimen.loads if self._frequencies(name)
        )

    def states(self, nuisance: str) -> bool:
        """Return whether ``nuisance`` is the offset of a sensor.

        Planned experiments are free of this error, because their initial state is not measured.
        """
        return nuisance.endswith(".offset")

    def figures(self, experiment: Experiment, outputs: Mapping[str, Array]) -> Figures:
        """Return K' (kN/m) and c (kN s/m) of each sine in an experiment, by name and unit, from the load cells in
        ``outputs``. Frequencies without a steady sine are missing.
        """
        load = self._load(experiment)
        try:
            force = 0.5 * upward_force(outputs, self._rig)
        except NotAvailable:
            return {}
        height = np.mean([experiment.inputs[f"{side}.height"] for side in SIDES], axis=0)
        closed = _shut(experiment)
        found: dict[tuple[str, str], float] = {}
        for frequency in self._frequencies(load):
            stretch = sine_in(np.where(closed, height, np.nan), experiment.step, frequency)
            if stretch is None:
                continue
            times = experiment.time[stretch]
            try:
                moved = -first_harmonic(times, height[stretch], frequency)
                carried = harmonic(self._rig, times, force[stretch], frequency, *VERTICAL_CELLS)
            except NotMeasured:  # samples are missing
                continue
            K = Stiffness(carried / moved, frequency, abs(moved))
            found[f"K' at {frequency:g} Hz, {load}", "kN/m"] = K.storage / kN
            found[f"c at {frequency:g} Hz, {load}", "kN*s/m"] = K.damping / kN
        return found

    def _frequencies(self, load: str) -> list[float]:
        one = self._specimen.loads.get(load)
        return [] if one is None else [frequency for frequency, _, _ in one.sweep("vertical")]

    def _load(self, experiment: Experiment) -> str:
        """Return the load case of an experiment, "" if the specimen has no such load."""
        carried = experiment.settings.get("nominal_preload", 0.0)
        loads = self._specimen.loads.items()
        return next((name for name, one in loads if abs(carried / one.preload - 1.0) < NEAR), "")

    def _planned(self, load: str) -> Experiment:
        waves = tuple(
            Wave("vertical", AMPLITUDE, frequency, 2 + 2 * _cycles(frequency))
            for frequency in self._frequencies(load)
        )
        return planned(f"sines {load}", self._specimen, self._rig, load, Stretch(waves, condition=()), 0.0)


def _cycles(frequency: float) -> int:
    return max(2, ceil(MEASURED * frequency))


def _shut(experiment: Experiment) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return a mask (n,) of the samples at which the leveling valves are shut and the auxiliary chambers are
    connected.
    """
    inputs, nothing = experiment.inputs, np.zeros(len(experiment.time))
    return np.all(
        [
            (inputs.get(f"{side}.leveling", nothing) == 0.0)
            & (inputs.get(f"{side}.reservoir", nothing + 1.0) == 1.0)
            for side in SIDES
        ],
        axis=0,
    )


def sine_in(motion: Array, step: float, frequency: float) -> slice | None:
    """Return the last part of ``motion`` (n,) that is a steady sine of `AMPLITUDE`; None if there is none.

    ``step`` is in s.
    """
    size = round(_cycles(frequency) / frequency / step)
    if len(motion) < size:
        return None
    places = np.arange(len(motion))
    turned = np.exp(-1j * tau * frequency * step * places)

    def mean(values: Array) -> Array:
        total = np.concatenate(([0.0], np.cumsum(np.where(np.isfinite(motion), values, 0.0))))
        return np.asarray((total[size:] - total[:-size]) / size)

    amplitude = 2.0 * np.abs(mean(motion * turned))
    rest = mean(motion**2) - mean(motion) ** 2 - 0.5 * amplitude**2
    whole = sliding_window_view(np.isfinite(motion), size).all(axis=1)
    good = whole & (np.abs(amplitude / AMPLITUDE - 1.0) < NEAR)
    other = np.where(good, np.sqrt(np.maximum(rest, 0.0) / (0.5 * AMPLITUDE**2)), np.inf)
    if other.min() > DISTORTED:
        return None
    first = int(np.flatnonzero(other <= AS_GOOD * other.min() + ROUNDING)[-1])
    return slice(first, first + size)
