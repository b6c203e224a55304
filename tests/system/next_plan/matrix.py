"""The matrix: losses before the ways in which plans of the catalogue begin, at once, 5 s and 30 s later."""

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from bench_protocol.clock import utc_date
from test_plans.discovery import plans
from test_plans.plan import Plan
from tests.system.next_plan.losses import LOSSES, Loss
from tests.system.next_plan.stand import DELAYS, WITHIN, FaultRig
from tests.system.next_plan.truth import CAUSES, untruths

SEED = 1
#: Plans before which everything is lost: they carry either load, fill the springs alone, or only arm the bench.
BEFORE_WHICH_ALL = ("aw0", "aw3", "leveling", "safety")


@dataclass(frozen=True)
class Cell:
    """The result of one plan after one loss: it ran, or was blocked for a reason; and the wrong parts of the reason."""

    loss: str
    delay: float
    plan: str
    reason: str = ""
    wrong: tuple[str, ...] = ()
    day: str = field(default_factory=lambda: utc_date()[:10])


def beginnings() -> dict[str, list[str]]:
    """Return the plans that begin alike, with the same preconditions and the same set-up, by the first of them."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, plan in plans().items():
        alike.setdefault(_beginning(plan), []).append(name)
    return {names[0]: names for names in alike.values()}


def asked(name: str) -> dict[Loss, tuple[float, ...]]:
    """Return the losses before the plan ``name``, and how long before: all, or one loss of each kind, drawn."""
    if name in BEFORE_WHICH_ALL:
        return dict.fromkeys(LOSSES, DELAYS)
    chance = random.Random(f"{name} {SEED}")
    kinds = dict.fromkeys(loss.of for loss in LOSSES)
    drawn = [chance.choice([loss for loss in LOSSES if loss.of == kind]) for kind in kinds]
    return {loss: (chance.choice(DELAYS),) for loss in drawn}


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


def cells(
    loss: Loss, before: dict[str, tuple[float, ...]], within: tuple[float, float] = WITHIN
) -> Iterator[Cell]:
    """Yield the results of the plans ``before`` after ``loss``, each delayed by the given s.

    A plan that may run and did not is wrong, whatever it says. ``within``: when in the first plan it is lost (s), from
    and to.
    """
    for first in ("aw0", "aw3"):
        nexts = {name: delays for name, delays in before.items() if other_than(name) == first}
        if not nexts:
            continue
        stand = FaultRig(loss, first, SEED, within)
        for delay in sorted({one for delays in nexts.values() for one in delays}):
            stand.wait(delay)
            for name in [name for name, delays in nexts.items() if delay in delays]:
                reason = stand.next(name)
                wrong = list(untruths(reason, stand.rig)) if reason else []
                if reason and delay == DELAYS[-1] and not loss.stays:
                    wrong.append("nothing is lost any more")
                yield Cell(loss.name, delay, name, reason, tuple(wrong))


def cause_of(reason: str) -> str:
    """Return what a reason names as its cause, in a few words."""
    return next((words for pattern, _, _, words in CAUSES if re.search(pattern, reason)), "")
