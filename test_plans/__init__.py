"""The test plans of the bench, by name."""

from typing import Final

from test_plans.aw0 import aw0
from test_plans.aw3 import aw3
from test_plans.leak_down import leak_down
from test_plans.plan import Plan

__all__ = ["PLANS"]

PLANS: Final[dict[str, Plan]] = {plan.name: plan for plan in (aw0, aw3, leak_down)}
