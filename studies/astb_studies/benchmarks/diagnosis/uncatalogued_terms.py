"""Terms outside the catalogue: a bench may have them, but no named effect describes them."""

from collections.abc import Callable, Mapping
from math import asinh
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.layout import SURFACE

Array = NDArray[np.float64]

#: The spans over which the surfaces act: height of a spring (m), its speed (m/s), pressures (Pa, absolute).
HEIGHT: Final = (-0.03, 0.03)
SPEED: Final = (-0.3, 0.3)
UNIT_SPEED: Final = 0.01
DIFFERENCE: Final = (-0.2e5, 0.2e5)
PRESSURE: Final = (1e5, 8e5)


def _force(shape: Callable[[Any, Any], Any]) -> dict[str, Any]:
    """Extra force over height and speed; coefficients are its values at the middles of the splines."""
    heights = _centres(*HEIGHT, SURFACE[0])
    speeds = UNIT_SPEED * np.sinh(_centres(*(asinh(v / UNIT_SPEED) for v in SPEED), SURFACE[1]))
    return {
        "force_surface": shape(heights[:, None], speeds[None, :]) * np.ones(SURFACE),
        "force_surface_displacement": HEIGHT,
        "force_surface_speed": SPEED,
        "force_surface_unit_speed": UNIT_SPEED,
    }


def _flow(shape: Callable[[Any, Any], Any]) -> dict[str, Any]:
    """Extra flow from bellows to reservoir over pressure difference and pressure."""
    differences = _centres(*DIFFERENCE, SURFACE[0])
    pressures = _centres(*PRESSURE, SURFACE[1])
    return {
        "flow_surface": shape(differences[:, None], pressures[None, :]) * np.ones(SURFACE),
        "flow_surface_difference": DIFFERENCE,
        "flow_surface_pressure": PRESSURE,
    }


def _centres(low: float, high: float, count: int) -> Array:
    """Return the centres of quadratic splines on uniform knots."""
    cells = count - 2
    return low + (high - low) * (np.arange(count) - 0.5) / cells


def snag(size: float) -> dict[str, Any]:
    """A bead that snags: ``size`` N within some millimetres above design height, and 0 elsewhere."""
    return _force(lambda x, v: size * np.exp(-(((x - 0.008) / 0.006) ** 2)))


def one_way(size: float) -> dict[str, Any]:
    """A flap that damps one direction only: ``size`` N per 0.1 m/s upwards."""
    return _force(lambda x, v: -size * np.maximum(v, 0.0) / 0.1)


def buckle(size: float) -> dict[str, Any]:
    """A bellows that buckles under compression: F ∝ z² below design height, 0 above."""
    return _force(lambda x, v: -size * (np.minimum(x, 0.0) / 0.01) ** 2)


def flap(size: float) -> dict[str, Any]:
    """A loose flap before the orifice: ``size`` kg/s more at 0.1 bar and 3 bar, towards the reservoir only."""
    return _flow(lambda d, p: size * np.maximum(d, 0.0) / 1e4 * (3e5 / p) ** 2)


#: Parameter changes of a unit of each term, by name; all are linear in their size.
UNCATALOGUED: Final[Mapping[str, Callable[[float], dict[str, Any]]]] = {
    "snag": snag,
    "one_way": one_way,
    "buckle": buckle,
    "flap": flap,
}


def roughness(seed: int, size: float) -> dict[str, Any]:
    """A smooth random force over height and speed, and a smooth random flow over pressures; linear in ``size``."""
    rng = np.random.default_rng([seed, 77])
    force = rng.standard_normal(SURFACE)
    flow = rng.standard_normal(SURFACE)
    return {
        **_force(lambda x, v: size * force),
        **_flow(lambda d, p: 1e-6 * size * flow),
    }


def together(*changes: Mapping[str, Any]) -> dict[str, Any]:
    """Terms side by side: coefficients add up."""
    found: dict[str, Any] = {}
    for change in changes:
        for name, value in change.items():
            adds = name in found and name in {"force_surface", "flow_surface"}
            found[name] = found[name] + value if adds else value
    return found
