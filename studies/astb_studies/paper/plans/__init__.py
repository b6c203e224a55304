"""The plans that only the paper's figures need; `astb` finds them by the entry point of this module."""

from astb_studies.paper.plans.damping_ratio import damping_ratio
from astb_studies.paper.plans.frequency_sweep import frequency_sweep_aw0, frequency_sweep_aw3
from astb_studies.paper.plans.lateral_offset import lateral_offset
from astb_studies.paper.plans.lateral_pressure import lateral_pressure_aw0, lateral_pressure_aw3
from astb_studies.paper.plans.ride import ride
from astb_studies.paper.plans.roll_angle import roll_angle_aw0, roll_angle_aw3

__all__ = [
    "damping_ratio",
    "frequency_sweep_aw0",
    "frequency_sweep_aw3",
    "lateral_offset",
    "lateral_pressure_aw0",
    "lateral_pressure_aw3",
    "ride",
    "roll_angle_aw0",
    "roll_angle_aw3",
]
