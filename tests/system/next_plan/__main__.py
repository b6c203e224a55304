"""``python -m tests.system.next_plan``: go over the whole matrix, and write its page."""

import json
import sys
from collections import Counter, defaultdict
from dataclasses import asdict
from pathlib import Path

from test_plans.discovery import plans
from tests.system.next_plan.losses import LOSSES
from tests.system.next_plan.matrix import Cell, beginnings, cause_of, cells
from tests.system.next_plan.stand import DELAYS

KEPT = Path("runs") / "next_plan.json"
PAGE = Path(__file__).parents[3] / "docs" / "reference" / "next-plan.md"
HEAD = """<!-- Written by `python -m tests.system.next_plan`; do not edit. -->

# The next plan

What a plan meets after a commander, a wire or the bench itself was lost under the one before. A first plan runs into
each loss, at an instant that is drawn; when it is over, or its process gone, the next one begins: at once, 5 s and 30
s later, with another preload. It is followed through its preconditions and its set-up until its main part begins:
there the bench carries what it shall carry. Plans that begin alike, with the same preconditions and the same set-up,
are tried once: {tried} of {all}. All of it in virtual time, on a rig that is put back before each. `make test-slow`
repeats a part, drawn by a seed.

A plan *runs*, or it is *blocked*. Then its reason is checked against the rig itself: that what it names as the cause
is so, that somebody is told what to do, and that no word on air and state contradicts the springs and the valves.
{cells} cells, {wrong} with a reason that is not true.

| lost | at once | 5 s later | 30 s later |
|---|---|---|---|
"""


def main(names: list[str]) -> int:
    """Go over all, or those losses and plans that are named; what was found before of others stays."""
    every = beginnings()
    given = set(names)
    wanted = [first for first, alike in every.items() if not given & set(plans()) or given & set(alike)]
    losses = [loss for loss in LOSSES if loss.name in given] or list(LOSSES)
    for loss in losses:
        found = [cell for cell in read() if cell.loss != loss.name or cell.plan not in wanted]
        some = list(cells(loss, wanted))
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps([asdict(cell) for cell in found + some]))
        ran = sum(not cell.reason for cell in some)
        print(
            f"{loss.name}: {ran} run of {len(some)}, {sum(bool(cell.wrong) for cell in some)} wrong",
            flush=True,
        )
        for cell in some:
            if cell.wrong:
                print(f"    {cell.plan} {cell.delay:g} s: {cell.wrong}: {cell.reason}", flush=True)
    found = read()
    PAGE.write_text(page(found, every))
    return any(cell.wrong for cell in found)


def read() -> list[Cell]:
    """Return what was found so far, in the order of the losses."""
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else []
    order = [loss.name for loss in LOSSES]
    found = [Cell(**one | {"wrong": tuple(one["wrong"])}) for one in kept if one["loss"] in order]
    return sorted(found, key=lambda cell: order.index(cell.loss))


def page(found: list[Cell], every: dict[str, list[str]]) -> str:
    """Return the page of the whole matrix."""
    head = HEAD.format(
        tried=len({cell.plan for cell in found}),
        all=sum(len(every[name]) for name in {cell.plan for cell in found}),
        cells=len(found),
        wrong=sum(bool(cell.wrong) for cell in found),
    )
    rows: dict[str, dict[float, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in found:
        rows[cell.loss][cell.delay].append(cell)
    lines = [f"| {one.name} | not gone over yet | | |" for one in LOSSES if one.name not in rows]
    lines[:0] = [
        f"| {loss} | {' | '.join(_told(of[delay]) for delay in DELAYS)} |" for loss, of in rows.items()
    ]
    tried = {cell.plan for cell in found}
    alike = [
        f"* {', '.join(f'`{name}`' for name in names)}{'' if first in tried else ' (not gone over yet)'}"
        for first, names in every.items()
    ]
    return head + "\n".join([*lines, "", "Plans that begin alike:", "", *alike, ""])


def _told(some: list[Cell]) -> str:
    blocked = Counter(cause_of(cell.reason) or "wrong" for cell in some if cell.reason)
    if not blocked:
        return "all run"
    told = "; ".join(
        f"{count if count < len(some) else 'all'} blocked: {cause}" for cause, count in blocked.items()
    )
    return told if sum(blocked.values()) == len(some) else f"{len(some) - sum(blocked.values())} run, {told}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
