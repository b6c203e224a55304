"""Evaluates checks in several processes, and writes the results to ``claims.json``."""

import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from math import isfinite
from pathlib import Path
from typing import Any

from astb.campaigns.core import carried_out
from astb.campaigns.workers import cluster
from astb_studies.paper.checks.catalogue import CHECKS, select
from astb_studies.paper.claims import ClaimCheck
from astb_studies.paper.subject import Subject

#: Called with the number of entries that are ready and the number that there will be.
Progress = Callable[[int, int], None]


def evaluate_all(
    ids: Iterable[str] | None = None,
    quick: bool = False,
    workers: int = 2,
    progress: Progress | None = None,
    subject: Subject | None = None,
) -> list[dict[str, Any]]:
    """Return one entry per check and layer, in the order of `CHECKS`, whatever the number of processes.

    An entry has id, claim, layer, measured (text), criterion, holds, note and numbers (SI by name). ``quick`` takes
    cheaper variants of the long experiments. ``subject`` carries changed parameters; ``workers`` = 1 stays in this
    process. KeyError for an unknown id.
    """
    places = select(ids)
    changed = subject or Subject()
    parts = _groups(places)
    arguments = dict(changed.plant), dict(changed.paper), dict(changed.car), quick or changed.quick
    entries: dict[int, dict[str, Any]] = {}

    def ready(found: dict[int, dict[str, Any]]) -> None:
        entries.update(found)
        if progress is not None:
            progress(len(entries), len(places))

    if workers <= 1 or len(parts) == 1:
        for part in parts:
            ready(_evaluate(part, *arguments))
    else:
        jobs = {str(part): part for part in parts}
        with (
            cluster(workers=min(workers, len(parts))) as client,
            closing(carried_out(client, lambda part: _evaluate(part, *arguments), jobs)) as ended,
        ):
            for one in ended:
                if one.error:
                    raise RuntimeError(f"the checks {one.key} were not evaluated: {one.error}")
                ready(one.value)
    return [entries[place] for place in places]


def to_json(entries: Sequence[dict[str, Any]], path: Path) -> None:
    """Write entries of `evaluate_all` as a JSON array, one object per check and layer."""
    path.write_text(
        json.dumps(entries, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        encoding="utf-8",
        newline="\n",
    )


def _groups(places: Sequence[int]) -> list[list[int]]:
    """Group the checks that share experiments, so that one process measures them once; the longest come first."""
    groups: dict[str, list[int]] = {}
    for place in places:
        check = CHECKS[place]
        groups.setdefault(check.shares or f"{check.id} {check.layer}", []).append(place)
    return sorted(groups.values(), key=lambda part: CHECKS[part[0]].shares != "ride")


def _evaluate(
    places: Sequence[int], plant: dict[str, Any], paper: dict[str, Any], car: dict[str, Any], quick: bool
) -> dict[int, dict[str, Any]]:
    subject = Subject(plant, paper, car, quick)
    return {place: entry(CHECKS[place], subject) for place in places}


def entry(check: ClaimCheck, subject: Subject) -> dict[str, Any]:
    """Evaluate one check."""
    outcome = check.evaluate(subject)
    return {
        "id": check.id,
        "claim": check.claim.text,
        "layer": check.layer,
        "measured": outcome.text,
        "criterion": check.limits,
        "holds": bool(outcome.holds),
        "note": outcome.note,
        "numbers": {name: _finite(number) for name, number in outcome.numbers.items()},
    }


def _finite(number: float) -> float | None:
    """Return None for an infinite number, because JSON has no infinity."""
    return float(number) if isfinite(number) else None
