"""The matrix: every loss before every way in which a plan of the catalogue begins, at once, 5 s and 30 s later."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from test_plans.discovery import plans
from test_plans.plan import Plan
from tests.system.next_plan.losses import Loss
from tests.system.next_plan.stand import DELAYS, Stand
from tests.system.next_plan.truth import CAUSES, untruths


@dataclass(frozen=True)
class Cell:
    """What one plan met after one loss: it ran, or was blocked for a reason; and what of that is not so."""

    loss: str
    delay: float
    plan: str
    reason: str = ""
    wrong: tuple[str, ...] = ()


def beginnings() -> dict[str, list[str]]:
    """Return the plans that begin alike, with the same preconditions and the same set-up, by the first of them."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, plan in plans().items():
        alike.setdefault(_beginning(plan), []).append(name)
    return {names[0]: names for names in alike.values()}


def _beginning(plan: Plan) -> tuple[str, ...]:
    closure = getattr(plan.setup, "__closure__", None) or ()
    return (
        f"{plan.setup.__module__}.{plan.setup.__qualname__}",
        str(plan.values.get("load", "")),
        *(str(cell.cell_contents) for cell in closure),
        *(one.text for one in plan.requires),
    )


def other_than(name: str) -> str:
    """Return a plan with another preload than ``name`` begins with."""
    return "aw0" if any("AW3" in part for part in _beginning(plans()[name])) else "aw3"


def cells(loss: Loss, names: list[str], delays: tuple[float, ...] = DELAYS, seed: int = 1) -> Iterator[Cell]:
    """Yield what each plan meets after ``loss``; a plan that may run and did not is wrong, whatever it says."""
    for first in ("aw0", "aw3"):
        nexts = [name for name in names if other_than(name) == first]
        if not nexts:
            continue
        stand = Stand(loss, first, seed)
        for delay in delays:
            stand.wait(delay)
            for name in nexts:
                reason = stand.next(name)
                wrong = list(untruths(reason, stand.rig)) if reason else []
                if reason and delay == DELAYS[-1] and not loss.stays:
                    wrong.append("nothing is lost any more")
                yield Cell(loss.name, delay, name, reason, tuple(wrong))


def cause_of(reason: str) -> str:
    """Return what a reason names as its cause, in a few words."""
    return next((words for pattern, _, _, words in CAUSES if re.search(pattern, reason)), "")
