"""The events of a run for its report: a table of events, and a text on the first limit that tripped."""

from __future__ import annotations

from typing import Any

from bench_records.layout import RecordedEvent
from bench_records.record import Record
from bench_records.run_drawings import TRIP, lines_by_quantity
from bench_records.typography import THIN_SPACE, fixed, plain

# Largest number of events on the page; the record has all of them.
EVENT_ROWS = 150
AROUND_TRIP_S = 10.0


def tabled_events(record: Record) -> list[RecordedEvent]:
    """Return the events for the table. Phases, checks and settings are left out."""
    return [event for event in record.events if event.kind not in {"phase", "setting", "check"}]


def event_rows(record: Record) -> list[tuple[str, str, str, str]]:
    """Return the first events in order of time, as texts: time (s), kind, event, details."""
    return [
        (fixed(record.time_of(event), 3), event.kind, event.text, _details(event.data))
        for event in sorted(tabled_events(record), key=lambda event: event.time_ns)[:EVENT_ROWS]
    ]


def _details(data: dict[str, Any]) -> str:
    return ", ".join(f"{key} = {plain(value)}" for key, value in data.items() if key != "whole")


def first_trip(record: Record) -> dict[str, Any] | None:
    """Return sentences on the first tripped limit and its consequences ("sentences"), and a drawing of its signal
    ("drawing"). Return None if no limit tripped.
    """
    from bench_records.report_plots import time_panel

    events = sorted(record.events, key=lambda event: event.time_ns)
    trips = [event for event in events if event.kind == TRIP]
    if not trips:
        return None
    first = trips[0]
    at = record.time_of(first)
    sentences = [f"The first limit that tripped: {first.text} at {fixed(at, 3)}{THIN_SPACE}s."]
    followers = [event for event in events if first.time_ns <= event.time_ns and event is not first]
    followers = [event for event in followers if event.kind in {TRIP, "state"}]
    near = [event for event in followers if record.time_of(event) - at <= AROUND_TRIP_S]
    if near:
        text = "; ".join(
            f"{fixed((event.time_ns - first.time_ns) / 1e6, 0)}{THIN_SPACE}ms later, {event.text}"
            for event in near[:6]
        )
        more = f"; and {len(near) - 6} more" if len(near) > 6 else ""
        sentences.append(f"Next events: {text}{more}.")
    else:
        sentences.append(
            f"No other limit tripped and no state changed in the next {AROUND_TRIP_S:.0f}{THIN_SPACE}s."
        )
    name = first.data.get("signal")
    drawing = ""
    if name in record.signals and record.signals[name].quantity:
        span = (max(0.0, at - AROUND_TRIP_S), min(record.duration, at + AROUND_TRIP_S))
        for quantity, unit, lines in lines_by_quantity(record, [name]):
            near_lines = [
                line._replace(times=line.times[inside], values=line.values[inside])
                for line in lines
                for inside in [(line.times >= span[0]) & (line.times <= span[1])]
            ]
            marks = [record.time_of(event) for event in trips if span[0] <= record.time_of(event) <= span[1]]
            drawing = time_panel(
                "first-out", f"{quantity} around the trip", unit, near_lines, [], span, marks[:1]
            )
    return {"sentences": sentences, "drawing": drawing}
