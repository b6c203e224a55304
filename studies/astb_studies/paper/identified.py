"""The parameters of the springs on the first rig, as `astb identify` finds them in a run of plan `identification`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from astb.diagnose import BENCH, read_data
from astb.identify import identify_springs, write_springs
from bench_protocol.arrays import Floats
from bench_protocol.words import SIDES
from bench_sim.parameters import load
from diagnosis.engine.identify import Identification
from diagnosis.estimates import Z95
from diagnosis.systems.air_spring.identified import ASKED, names_of_shape, quantity, shape
from diagnosis.systems.air_spring.simulator import AirSpring

#: The parameters of area and volume, in the order of `shape`.
SHAPE: Final = tuple(quantity(name) for name in names_of_shape("left"))
#: Step of finite differences, as a share of a value.
_STEP: Final = 1e-4


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A value (SI) with its confidence interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Identified:
    """The mean of both springs: every parameter by its name, and the zero of their pressure transducers (Pa).

    ``geometry`` (6,) and its ``covariance`` (6, 6) are those of its `SHAPE`.
    """

    parameters: dict[str, FittedValue]
    pressure_zero: float
    geometry: Floats
    covariance: Floats

    def changes(self, shear: Floats) -> tuple[Floats, Floats]:
        """Return the changes of area and volume from the centre (2, n) as shares, and the 95 % half width of each."""
        steps = np.diag(_STEP * np.abs(self.geometry))
        slopes = np.array(
            [
                (changes(self.geometry + step, shear) - changes(self.geometry - step, shear))
                / (2.0 * step.sum())
                for step in steps
            ]
        )
        variances = np.einsum("ijn,ik,kjn->jn", slopes, self.covariance, slopes)
        return changes(self.geometry, shear), Z95 * np.sqrt(variances)


def changes(geometry: Floats, shear: Floats) -> Floats:
    """Return the changes of area and volume (2, n) from the centre, as shares, of a bellows with such a `SHAPE`."""
    centre = shape(geometry, 0.0, 0.0)
    return np.array([shape(geometry, 0.0, float(y)) / centre - 1.0 for y in shear]).T


def identify_rig(record: Path, out: Path) -> Identified:
    """Identify the springs of a ``record`` and write their parameter file to ``out``."""
    parameters = load(BENCH)
    simulator, dataset = read_data([record], None, parameters)
    assert isinstance(simulator, AirSpring)  # a record of the bench is replayed by its model
    found, unknown = identify_springs(dataset, simulator, workers=1)
    write_springs(out, found, dataset, unknown.parameters, BENCH)
    return mean_of_sides(found)


def mean_of_sides(found: Identification) -> Identified:
    """Return the identified parameters of one spring: the mean of the two sides."""
    names = {one.parameter.name for one in found.parameters}

    def mean(*labels: str) -> FittedValue:
        values, covariance = found.joint(labels)
        width = Z95 * float(np.sqrt(covariance.mean()))
        value = float(values.mean())
        return FittedValue(value, value - width, value + width)

    def labels(name: str) -> tuple[str, ...]:
        return (name,) if name in names else tuple(f"{side}.{name}" for side in SIDES)

    left, right = (names_of_shape(side) for side in SIDES)
    together = tuple(dict.fromkeys((*left, *right)))
    # Each row takes half of what either side has; what both share is the same in both.
    rows = [[0.5 * ((one == a) + (one == b)) for one in together] for a, b in zip(left, right, strict=True)]
    values, covariance = found.joint(together)
    weights = np.array(rows)
    return Identified(
        {name: mean(*labels(name)) for name in ASKED},
        mean(*(f"{side}.bellows_pressure.offset" for side in SIDES)).value,
        weights @ values,
        weights @ covariance @ weights.T,
    )
