"""The test plans of the bench, by name."""

from typing import Final

from test_plans.aw0 import aw0
from test_plans.aw3 import aw3
from test_plans.damping_ratio import damping_ratio
from test_plans.frequency_sweep_aw0 import frequency_sweep_aw0
from test_plans.frequency_sweep_aw3 import frequency_sweep_aw3
from test_plans.lateral_offset import lateral_offset
from test_plans.lateral_pressure_aw0 import lateral_pressure_aw0
from test_plans.lateral_pressure_aw3 import lateral_pressure_aw3
from test_plans.leak_down import leak_down
from test_plans.perform import programme_plan
from test_plans.plan import Plan
from test_plans.roll_angle_aw0 import roll_angle_aw0
from test_plans.roll_angle_aw3 import roll_angle_aw3
from test_plans.screening import SCREENING
from test_plans.separating import MENU

__all__ = ["PLANS"]

_ALL: Final = (
    aw0,
    aw3,
    leak_down,
    lateral_pressure_aw0,
    lateral_pressure_aw3,
    damping_ratio,
    lateral_offset,
    roll_angle_aw0,
    roll_angle_aw3,
    frequency_sweep_aw0,
    frequency_sweep_aw3,
    programme_plan(SCREENING),
    *(programme_plan(programme) for programme in MENU.values()),
)
PLANS: Final[dict[str, Plan]] = {plan.name: plan for plan in _ALL}
