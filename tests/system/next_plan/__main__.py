"""``python -m tests.system.next_plan``: go over the whole matrix, and write its page."""

import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from time import process_time

from test_plans.discovery import plans
from tests.system.next_plan.losses import LOSSES
from tests.system.next_plan.matrix import (
    BEFORE_WHICH_ALL,
    Cell,
    asked,
    beginnings,
    cause_of,
    cells,
)
from tests.system.next_plan.stand import DELAYS

KEPT = Path("runs") / "next_plan.json"
PAGE = Path(__file__).parents[3] / "studies" / "docs" / "next-plan.md"
HEAD = """<!-- Written by `python -m tests.system.next_plan`; do not edit. -->

# Start of a plan after a loss in the previous one

This page shows whether a plan can start after the previous plan lost its commander, a wire or the bench. A first plan
has each loss at a random instant. The next plan starts when the first one ended: at once, 5 s and 30 s later, with
another preload. It is followed through its preconditions and its set-up, until its main part begins and the bench
carries the load. All runs are in virtual time, on a rig that is reset before each.

Plans with the same preconditions and the same set-up are tried once: the {all} plans of the catalogue start in {tried}
ways. For {whole} of these all {losses} losses were tried, at each of the three instants. For the other {part}, one loss
of each of the {kinds} kinds was tried at one instant, both random. The lists below the table show which.
`make test-slow` repeats a few at random.

A plan *runs*, or it is *blocked*. If it is blocked, its message is compared with the rig: the cause is true, it
has a remedy, and its statements about air, state and other commanders are true.
{cells} cells: {ran} run, {wrong} have a wrong message. Measured {days}{left}.

| kind | lost | at once | 5 s later | 30 s later |
|---|---|---|---|---|
"""


def main(names: list[str]) -> int:
    """Compute all, or the named losses and plans; earlier results of others stay."""
    every = beginnings()
    given = set(names)
    plans_wanted = [first for first, alike in every.items() if not given & set(plans()) or given & set(alike)]
    for loss in [loss for loss in LOSSES if loss.name in given] or list(LOSSES):
        before = {name: asked(name)[loss] for name in plans_wanted if loss in asked(name)}
        found = [cell for cell in read() if cell.loss != loss.name or cell.plan not in before]
        began = process_time()
        some = list(cells(loss, before))
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps([asdict(cell) for cell in found + some]))
        ran, wrong = sum(not cell.reason for cell in some), [cell for cell in some if cell.wrong]
        took = process_time() - began
        print(f"{loss.name}: {ran} run of {len(some)}, {len(wrong)} wrong, {took:.0f} s", flush=True)
        for cell in wrong:
            print(f"    {cell.plan} {cell.delay:g} s: {cell.wrong}: {cell.reason}", flush=True)
    wanted = tried_for(every)
    found = [cell for cell in read() if (cell.plan, cell.loss, cell.delay) in wanted]
    PAGE.write_text(page(found, every))
    return any(cell.wrong for cell in found)


def read() -> list[Cell]:
    """Return the results so far, also those that were not requested."""
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else []
    return [Cell(**one | {"wrong": tuple(one["wrong"])}) for one in kept]


def tried_for(every: Iterable[str]) -> set[tuple[str, str, float]]:
    """Return the requested cases: plan, loss and how much later, of the beginnings of ``every``."""
    return {(name, *one) for name in every for one in _instants(name)}


def _instants(name: str) -> list[tuple[str, float]]:
    return [(loss.name, delay) for loss, delays in asked(name).items() for delay in delays]


def page(found: list[Cell], every: dict[str, list[str]]) -> str:
    """Return the page of the whole matrix."""
    whole = [name for name in every if name in BEFORE_WHICH_ALL]
    left = len(tried_for(every)) - len(found)
    head = HEAD.format(
        tried=len(every),
        all=sum(map(len, every.values())),
        whole=len(whole),
        part=len(every) - len(whole),
        losses=len(LOSSES),
        kinds=len({loss.of for loss in LOSSES}),
        cells=len(found),
        ran=sum(not cell.reason for cell in found),
        wrong=sum(bool(cell.wrong) for cell in found),
        left=f";\n{left} cells not yet" if left else "",
        days=" and ".join(
            f"on {day}: {count}" for day, count in sorted(Counter(cell.day for cell in found).items())
        ),
    )
    rows: dict[str, dict[float, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in found:
        rows[cell.loss][cell.delay].append(cell)
    lines = []
    for loss in LOSSES:
        told = [_summary(rows[loss.name][delay]) for delay in DELAYS]
        lines.append(f"| {loss.of} | {loss.name} | {' | '.join(told)} |")
    tried = {(cell.plan, cell.loss, cell.delay) for cell in found}
    lines += ["", "Each loss before a plan that begins as", ""]
    lines += [f"* {_alike(every[name])}{_gaps(name, tried)}" for name in whole]
    lines += ["", "One loss of each kind before a plan that begins as", ""]
    for first in sorted(set(every) - set(whole)):
        drawn = "; ".join(f"{name}: {delay:g} s" for name, delay in _instants(first))
        lines.append(f"* {_alike(every[first])} ({drawn}){_gaps(first, tried)}")
    return head + "\n".join([*lines, ""])


def _alike(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _gaps(name: str, tried: set[tuple[str, str, float]]) -> str:
    """Report how many of the requested cases are missing."""
    gaps = sum((name, *one) not in tried for one in _instants(name))
    return f" (not gone over yet: {gaps} of these cells)" if gaps else ""


def _summary(some: list[Cell]) -> str:
    if not some:
        return "not gone over yet"
    blocked = Counter(cause_of(cell.reason) or "wrong" for cell in some if cell.reason)
    ran = len(some) - sum(blocked.values())
    told = [f"{ran} run"] if ran else []
    return "; ".join([*told, *(f"{count} blocked: {cause}" for cause, count in blocked.items())])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
