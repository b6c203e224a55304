"""Parameters of the paper's formulas: each is a value or an array of any shape, in the SI unit next to it."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

#: A number or an array; the arguments of a function broadcast against each other.
Real = float | NDArray[np.float64]
Complex = complex | NDArray[np.complexfloating[Any, Any]]

#: How diaphragm and emergency spring stand: parallel in the paper; a stack carries the same force, it is in series.
Topology = Literal["series", "parallel"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaperParameters:
    """One spring as the paper describes it, under one load; read by `astb_studies.paper.parameters.load_paper`."""

    gas_constant: Annotated[Real, "J/(kg*K)"]
    heat_capacity_ratio: Annotated[Real, "1"]
    polytropic_exponent: Annotated[Real, "1"]
    atmospheric_pressure: Annotated[Real, "Pa"]
    gas_temperature: Annotated[Real, "K"]

    nominal_preload: Annotated[Real, "N"]
    effective_area: Annotated[Real, "m2"]
    bellows_volume: Annotated[Real, "m3"]
    auxiliary_volume: Annotated[Real, "m3"]
    lateral_area: Annotated[Real, "m2"]
    lateral_area_decay: Annotated[Real, "1/m2"]
    volume_growth: Annotated[Real, "1/m2"]

    column_height: Annotated[Real, "m"]
    roll_hardening: Annotated[Real, "1"]
    roll_scale: Annotated[Real, "rad"]

    rubber_shear_modulus: Annotated[Real, "Pa"]
    rubber_area: Annotated[Real, "m2"]
    rubber_layers: Annotated[Real, "1"]
    rubber_layer_thickness: Annotated[Real, "m"]
    rubber_damping: Annotated[Real, "N*s/m"]

    orifice_diameter: Annotated[Real, "m"]
    discharge_coefficient: Annotated[Real, "1"]
    pressure_ratio: Annotated[Real, "1"]
    laminar_limit: Annotated[Real, "1"]
    pipe_length: Annotated[Real, "m"]
    pipe_diameter: Annotated[Real, "m"]

    @property
    def pressure(self) -> Real:
        """p = p_a + P/A_e in Pa absolute: the pressure that carries the load (derived)."""
        return self.atmospheric_pressure + self.nominal_preload / self.effective_area

    @property
    def bellows_capacity(self) -> Real:
        """C_b = V_b/(n R T) in kg/Pa: mass that raises the pressure of the bellows by 1 Pa (derived)."""
        return self.bellows_volume / self._gas_energy

    @property
    def auxiliary_capacity(self) -> Real:
        """C_a = V_a/(n R T) in kg/Pa (derived)."""
        return self.auxiliary_volume / self._gas_energy

    @property
    def series_capacity(self) -> Real:
        """C_a C_b/(C_a + C_b) in kg/Pa (derived)."""
        return (
            self.auxiliary_capacity
            * self.bellows_capacity
            / (self.auxiliary_capacity + self.bellows_capacity)
        )

    @property
    def pipe_inertance(self) -> Real:
        """L_p/A_p in 1/m: Pa per kg/s² (derived)."""
        return self.pipe_length / (0.25 * pi * self.pipe_diameter**2)

    @property
    def _gas_energy(self) -> Real:
        """n R T in J/kg."""
        return self.polytropic_exponent * self.gas_constant * self.gas_temperature
