"""How a parting goes: it is told, gets surer, is said otherwise, withdrawn, or over; and the sentence that tells it."""

from typing import Final

import numpy as np
from msgspec.structs import replace

from bench_records.twin import Parting, PossibleCause, Said
from bench_twin.forms import Form, Suspect
from diagnosis.contracts import Channel, Hypothesis
from diagnosis.estimates import decimals

#: What the replay of a cause may be off by that did not act from the start, as a part of its size: an orifice of which
#: half is blocked comes out 3.5 % too open.
_ROUGHLY: Final = 0.02
#: A size is surer whose interval is so many times as wide at most.
_SURER: Final = 0.8


def cause_of(one: Suspect, hypothesis: Hypothesis, start: float) -> PossibleCause:
    """Return a suspect of a stretch that began at ``start`` s, as it is kept and told."""
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


def goes_on(before: Parting, now: Parting, at: float) -> Parting:
    """Return what is said at ``at`` s of a parting of which something was said ``before``."""
    word = _compared(before, now) if before.course and not before.withdrawn else "told"
    course = (*before.course, Said(at, word, now.causes, now.pairs)) if word else before.course
    return _ended(replace(now, told=before.told, course=course), before, at)


def withdrawn(parting: Parting, at: float) -> Parting:
    """Return a parting that what came until ``at`` s makes none."""
    return replace(parting, withdrawn=True, course=(*parting.course, Said(at, "withdrawn")))


def over(parting: Parting, since: float, at: float) -> Parting:
    """Return a parting that is known at ``at`` s to be over since ``since`` s."""
    return replace(
        parting, over=since, course=(*parting.course, Said(at, "over", parting.causes, parting.pairs))
    )


def is_the_same(before: Parting, now: Parting) -> bool:
    """Return whether a parting in a later stretch is the one before: something explains both, or nothing either."""
    if not _names(before) and not _names(now):
        return True
    return bool(_names(before) & _names(now))


def joined(partings: tuple[Parting, ...], found: Parting | None) -> tuple[Parting, ...]:
    """Return the partings of earlier stretches, and what a later one adds to the last of them or to all.

    As long as nobody has looked for its causes it is taken to be the last one, if that lasts.
    """
    last = partings[-1] if partings else None
    if found is None:
        return partings
    if last is not None and last.lasts and found.lasts:
        if not found.searched:
            return partings
        if is_the_same(last, found):
            return (*partings[:-1], lasting(last, found, found.course[-1].at))
    return (*partings, found)


def lasting(before: Parting, now: Parting, at: float) -> Parting:
    """Return the parting of an earlier stretch with what a later one says: what explains both, by the later one."""
    names = _names(before) & _names(now)
    causes = tuple(one for one in now.causes if frozenset({one.name}) in names)
    pairs = tuple(pair for pair in now.pairs if frozenset(one.name for one in pair) in names)
    if any(_undoes(one, causes) for one in before.causes):
        # As a step back, if the zero is taken for a tolerance.
        return _ended(replace(before, over=now.since), before, at)
    newest = replace(before, causes=causes, pairs=pairs, over=now.over)
    if word := _compared(before, newest):
        newest = replace(newest, course=(*before.course, Said(at, word, causes, pairs)))
    elif now.over is None:
        return before
    return _ended(newest, before, at)


def _undoes(before: PossibleCause, causes: tuple[PossibleCause, ...]) -> bool:
    """Return whether a cause is among ``causes`` that begins to do the opposite of what it did ``before``."""
    return any(
        one.name == before.name
        and one.since is not None
        and abs(one.size + before.size) < 0.5 * abs(before.size)
        for one in causes
    )


def _ended(now: Parting, before: Parting, at: float) -> Parting:
    """Return a parting that says, where it is ``over`` and was not ``before``, that it is."""
    if now.over is None or (before.course and before.over is not None):
        return now
    return replace(now, course=(*now.course, Said(at, "over", now.causes, now.pairs)))


def _names(parting: Parting) -> frozenset[frozenset[str]]:
    singles = {frozenset({one.name}) for one in parting.causes}
    return frozenset(singles | {frozenset(one.name for one in pair) for pair in parting.pairs})


def _compared(before: Parting, now: Parting) -> str:
    """Return *explained*, *unknown*, *surer* or *otherwise*, or "" where what is said is as before."""
    old, new = _names(before), _names(now)
    if not before.searched:
        return "" if not now.searched else "explained" if new else "unknown"
    if old != new:
        return "surer" if new and new < old else "otherwise"
    if any(_form(before, one) != _form(now, one) or _beyond(before, now, one) for one in old):
        return "otherwise"
    widths = [(_width(before, one), _width(now, one)) for one in old]
    return "surer" if widths and all(after <= _SURER * first for first, after in widths) else ""


def _members(parting: Parting, names: frozenset[str]) -> tuple[PossibleCause, ...]:
    together = [*((one,) for one in parting.causes), *parting.pairs]
    some = next(some for some in together if frozenset(one.name for one in some) == names)
    return tuple(sorted(some, key=lambda one: one.name))


def _form(parting: Parting, names: frozenset[str]) -> tuple[str, ...]:
    return tuple(one.form for one in _members(parting, names))


def _beyond(before: Parting, now: Parting, names: frozenset[str]) -> bool:
    """Return whether a size is not within the interval that was told before."""
    pairs = zip(_members(before, names), _members(now, names), strict=True)
    return any(not old.low <= new.size <= old.high for old, new in pairs)


def _width(parting: Parting, names: frozenset[str]) -> float:
    return max(one.high - one.low for one in _members(parting, names))


def told(parting: Parting, channel: Channel) -> Parting:
    """Return a parting with its sentence."""
    off, scale = parting.measured - parting.expected, channel.scale
    unit = channel.display or channel.unit
    places = decimals(-parting.band / scale, parting.band / scale)
    sentence = (
        f"From {_since(parting)} on, {channel.name} reads {abs(off) / scale:.{places}f} {unit} "
        f"{'more' if off > 0.0 else 'less'} than the model expects (band ± {parting.band / scale:.{places}f} {unit}), "
        f"told at {parting.told:.1f} s. {_explained(parting)}"
    )
    if parting.withdrawn:
        sentence += f" Withdrawn at {parting.course[-1].at:.0f} s: by what came since, they do not part."
    elif parting.over is not None:
        sentence += f" From {parting.over:.0f} s on at the latest the rig goes along with its model again."
    return replace(parting, sentence=sentence)


def _since(parting: Parting) -> str:
    """Return since when, with the interval where one is known that is wider than a second shows."""
    if parting.earliest is None or parting.latest is None or parting.latest - parting.earliest < 1.0:
        return f"{parting.since:.0f} s"
    return f"{parting.since:.0f} s ({parting.earliest:.0f} to {parting.latest:.0f} s)"


def _explained(parting: Parting) -> str:
    if not parting.searched:
        return "What may be the cause is still looked for."
    if parting.causes:
        return f"It would be explained by: {'; or '.join(map(_cause, parting.causes))}."
    if parting.pairs:
        pairs = [" and ".join(f"{_cause(one)}{_from(one)}" for one in pair) for pair in parting.pairs]
        return f"No single cause of the catalogue explains it; two would: {'; or '.join(pairs)}."
    return "No single cause of the catalogue explains it."


def _from(cause: PossibleCause) -> str:
    return "" if cause.since is None else f" from {cause.since:.0f} s on"


def _cause(cause: PossibleCause) -> str:
    told = f"{cause.title}, {cause.shown}"
    if cause.form == Form.AT_ONCE or cause.since is None:
        return told
    if cause.form == Form.GROWING:
        if cause.until is None:
            return f"{told}, still growing since {cause.since:.0f} s"
        return f"{told}, grown from {cause.since:.0f} to {cause.until:.0f} s"
    return told if cause.until is None else f"{told}, from {cause.since:.0f} to {cause.until:.0f} s"
