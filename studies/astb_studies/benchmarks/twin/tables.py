"""The counts as tables with exact intervals."""

from collections.abc import Callable, Iterable, Sequence
from typing import Final

import msgspec
import numpy as np
from scipy.stats import gamma

from astb_studies.benchmarks.diagnosis.statistics import Rate
from astb_studies.benchmarks.twin.cases import SIZES, Case
from bench_records.twin import Deviation, PossibleCause, TwinStory
from bench_sim.parameters.effects import find_effect


class Live(msgspec.Struct, frozen=True, rename={"detected": "told"}):
    """Results of a case in real time: times (s) after the beginning of the effect, and late ticks of the rig.

    A time is None if the event did not happen.
    """

    detected: float | None  #: deviation detected
    explained: float | None  #: deviation explained, or found to have no explanation
    late: int  #: ticks of the rig that were late by 1 ms or more
    tail: float  #: of 1000 ticks, late by 250 µs or more


class Counted(msgspec.Struct, frozen=True, rename={"all_deviations": "partings"}):
    """Results of the twin for a case: seconds judged, deviations, and the time of detection by the best test (s)."""

    case: Case
    judged: float
    all_deviations: tuple[Deviation, ...]
    best: float | None
    live: Live | None = None

    @property
    def first_deviation(self) -> Deviation | None:
        """The first deviation since the effect began."""
        return next((one for one in self.all_deviations if one.detected >= self.case.at), None)

    @property
    def early(self) -> bool:
        """Whether a deviation was reported before the start of an effect."""
        return any(one.detected < self.case.at for one in self.all_deviations)

    @property
    def named(self) -> bool:
        """Whether an effect, or another law of the same phenomenon at its place, is among the causes."""
        return self.first_deviation is not None and any(
            self._true(one) for one in self.first_deviation.causes
        )

    @property
    def one_of_two(self) -> bool:
        """Whether an effect is one of two causes that are reported only together, and the other one is not present."""
        pairs = self.first_deviation.pairs if self.first_deviation else ()
        return not self.both and any(self._true(one) for pair in pairs for one in pair)

    @property
    def both(self) -> bool:
        """Whether two causes are reported together, and both are present."""
        case, pairs = self.case, self.first_deviation.pairs if self.first_deviation else ()
        return bool(case.second) and any(
            alike(a.name, one) and alike(b.name, two)
            for a, b in pairs
            for one, two in ((case.effect, case.second), (case.second, case.effect))
        )

    @property
    def over(self) -> bool:
        """Whether the end of the deviation is reported."""
        return self.first_deviation is not None and self.first_deviation.over is not None

    def _true(self, cause: PossibleCause) -> bool:
        return any(alike(cause.name, one) for one in (self.case.effect, self.case.second) if one)

    @property
    def unknown(self) -> bool:
        """Whether the deviation was reported without any cause."""
        return (
            self.first_deviation is not None
            and not self.first_deviation.causes
            and not self.first_deviation.pairs
        )

    @property
    def wrong(self) -> bool:
        """Whether there are causes, but none includes the effect."""
        return self.first_deviation is not None and not (
            self.unknown or self.named or self.one_of_two or self.both
        )


def alike(name: str, other: str) -> bool:
    """Return whether two effects are one, or laws of one phenomenon at one place."""
    (one, _), (two, _) = find_effect(name), find_effect(other)
    same = one.phenomenon == two.phenomenon != "" and name.partition(".")[2] == other.partition(".")[2]
    return name == other or same


def shortened(story: TwinStory, case: Case) -> tuple[Deviation, ...]:
    """Return the deviations that count for a case, without their time series and sentences."""
    until = case.until if case.effect else float("inf")
    return tuple(
        msgspec.structs.replace(
            one, detected=round(one.detected, 2), since=round(one.since, 2), course=(), sentence=""
        )
        for one in story.all_deviations
        if one.detected <= until
    )


def tables(counted: Sequence[Counted]) -> str:
    """Return all tables, in Markdown."""
    sound = [one for one in counted if not one.case.effect]
    harder = [one for one in counted if one.case.effect and _hard(one.case)]
    faulty = [one for one in counted if one.case.effect and not (one.live or _hard(one.case))]
    live = [one for one in counted if one.live]
    made = [
        make(some)
        for make, some in ((_sound, sound), (_faulty, faulty), (_harder, harder), (_live, live))
        if some
    ]
    return "\n\n".join("\n".join(table) for table in made)


def _live(counted: Sequence[Counted]) -> list[str]:
    lines = [
        "| In real time | at (s) | detected after (s) | explained after (s) | as | ticks late by 1 ms "
        "| of 1000, late by 250 µs |",
        "| --- | ---: | ---: | ---: | --- | ---: | ---: |",
    ]
    for one in counted:
        assert one.live
        grows = " creeping" if one.case.creeps else ""
        what = f"`{one.case.effect}` {SIZES[one.case.step]:g} ×{grows}, {one.case.plan}"
        times = (
            f"{time:.1f}" if time is not None else "–" for time in (one.live.detected, one.live.explained)
        )
        word = next((name for name, of in _ROWS[2:] if of(one)), "not detected")
        lines.append(
            f"| {what} | {one.case.at:.0f} | {' | '.join(times)} | {word} | {one.live.late} | {one.live.tail:.2f} |"
        )
    return lines


def _sound(sound: Sequence[Counted]) -> list[str]:
    kinds = {
        "as the model": [one for one in sound if not one.case.sibling],
        "siblings": [one for one in sound if one.case.sibling],
        "together": sound,
    }
    lines = [
        "| Sound rigs | runs | judged (h) | false alarms | in 100 h (95 %) |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for name, some in kinds.items():
        hours, false = sum(one.judged for one in some) / 3600.0, sum(len(one.all_deviations) for one in some)
        lines.append(f"| {name} | {len(some)} | {hours:.2f} | {false} | {_in_a_hundred(false, hours)} |")
    return lines


def _in_a_hundred(count: int, hours: float) -> str:
    """Return a number per 100 h, with the exact interval of a Poisson variable."""
    if not hours:
        return "–"
    low = float(gamma.ppf(0.025, count)) if count else 0.0
    high = float(gamma.ppf(0.975, count + 1))
    return f"{100.0 * count / hours:.1f} ({100.0 * low / hours:.1f} to {100.0 * high / hours:.1f})"


_ROWS: Final[tuple[tuple[str, Callable[[Counted], bool]], ...]] = (
    ("detected before it began", lambda one: one.early),
    ("detected", lambda one: one.first_deviation is not None),
    ("named", lambda one: one.named),
    ("as one of two", lambda one: one.one_of_two),
    ("unknown", lambda one: one.unknown),
    ("wrong", lambda one: one.wrong),
)


def _faulty(faulty: Sequence[Counted]) -> list[str]:
    lines = [
        "| Effects that begin | runs | "
        + " | ".join(name for name, _ in _ROWS)
        + " | delay (s) | best (s) |",
        "| --- | ---: | " + "---: | " * len(_ROWS) + "---: | ---: |",
        _line("all", faulty),
        _line("all at once", [one for one in faulty if not one.case.creeps]),
        _line("creeping", [one for one in faulty if one.case.creeps]),
    ]
    for step, size in enumerate(SIZES):
        lines.append(_line(f"{size:g} × usual", [one for one in faulty if one.case.step == step]))
    for plan in sorted({one.case.plan for one in faulty}):
        lines.append(_line(f"in {plan}", [one for one in faulty if one.case.plan == plan]))
    lines.append(_line("if the optimal test detects it", [one for one in faulty if one.best is not None]))
    for name in sorted({_kind(one) for one in faulty}):
        lines.append(_line(f"`{name}`", [one for one in faulty if _kind(one) == name]))
    return lines


def _hard(case: Case) -> bool:
    return bool(case.gone or case.second or case.sibling)


def _harder(harder: Sequence[Counted]) -> list[str]:
    rows = {**dict(_ROWS), "both": lambda one: one.both, "over": lambda one: one.over}
    kinds: dict[str, tuple[Callable[[Case], bool], tuple[str, ...]]] = {
        "two at once": (lambda case: bool(case.second), ("both",)),
        "gone again": (lambda case: bool(case.gone), ("over",)),
        "on a sibling": (lambda case: case.sibling, ()),
    }
    lines = [
        f"| Harder | runs | {' | '.join(rows)} |",
        "| --- | ---: | " + "---: | " * len(rows),
    ]
    for kind, (of_kind, own) in kinds.items():
        some = [one for one in harder if of_kind(one.case)]
        shown = {name: of for name, of in rows.items() if some and name in (*dict(_ROWS), *own)}
        rates = (str(Rate.of([shown[name](one) for one in some])) if name in shown else "–" for name in rows)
        lines.append(f"| {kind} | {len(some)} | {' | '.join(rates)} |")
    return lines


def _kind(one: Counted) -> str:
    return one.case.effect.partition(".")[0]


def _line(name: str, some: Sequence[Counted]) -> str:
    rates = [str(Rate.of([of(one) for one in some])) if some else "–" for _, of in _ROWS]
    both = [one for one in some if one.first_deviation and one.best is not None]
    delay = _middle(one.first_deviation.detected - one.case.at for one in both if one.first_deviation)
    best = _middle(one.best - one.case.at for one in both if one.best is not None)
    return f"| {name} | {len(some)} | " + " | ".join(rates) + f" | {delay} | {best} |"


def _middle(values: Iterable[float]) -> str:
    """The median and the quartiles."""
    found = np.array(list(values))
    if not len(found):
        return "–"
    low, middle, high = np.quantile(found, (0.25, 0.5, 0.75))
    return f"{middle:.1f} ({low:.1f} to {high:.1f})"
