"""What the page of rates says of investigations: how often they ended in the right name, in how many minutes."""

import math
from collections.abc import Sequence
from statistics import median
from typing import Final

from benchmarks.diagnosis.investigated import FAINT, Investigated
from benchmarks.diagnosis.investigations import BUDGET, Figure, figures
from benchmarks.diagnosis.statistics import Rate

_INTRODUCTION: Final = f"""\
## Investigations

`astb investigate` gets a sealed rig and decides itself what is run, with the whole catalogue and {BUDGET} of the bench:
a screening first (the plan of that name, which takes a minute where the screening above takes twenty seconds), then
whatever separates the causes that are left. Near misses, and such of {100 * FAINT:.0f} % of their size, are half of the
rigs, since those are the ones that a screening alone leaves ambiguous. λ is that of the screening above.
"""


def section(all_: Sequence[Investigated]) -> list[str]:
    """Return the lines of the page; none where nothing was investigated."""
    if not all_:
        return []
    minutes = [one.minutes for one in all_ if not one.failure]
    further = [one.minutes for one in all_ if len(one.plans) > 1]
    lines = [_INTRODUCTION, "| figure | aim | measured | n | met |", "|---|---|---|---|---|"]
    lines += [_row(figure) for figure in figures(all_) if figure.hits]
    lines.append(f"| minutes of the bench (median) | | {median(minutes):.3g} | {len(minutes)} | |")
    if further:
        what = "the same where more than the screening was run"
        lines.append(f"| {what} | | {median(further):.3g} (at most {max(further):.3g}) | {len(further)} | |")
    lines += ["", "Every investigation that went further, or did not end in the right name:", ""]
    lines += [
        "| seed | kind | hidden (λ) | after the screening | runs | said in the end |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_told(one) for one in all_ if len(one.plans) > 1 or not one.right]
    return [*lines, ""]


def _row(figure: Figure) -> str:
    rate, limit = Rate.of(figure.hits), figure.aim
    aim = "" if math.isnan(limit) else f"{'≤' if limit < 0.5 else '≥'} {100 * limit:g} %"
    met = ("yes" if rate.meets(limit) else "**no**") if aim else ""
    return f"| {figure.what} | {aim} | {rate} | {rate.count} | {met} |"


def _told(one: Investigated) -> str:
    said = f"{one.verdict}: {', '.join(one.causes)}" if one.causes else one.verdict
    if one.rivals:
        said += f" or {', '.join(one.rivals)}"
    hidden = f"{', '.join(one.hidden)} ({one.weakest:.3g})" if one.hidden else "nothing"
    runs = ", ".join(one.plans)
    return f"| {one.seed} | {one.kind} | {hidden} | {one.first} | {runs} | {one.failure or said} |"
