"""The bench with springs of which only the drawing is known: parameters to identify, and their wide priors.

A diagnosis fits only those parameters that differ between good springs of one delivery, by a hundredth or a tenth. An
identification starts from an unknown spring: the priors are as wide as the spread of similar drawings, and friction,
emergency spring, heat and the stiffness in roll are identified too. All other values come from the parameter set: the
relaxation of the shell's stiffness, the contact of the emergency spring, the dimensions of the rig.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, Nuisance
from diagnosis.systems.air_spring.parameters import BOTH_SIDES, EACH_SIDE, tolerance
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring


@dataclass(frozen=True, slots=True)
class Asked:
    """One quantity of the springs to identify: its name, and the relative standard deviation of its prior.

    ``each``: load cells and pressures determine it separately for each side. Otherwise both springs share one value.
    """

    title: str
    spread: float
    each: bool


#: By the name of the parameter, in the order in which they are reported.
ASKED: Final[Mapping[str, Asked]] = MappingProxyType(
    {
        "effective_area": Asked("effective area at design height", 0.05, True),
        "effective_area_slope": Asked("slope of the effective area over the height", 0.5, True),
        "bellows_volume": Asked("volume of the bellows at design height", 0.1, True),
        "auxiliary_volume": Asked("auxiliary volume", 0.1, True),
        "membrane_length": Asked("decrease of volume with lateral displacement, κ₀", 0.3, False),
        "membrane_length_slope": Asked("decrease of area with lateral displacement, κ₁", 0.3, False),
        "membrane_travel": Asked("travel over which these two decreases soften", 0.3, False),
        "discharge_coefficient": Asked("discharge coefficient of the orifice", 0.15, True),
        "bellows_heat_transfer": Asked("heat from the bellows' air to its wall", 0.3, True),
        "auxiliary_heat_transfer": Asked("heat from the auxiliary chamber's air to its wall", 0.3, True),
        "shell_stiffness_vertical": Asked("stiffness of the shell, vertical", 0.3, True),
        "shell_stiffness_lateral": Asked("stiffness of the shell, lateral", 0.3, False),
        "friction_vertical": Asked("friction, vertical", 0.3, True),
        "friction_vertical_travel": Asked("displacement to half the friction, vertical", 0.3, False),
        "friction_lateral": Asked("friction, lateral, without pressure", 0.3, False),
        "friction_lateral_slope": Asked("friction, lateral, increase with pressure", 0.3, False),
        "friction_lateral_travel": Asked("displacement to half the friction, lateral", 0.3, False),
        "emergency_stiffness_vertical": Asked("stiffness of the emergency spring, vertical", 0.3, True),
        "emergency_stiffness_lateral": Asked("stiffness of the emergency spring, lateral", 0.3, False),
        "torsional_stiffness": Asked("stiffness in roll without pressure, K_φ0", 0.3, False),
        "torsional_stiffness_slope": Asked("stiffness in roll, increase with pressure, K_φp", 0.3, False),
    }
)
#: Relative steps of finite differences: a tenth of the prior standard deviation.
_STEPS: Final = {name: 0.1 * share for name, share in {**EACH_SIDE, **BOTH_SIDES}.items()}
_OTHER_STEP: Final = 0.03
_TOLERANCES: Final = frozenset({*EACH_SIDE, *BOTH_SIDES})


class UnknownSpring(AirSpring):
    """The bench with springs to be identified. Effects of the parameter set stay in the model; no other effects are
    tested.
    """

    def __init__(self, parameters: Parameters, only: tuple[str, ...] = tuple(OUTPUTS)) -> None:
        super().__init__(parameters, effects={}, only=only)
        kept = (one for one in self.nuisances if one.name.rpartition(".")[2] not in _TOLERANCES)
        self.nuisances: tuple[Nuisance, ...] = (*kept, *unknowns(parameters))


def unknowns(parameters: Parameters) -> tuple[Nuisance, ...]:
    """Return the parameters to identify, around the values of a parameter set."""
    return tuple(
        tolerance(parameters, name, label, place, asked.spread, _STEPS.get(name, _OTHER_STEP))
        for name, asked in ASKED.items()
        for label, place in ((("left." + name, 0), ("right." + name, 1)) if asked.each else ((name, 0),))
    )


#: Parameters of the shape of a bellows, in the order of `shape`: of its side, then of both.
_OWN: Final = ("effective_area", "effective_area_slope", "bellows_volume")
_SHARED: Final = ("membrane_length", "membrane_length_slope", "membrane_travel")


def names_of_shape(side: str) -> tuple[str, ...]:
    """Return the names of the parameters that determine area and volume of one bellows, in the order of `shape`."""
    return (*(f"{side}.{name}" for name in _OWN), *_SHARED)


def shape(values: Array, height: float, shear: float) -> Array:
    """Return effective area (m²) and volume (m³) of a bellows as an array (2,), for a height and a lateral displacement
    in m.

    A = A₀ + A₁ζ − ½κ₁Y, V = V₀ + (A₀ + ½A₁ζ)ζ − ½(κ₀ + κ₁ζ)Y, Y = y²/(1 + (y/y_s)²), as in `bench_sim.model.spring`.
    """
    area, slope, volume, length, length_slope, travel = values
    reach = shear**2 / (1.0 + (shear / travel) ** 2)
    return np.array(
        [
            area + slope * height - 0.5 * length_slope * reach,
            volume + (area + 0.5 * slope * height) * height - 0.5 * (length + length_slope * height) * reach,
        ]
    )


def uncertain_shape(values: Array, covariance: Array, height: float, shear: float) -> tuple[Array, Array]:
    """Return area and volume (2,) and their standard deviations (2,); ``covariance`` (6, 6) is that of ``values``."""
    steps = 1e-3 * np.abs(values) + 1e-6
    slopes = np.column_stack(
        [
            (shape(values + step, height, shear) - shape(values - step, height, shear)) / (2.0 * step.sum())
            for step in np.diag(steps)
        ]
    )
    variances = np.einsum("ik,kl,il->i", slopes, covariance, slopes)
    return shape(values, height, shear), np.sqrt(np.maximum(variances, 0.0))


def quantity(label: str) -> str:
    """Return the name of the parameter in a label such as ``left.effective_area``."""
    return label.rpartition(".")[2]
