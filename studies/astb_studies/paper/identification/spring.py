"""Everything that is identified of a spring, from the curves of three plans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from astb_studies.paper.identification.area_and_volume import fit_area_and_volume
from astb_studies.paper.identification.curves import isolated, sheared
from astb_studies.paper.identification.fits import Fit
from astb_studies.paper.identification.lateral import fit_lateral_stiffness
from astb_studies.paper.identification.parameter_file import FittedValue, Known, fitted_values
from test_plans.loads import AW0, AW3
from test_plans.specimen import Specimen, ordinary

if TYPE_CHECKING:
    from bench_records.curves import Curve

FITTED: Final = ("effective_area", "bellows_volume", "membrane_length", "membrane_length_slope")
FITTED_LATERAL: Final = (
    "shell_stiffness_lateral",
    "friction_lateral",
    "friction_lateral_slope",
    "friction_lateral_travel",
)


@dataclass(frozen=True, slots=True)
class Identified:
    """Everything that was identified of a spring."""

    area_and_volume: Fit
    lateral: Fit

    @property
    def parameters(self) -> dict[str, FittedValue]:
        """The fitted parameters, named as in the parameter files; κ_0 is that of the volume, free of friction."""
        return fitted_values(self.area_and_volume, FITTED) | fitted_values(self.lateral, FITTED_LATERAL)


def identify(
    offset: Iterable[Curve],
    pressure_aw0: Iterable[Curve],
    pressure_aw3: Iterable[Curve],
    base: str,
    specimen: Specimen | None = None,
) -> Identified:
    """Identify a spring from the curves of ``lateral_offset`` and of both plans ``lateral_pressure``.

    ``base`` is the text of the parameter file to begin with; ``specimen`` the one that was measured (the bench's own).
    NotIdentified if something is missing.
    """
    known, kept = Known(base), list(offset)
    aw0, aw3 = ((specimen or ordinary()).load(name) for name in (AW0, AW3))
    return Identified(
        fit_area_and_volume([isolated(kept, load) for load in (aw0, aw3)], known),
        fit_lateral_stiffness([sheared(pressure_aw0, aw0), sheared(pressure_aw3, aw3)], known),
    )
