"""The paper's lateral model in closed form, which never feeds the rig.

The paper (doi 10.1177/1687814020930457) fits its formulas to measurements; the plant in `bench_sim.model` follows from
mass, energy and virtual work instead. The numbers in brackets are the paper's equations where its text fixes them, and
their place in that order where it does not. Every function broadcasts over arrays; values are SI, ``p`` is absolute.
"""

from astb_studies.paper.closed_form.coupling import coupling_stiffness
from astb_studies.paper.closed_form.diaphragm import (
    diaphragm_stiffness,
    equivalent_volume,
    lateral_area,
    pressure_gradient,
)
from astb_studies.paper.closed_form.dynamic_stiffness import (
    damping_of,
    dynamic_stiffness,
    gas_stiffness,
    surge_frequencies,
)
from astb_studies.paper.closed_form.emergency_spring import combined, layered_stiffness
from astb_studies.paper.closed_form.finite_amplitude import (
    amplitude_damping,
    amplitude_time_constant,
    peak_angular_frequency,
)
from astb_studies.paper.closed_form.orifice_damping import (
    critical_ratio,
    flow_resistance,
    mass_flow,
    nozzle_function,
    nozzle_slope,
    orifice_damping,
    peak_damping,
    peak_ratio,
    stiffness_step,
    time_constant,
)
from astb_studies.paper.closed_form.parameters import PaperParameters, Topology
from astb_studies.paper.closed_form.torsion import roll_factor
from astb_studies.paper.closed_form.track import angular_frequency, unilateral_cosine

__all__ = [
    "PaperParameters",
    "Topology",
    "amplitude_damping",
    "amplitude_time_constant",
    "angular_frequency",
    "combined",
    "coupling_stiffness",
    "critical_ratio",
    "damping_of",
    "diaphragm_stiffness",
    "dynamic_stiffness",
    "equivalent_volume",
    "flow_resistance",
    "gas_stiffness",
    "lateral_area",
    "layered_stiffness",
    "mass_flow",
    "nozzle_function",
    "nozzle_slope",
    "orifice_damping",
    "peak_angular_frequency",
    "peak_damping",
    "peak_ratio",
    "pressure_gradient",
    "roll_factor",
    "stiffness_step",
    "surge_frequencies",
    "time_constant",
    "unilateral_cosine",
]
