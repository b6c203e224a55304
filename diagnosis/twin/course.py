"""The course of a deviation: how its state changes (reported, more certain, changed, withdrawn, over), and the
sentences of the report.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec.structs import replace

from bench_records.twin import Deviation, DeviationState, PossibleCause, Summary
from diagnosis.contracts import Channel, Hypothesis
from diagnosis.engine.summary import WHERE
from diagnosis.estimates import decimals
from diagnosis.twin.forms import Form, SizedCause

#: Possible error of the replay of a cause that did not act from the start, relative to its size. For example, a
#: half-blocked orifice is found 3.5 % too open.
_ROUGHLY: Final = 0.02
#: A size counts as better known if its interval shrinks to this part at most.
_SURER: Final = 0.8
_NONE: Final[Mapping[str, Hypothesis]] = MappingProxyType({})


def cause_of(one: SizedCause, hypothesis: Hypothesis, start: float) -> PossibleCause:
    """Return a suspected cause in the form of the report. Its stretch began at ``start`` s of the run."""
    amplitude = hypothesis.amplitude
    roughly = 2.0 * _ROUGHLY * abs(one.size)
    low, high = (
        one.size - np.hypot(one.size - one.low, roughly),
        one.size + np.hypot(one.high - one.size, roughly),
    )
    low, high = max(float(low), amplitude.low), min(float(high), amplitude.high)
    scale = amplitude.scale
    places = decimals(low / scale, high / scale)
    size, low_shown, high_shown = (f"{value / scale:.{places}f}" for value in (one.size, low, high))
    unit = amplitude.display or amplitude.unit
    shown = f"{size}{'' if unit == '1' else f' {unit}'} ({low_shown} to {high_shown})"
    since = start + one.since if one.since else None
    until = None if one.until is None else start + one.until
    return PossibleCause(one.name, hypothesis.title, one.size, low, high, shown, one.form.value, since, until)


def extend_deviation(before: Deviation, now: Deviation, at: float) -> Deviation:
    """Return the deviation ``now`` with the course of ``before``. The result at ``at`` s is added if it has changed."""
    word = _compared(before, now) if before.course and not before.withdrawn else "told"
    course = (*before.course, DeviationState(at, word, now.causes, now.pairs)) if word else before.course
    return _ended(replace(now, detected=before.detected, course=course), before, at)


def withdrawn(deviation: Deviation, at: float) -> Deviation:
    """Return a deviation, marked as withdrawn because the samples until ``at`` s do not confirm it."""
    return replace(deviation, withdrawn=True, course=(*deviation.course, DeviationState(at, "withdrawn")))


def over(deviation: Deviation, since: float, at: float) -> Deviation:
    """Return a deviation, marked as over since ``since`` s; this was found at ``at`` s."""
    return replace(
        deviation,
        over=since,
        course=(*deviation.course, DeviationState(at, "over", deviation.causes, deviation.pairs)),
    )


def is_the_same(before: Deviation, now: Deviation) -> bool:
    """Return whether a later deviation continues the one before: they share a cause, or neither has one."""
    if not _names(before) and not _names(now):
        return True
    return bool(_names(before) & _names(now))


def joined(all_deviations: tuple[Deviation, ...], found: Deviation | None) -> tuple[Deviation, ...]:
    """Return the deviations of earlier stretches with a later one: appended, or merged into the last one.

    If the last one and the later one both last, the later one is not appended before its causes have been searched.
    """
    last = all_deviations[-1] if all_deviations else None
    if found is None:
        return all_deviations
    if last is not None and last.lasts and found.lasts:
        if not found.searched:
            return all_deviations
        if is_the_same(last, found):
            return (*all_deviations[:-1], lasting(last, found, found.course[-1].at))
    return (*all_deviations, found)


def lasting(before: Deviation, now: Deviation, at: float) -> Deviation:
    """Return the earlier deviation with the causes that explain both stretches. Their sizes are those of the later
    stretch.
    """
    names = _names(before) & _names(now)
    causes = tuple(one for one in now.causes if frozenset({one.name}) in names)
    pairs = tuple(pair for pair in now.pairs if frozenset(one.name for one in pair) in names)
    if any(_undoes(one, causes) for one in before.causes):
        # As a step back, if the zero is taken for a tolerance.
        return _ended(replace(before, over=now.since), before, at)
    newest = replace(before, causes=causes, pairs=pairs, over=now.over)
    if word := _compared(before, newest):
        newest = replace(newest, course=(*before.course, DeviationState(at, word, causes, pairs)))
    elif now.over is None:
        return before
    return _ended(newest, before, at)


def _undoes(before: PossibleCause, causes: tuple[PossibleCause, ...]) -> bool:
    """Return whether one of ``causes`` is the same as ``before`` with the opposite size, and so cancels it."""
    return any(
        one.name == before.name
        and one.since is not None
        and abs(one.size + before.size) < 0.5 * abs(before.size)
        for one in causes
    )


def _ended(now: Deviation, before: Deviation, at: float) -> Deviation:
    """Return the deviation ``now``. If it is over and ``before`` was not, add the end to its course."""
    if now.over is None or (before.course and before.over is not None):
        return now
    return replace(now, course=(*now.course, DeviationState(at, "over", now.causes, now.pairs)))


def _names(deviation: Deviation) -> frozenset[frozenset[str]]:
    singles = {frozenset({one.name}) for one in deviation.causes}
    return frozenset(singles | {frozenset(one.name for one in pair) for pair in deviation.pairs})


def _compared(before: Deviation, now: Deviation) -> str:
    """Return how the result has changed: *explained*, *unknown*, *surer* or *otherwise*; "" if it has not."""
    old, new = _names(before), _names(now)
    if not before.searched:
        return "" if not now.searched else "explained" if new else "unknown"
    if old != new:
        return "surer" if new and new < old else "otherwise"
    if any(_form(before, one) != _form(now, one) or _beyond(before, now, one) for one in old):
        return "otherwise"
    widths = [(_width(before, one), _width(now, one)) for one in old]
    return "surer" if widths and all(after <= _SURER * first for first, after in widths) else ""


def _members(deviation: Deviation, names: frozenset[str]) -> tuple[PossibleCause, ...]:
    together = [*((one,) for one in deviation.causes), *deviation.pairs]
    some = next(some for some in together if frozenset(one.name for one in some) == names)
    return tuple(sorted(some, key=lambda one: one.name))


def _form(deviation: Deviation, names: frozenset[str]) -> tuple[str, ...]:
    return tuple(one.form for one in _members(deviation, names))


def _beyond(before: Deviation, now: Deviation, names: frozenset[str]) -> bool:
    """Return whether the new size of a cause is outside the interval that was reported before."""
    pairs = zip(_members(before, names), _members(now, names), strict=True)
    return any(not old.low <= new.size <= old.high for old, new in pairs)


def _width(deviation: Deviation, names: frozenset[str]) -> float:
    return max(one.high - one.low for one in _members(deviation, names))


def described(
    deviation: Deviation, channel: Channel, catalogue: Mapping[str, Hypothesis] = _NONE
) -> Deviation:
    """Return a deviation with its summary and its sentence. ``catalogue`` gives the parts to inspect for its causes."""
    off, scale = deviation.measured - deviation.expected, channel.scale
    unit = channel.display or channel.unit
    places = decimals(-deviation.band / scale, deviation.band / scale)
    measured, expected, apart, band = (
        f"{value / scale:.{places}f}"
        for value in (deviation.measured, deviation.expected, abs(off), deviation.band)
    )
    first, others = _causes(deviation)
    wrong = (
        f"Since {_since(deviation)}, {channel.name} is {apart} {unit} {'above' if off > 0.0 else 'below'} the model."
        f"{first and f' Possible cause: {first}.'}{_end_sentence(deviation)}"
    )
    evidence = (
        f"It was detected at {_time_text(deviation.detected)}, when {channel.name} was {measured} {unit}. "
        f"The model expects {expected} ± {band} {unit} (k = 2)."
    )
    summary = Summary(wrong, others, evidence, _next_step(deviation, catalogue))
    return replace(deviation, summary=summary, sentence=f"{wrong} {others}")


def _time_text(seconds: float) -> str:
    """Return a time of the run as text, with one decimal. Equal times then look equal in all sentences."""
    return f"{seconds:.1f} s"


def _end_sentence(deviation: Deviation) -> str:
    if deviation.withdrawn:
        return f" Withdrawn at {_time_text(deviation.course[-1].at)}: later readings agree with the model."
    if deviation.over is not None:
        return f" The rig agrees with its model again, at the latest from {_time_text(deviation.over)} on."
    return ""


def _since(deviation: Deviation) -> str:
    """Return the start time as text, with its interval if that is wider than one second."""
    if deviation.earliest is None or deviation.latest is None or deviation.latest - deviation.earliest < 1.0:
        return _time_text(deviation.since)
    return f"{_time_text(deviation.since)} ({deviation.earliest:.1f} to {_time_text(deviation.latest)})"


def _causes(deviation: Deviation) -> tuple[str, str]:
    """Return the first possible cause as text, and a sentence on its certainty and on other causes."""
    if not deviation.searched:
        return "", "The search for a cause is not finished."
    if deviation.causes:
        first, *others = map(_cause, deviation.causes)
        if others:
            return first, f"Other possible causes: {'; or '.join(others)}."
        return first, "No other single cause of the catalogue explains it."
    if deviation.pairs:
        first, *others = (
            " and ".join(f"{_cause(one)}{_onset_text(one)}" for one in pair) for pair in deviation.pairs
        )
        also = f" Other possible pairs: {'; or '.join(others)}." if others else ""
        return first, f"No single cause of the catalogue explains it, but two together do.{also}"
    return "", "No single cause of the catalogue explains it."


def _next_step(deviation: Deviation, catalogue: Mapping[str, Hypothesis]) -> str:
    """Return the part to inspect and the run to do next."""
    if not deviation.lasts:
        return "No inspection is necessary while the rig agrees with its model."
    names = [one.name for one in (*deviation.causes, *(one for pair in deviation.pairs for one in pair))]
    known = [catalogue[name] for name in names if name in catalogue]
    inspect = dict.fromkeys(WHERE.get(one.family, one.title) for one in known)
    look = f"Inspect {'; and '.join(inspect)}. " if inspect else ""
    return f"{look}To find the cause: `astb run screening`, then `astb diagnose`."


def _onset_text(cause: PossibleCause) -> str:
    return "" if cause.since is None else f" from {_time_text(cause.since)} on"


def _cause(cause: PossibleCause) -> str:
    text = f"{cause.title}, {cause.shown}"
    if cause.form == Form.AT_ONCE or cause.since is None:
        return text
    if cause.form == Form.GROWING:
        if cause.until is None:
            return f"{text}, still growing since {_time_text(cause.since)}"
        return f"{text}, grown from {cause.since:.1f} to {_time_text(cause.until)}"
    return text if cause.until is None else f"{text}, from {cause.since:.1f} to {_time_text(cause.until)}"
