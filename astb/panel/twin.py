"""Results of the models that ran next to runs: the view *Twin*, for the present run and for finished ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins
from starlette.requests import Request
from starlette.routing import Route

from astb.panel.answers import answered
from astb.panel.signals import shown
from bench_protocol.table import TABLE
from bench_records.index import RunIndex
from bench_records.layout import RecordError
from bench_records.twin import PARTS, TWIN, Deviation, LastMinute, read_twin

if TYPE_CHECKING:
    from pathlib import Path

    from astb.panel.answers import Parts


def routes(parts: Parts) -> Sequence[Route]:
    """Return the route of the view: the comparison of a run with its model (twin), by default of the newest run that
    has one.
    """
    return [Route("/api/twin", answered(lambda request: twin_runs(parts.out, request)))]


def twin_runs(out: Path, request: Request) -> dict[str, Any]:
    """Return the runs that have a twin, the newest first, and the findings of the requested run.

    Raises RecordError if this run has no twin.
    """
    runs = (
        [one.directory for one in reversed(RunIndex(out).runs()) if (out / one.directory / TWIN).exists()]
        if out.is_dir()
        else []
    )
    run = request.query_params.get("run") or (runs[0] if runs else "")
    if not run:
        return {"runs": [], "run": "", "story": None}
    if run not in runs:
        raise RecordError(f"{out} holds no run {run} with results of a twin; reload the page")
    story = read_twin(out / run)
    assert story is not None
    return {
        "runs": runs,
        "run": run,
        "story": to_builtins(story)
        | {
            "partings": [_deviation_row(one) for one in story.all_deviations],
            "parts": PARTS,
            "judged_for": story.judged_for,
            "lately": _read(story.last_minute) if story.last_minute else None,
        },
    }


def _read(minute: LastMinute) -> dict[str, Any]:
    """Return the last minute with its values in display units, with the decimals of their signals."""
    channels = []
    for one in minute.channels:
        signal = shown(TABLE[one.channel])
        zeros = {"measured": signal.zero, "expected": signal.zero, "band": 0.0}
        values = {
            name: [None if value is None else (value - zero) / signal.factor for value in getattr(one, name)]
            for name, zero in zeros.items()
        }
        about = {name: getattr(signal, name) for name in ("name", "label", "unit", "decimals")}
        channels.append(about | values)
    return {"times": minute.times, "channels": channels}


def _deviation_row(deviation: Deviation) -> dict[str, Any]:
    """Return a deviation with its values in their display units."""
    signal = shown(TABLE[deviation.channel])
    values = {
        "measured": signal.of(deviation.measured),
        "expected": signal.of(deviation.expected),
        "band": deviation.band / signal.factor,
    }
    return to_builtins(deviation) | values | {"unit": signal.unit, "lasts": deviation.lasts}
