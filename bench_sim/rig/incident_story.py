"""The text report of an incident: the trip, the events before it, the reaction of the bench, and the end."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.black_box import NO_SAMPLE, Incident
from bench_protocol.rates import FAST_RATE
from bench_protocol.signals import Kind, Signal
from bench_protocol.table import TABLE
from bench_protocol.words import STATES

#: Smallest change of a reading before the incident that is reported, as a part of its range.
_TOLD: Final = 0.01
_TOLD_MAX: Final = 5
#: A reading is near a level within this part of its way to it.
_NEAR: Final = 0.1
#: Number of exactly equal samples after which a reading that varied before counts as stuck.
_STUCK: Final = round(0.5 * FAST_RATE)
_EVENTS_AFTER: Final = 12


class IncidentEvent(NamedTuple):
    """An event of the bench as text. ``tick`` is the time in ms since the rig started."""

    tick: int
    text: str


def story(incident: Incident, cause: str, signal: str, events: Sequence[IncidentEvent]) -> str:
    """Return the report of an incident as text, one sentence per line. ``signal`` is the one that exceeded its limit.
    Times are since the start of the rig.
    """
    lines = [f"{clock(incident.tick)} {cause}"]
    lines += [f"  before: {line}" for line in _before_the_trip(incident, signal)]
    after = [event for event in events if event.tick >= incident.tick]
    before = [event for event in events if incident.tick - 10_000 <= event.tick < incident.tick]
    lines += [f"  before: {clock(event.tick)} {event.text}" for event in before[-_EVENTS_AFTER:]]
    lines += [f"{clock(event.tick)} {event.text}" for event in after[:_EVENTS_AFTER]]
    if len(after) > _EVENTS_AFTER:
        lines.append(f"… and {len(after) - _EVENTS_AFTER} more")
    lines += [f"  after: {line}" for line in _after_the_trip(incident)]
    return "\n".join(lines) + "\n"


def clock(tick: int) -> str:
    """Return a time of the rig (ms) as hours, minutes, seconds and milliseconds."""
    seconds, milliseconds = divmod(tick, 1000)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}.{milliseconds:03}"


def named(name: str) -> str:
    """Return the name of a signal with spaces instead of dots and underscores."""
    return name.replace(".", " ").replace("_", " ")


def _measured(incident: Incident) -> Iterator[tuple[Signal, npt.NDArray[np.int16]]]:
    for name, samples in zip(incident.channels, incident.samples, strict=True):
        if TABLE[name].kind is Kind.MEASUREMENT:
            yield TABLE[name], samples


def _before_the_trip(incident: Incident, first: str) -> list[str]:
    """Return sentences on readings that were missing, stuck or changing before the trip. Missing and stuck readings and
    the signal ``first`` come first, then the largest changes.
    """
    sentences: list[tuple[float, str, str]] = []
    for signal, samples in _measured(incident):
        past = samples[: incident.trigger + 1]
        if past.size < 2 * _STUCK:
            continue
        if past[-1] == NO_SAMPLE:
            sentences.append(
                (np.inf, signal.name, f"no reading of {named(signal.name)} for {_since(past != NO_SAMPLE)}")
            )
            continue
        past = past[past != NO_SAMPLE]
        if (past[-_STUCK:] == past[-1]).all() and (past != past[-1]).any():
            since = _since(past != past[-1])
            sentences.append(
                (
                    np.inf,
                    signal.name,
                    f"{named(signal.name)} was stuck at {_value_as_text(signal, past[-1])} for {since}",
                )
            )
            continue
        start, end = float(np.median(past[: past.size // 4])), float(np.median(past[-4:]))
        moved = abs(end - start) * signal.step / (signal.high - signal.low)
        if signal.name == first:
            moved = np.inf
        if moved >= _TOLD:
            left = np.abs(past - start) <= _NEAR * abs(end - start)
            sentences.append((moved, signal.name, _course(signal, past, start, end, _since(left))))
    sentences.sort(key=lambda one: -one[0])
    # Of a left and right pair, the reading that moved more represents both.
    first_of: dict[str, str] = {}
    for _, name, text in sentences:
        first_of.setdefault(name.replace("left", "").replace("right", ""), text)
    return list(first_of.values())[:_TOLD_MAX]


def _course(signal: Signal, past: npt.NDArray[np.int16], start: float, end: float, since: str) -> str:
    """Return a sentence on how the reading changed: still changing, or constant for some time."""
    away = np.abs(past - end) > _NEAR * abs(end - start)
    there = (past.size - 1 - np.flatnonzero(away)[-1]) / FAST_RATE if away.any() else 0.0
    if there >= 0.5:
        level = f"{_value_as_text(signal, end)} for {there:.1f} s"
        return f"{named(signal.name)} was {level}, and {_value_as_text(signal, start)} earlier"
    return f"{named(signal.name)} went from {_value_as_text(signal, start)} to {_value_as_text(signal, end)} in {since}"


def _since(inside: npt.NDArray[np.bool_]) -> str:
    """Return the time since the last True sample as text."""
    there = np.flatnonzero(inside)
    ago = (inside.size - 1 - there[-1]) / FAST_RATE if there.size else inside.size / FAST_RATE
    return f"{ago:.1f} s" if ago >= 1 else f"{ago * 1000:.0f} ms"


def _after_the_trip(incident: Incident) -> list[str]:
    """Return a sentence on the end of the record: the state of the bench, and the bellows pressures and heights."""
    lines = []
    states = incident.samples[incident.channels.index("rig.state")]
    if states.size and states[-1] != NO_SAMPLE:
        seconds = (states.size - 1 - incident.trigger) / FAST_RATE
        ends = [
            f"{named(name)} {_value_as_text(TABLE[name], incident.samples[incident.channels.index(name)][-1])}"
            for name in ("left.bellows_pressure", "right.bellows_pressure", "left.height", "right.height")
        ]
        lines.append(f"state {STATES[int(states[-1])]} {seconds:.0f} s after the trip, {', '.join(ends)}")
    return lines


def _value_as_text(signal: Signal, steps: float) -> str:
    return "unknown" if steps == NO_SAMPLE else signal.show(float(f"{steps * signal.step:.4g}"))
