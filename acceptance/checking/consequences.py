"""What a rig cannot do for want of signals: plans that would not start, and what aw0 and aw3 could not measure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bench_protocol.words import SIDES
from test_plans.discovery import plans
from test_plans.steps import carrying
from test_plans.steps.shaking import LATERAL_NEEDS, vertical_needs


def plans_without(absent: Mapping[str, str]) -> dict[str, str]:
    """Return the plans that need one of the signals ``absent``, each with what it lacks."""
    found = {name: _lacking(plan.needs, absent) for name, plan in plans().items()}
    return {name: lacking for name, lacking in found.items() if lacking}


def checks_without(absent: Mapping[str, str]) -> dict[str, str]:
    """Return what aw0 and aw3 cannot measure without the signals ``absent``, each with what it lacks."""
    needs = {
        "standing without being held sideways": carrying.FREE_SIDEWAYS,
        **{f"{side} vertical stiffness": vertical_needs({}, side) for side in SIDES},
        "lateral stiffness": LATERAL_NEEDS,
    }
    found = {what: _lacking(names, absent) for what, names in needs.items()}
    return {what: lacking for what, lacking in found.items() if lacking}


def _lacking(names: Iterable[str], absent: Mapping[str, str]) -> str:
    return ", ".join(dict.fromkeys(name for name in names if name in absent))
