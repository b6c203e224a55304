"""Effects of missing signals or dimensions: plans that cannot run, and checks of the plans aw0 and aw3 that are
impossible.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from astb.acceptance.checking.report import Missing
from bench_protocol.words import SIDES
from test_plans.discovery import plans
from test_plans.steps import carrying
from test_plans.steps.shaking import LATERAL_NEEDS, vertical_needs


def plans_by_need() -> dict[str, set[str]]:
    """Return, for each signal or dimension, the names of the plans that cannot start without it."""
    found: dict[str, set[str]] = {}
    for name, plan in plans().items():
        for need in plan.needs:
            found.setdefault(need, set()).add(name)
    return found


def missing(absent: Iterable[str]) -> list[Missing]:
    """Return the names in ``absent`` that plans need, each once.

    Names that block the same plans form one group; the group that blocks the most plans comes first.
    """
    needed, groups = plans_by_need(), dict[tuple[str, ...], list[str]]()
    for name in dict.fromkeys(absent):
        if blocked := needed.get(name):
            groups.setdefault(tuple(sorted(blocked)), []).append(name)
    ordered = sorted(groups.items(), key=lambda one: -len(one[0]))
    return [Missing(names=names, plans=list(blocked)) for blocked, names in ordered]


def checks_without(absent: Mapping[str, str]) -> dict[str, str]:
    """Return the checks of the plans aw0 and aw3 that are impossible without the signals ``absent``, each with the
    names of these signals.
    """
    needs = {
        "standing without being held sideways": carrying.FREE_SIDEWAYS,
        **{f"{side} vertical stiffness": vertical_needs({}, side) for side in SIDES},
        "lateral stiffness": LATERAL_NEEDS,
    }
    found = {what: _lacking(names, absent) for what, names in needs.items()}
    return {what: lacking for what, lacking in found.items() if lacking}


def _lacking(names: Iterable[str], absent: Mapping[str, str]) -> str:
    return ", ".join(dict.fromkeys(name for name in names if name in absent))
