"""Causes that are laws of a phenomenon: how many were named exactly, as the phenomenon, wrongly, or not at all."""

from collections.abc import Sequence
from typing import Final

from astb_studies.benchmarks.diagnosis.judge import CLEAR, Judged

_HEAD: Final = """\
| hidden, λ ≥ 10 | n | exactly | its phenomenon | another law, plainly | another cause | not named |
|---|---|---|---|---|---|---|"""


def outcome(judged: Judged) -> str:
    """Return the column of a case in which one effect was hidden."""
    if judged.exact:
        return "exactly"
    if judged.wrong:
        return "another cause"
    if judged.in_family:
        return "its phenomenon"
    if judged.wrong_law:
        return "another law"
    return "not named"


def law_table(judged: Sequence[Judged]) -> list[str]:
    """Return the lines of the table, for single effects and near misses with similar effects."""
    clear = [j for j in judged if len(j.hidden) == 1 and j.near and j.weakest >= CLEAR]
    rows = {}
    for name in sorted({_bare(j.hidden[0]) for j in clear}):
        mine = [outcome(j) for j in clear if _bare(j.hidden[0]) == name]
        columns = ("exactly", "its phenomenon", "another law", "another cause", "not named")
        rows[name] = f"| {name} | {len(mine)} | {' | '.join(str(mine.count(one)) for one in columns)} |"
    return [*_HEAD.splitlines(), *rows.values()] if rows else []


def _bare(name: str) -> str:
    return name.partition(".")[0]
