"""The plans that only the paper's figures need: `astb` knows them by the entry point of this module."""

from paper_study.plans.damping_ratio import damping_ratio
from paper_study.plans.frequency_sweep import frequency_sweep_aw0, frequency_sweep_aw3
from paper_study.plans.lateral_offset import lateral_offset
from paper_study.plans.lateral_pressure import lateral_pressure_aw0, lateral_pressure_aw3
from paper_study.plans.ride import ride
from paper_study.plans.roll_angle import roll_angle_aw0, roll_angle_aw3

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
