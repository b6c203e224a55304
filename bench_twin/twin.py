"""The twin of a run: follows its record, judges what can be judged, and looks for a cause where rig and model part."""

from __future__ import annotations

from typing import Final, NamedTuple

from msgspec.structs import replace

from bench_records.record import Record
from bench_records.twin import Judged, Parting, TwinStory
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import Parameters
from bench_twin import course
from bench_twin.causes import explanations
from bench_twin.detector import Alarm, Detector
from bench_twin.fitting import Fit
from bench_twin.forms import Form, Suspect
from bench_twin.innovations import (
    BLOCK,
    Belief,
    Columns,
    Innovations,
    columns_of,
    gas_rates,
    judge,
    parameters_of,
)
from bench_twin.replays import Replays
from bench_twin.stretches import LEAST, NOTHING, STEP, Stretch, stretches
from diagnosis.contracts import Array, Channel, DiagnosisError, MeasuredRun
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.records import run_between

#: A motion is smoothed by what comes after it: so much of the end (s) waits for that.
_WAITS: Final = 0.5
#: A stretch that parted is looked at again for its cause when what came since is so many times as long.
_AGAIN: Final = 1.6
#: Where two causes may act, the first one is looked for in what came until so many s after it was told.
_SOON: Final = 2.0
#: What is left of a cause that is over: less than so much of its size (k = 2).
_GONE: Final = 0.5
#: A parting that nothing explained is over after so many times the time that it took to be told, and so many s.
_AS_LONG: Final = 2.0
_LONG: Final = 20.0


class Seen(NamedTuple):
    """A stretch as it is judged: what was measured, and what is believed where it starts."""

    run: MeasuredRun
    channels: tuple[Channel, ...]
    columns: Columns
    belief: Belief
    rates: dict[str, float]  #: K/s, of the gas where it starts


class Twin:
    """The model with ``parameters`` beside the run of a ``record``, which may be growing; ``model`` is its name.

    DiagnosisError for a rig without a sensor that the model could be held against.
    """

    def __init__(self, record: Record, parameters: Parameters, model: str) -> None:
        # Thermometers are too slow and too coarse to part on; a stretch begins from what they read.
        judged = tuple(
            name for name in OUTPUTS if not name.endswith("_temperature") and name in record.signals
        )
        if not judged:
            raise DiagnosisError(
                f"{record.path} has no pressure and no force: there is nothing to hold a model against"
            )
        self._record, self._model = record, model
        self._simulator = AirSpring(parameters, effects=CATALOGUE, only=judged)
        self._parameters = parameters_of(self._simulator)
        self._belief = Belief.prior(self._parameters)
        self._detector = Detector(len(self._simulator.channels), BLOCK)
        self._noise: Array | None = None  # of sensors, from the first stretch that goes along
        self._closed: list[Judged] = []
        self._partings: list[Parting] = []
        self._open: Parting | None = None
        self._known: tuple[Suspect, ...] = ()  # what explained the present stretch when it was shorter
        self._looked_until = 0.0

    def look(self, *, ended: bool = True) -> TwinStory:
        """Judge what has come since the last look, and return all that can be said by now."""
        until = self._closed[-1].end if self._closed else 0.0
        open_one: tuple[Judged, ...] = ()
        for stretch in stretches(self._record, ended=ended):
            if stretch.start < until - 0.5 * STEP:
                continue
            one = self._judge(stretch)
            if stretch.open:
                open_one = (one,)
            else:
                self._close(one)
        self._simulator.forget()
        return TwinStory(
            self._model, self._record.duration, (*self._closed, *open_one), self._with(self._open)
        )

    def _close(self, one: Judged) -> None:
        """Take over a stretch that is judged for good, and what was said of it."""
        self._closed.append(one)
        self._partings = list(self._with(self._open))
        self._open, self._known = None, ()

    def _with(self, found: Parting | None) -> tuple[Parting, ...]:
        """Return the partings of earlier stretches, and what the present one adds to the last of them or to all."""
        last = self._partings[-1] if self._partings else None
        if found is None:
            return tuple(self._partings)
        if last is not None and last.lasts and found.lasts and course.is_the_same(last, found):
            return (*self._partings[:-1], self._told(course.lasting(last, found, found.course[-1].at)))
        return (*self._partings, found)

    def _see(self, start: float, end: float) -> Seen:
        """Return what there is of a stretch. DiagnosisError if it cannot be replayed."""
        channels, run = run_between(self._record, start, end, self._simulator)
        columns = columns_of(run, channels, self._simulator, self._noise)
        rates = gas_rates(self._record, start)
        return Seen(run, channels, columns, self._belief.at_a_start(self._parameters, rates), rates)

    def _judge(self, stretch: Stretch) -> Judged:
        end = stretch.end - (_WAITS if stretch.open else 0.0)
        start = stretch.start
        if stretch.why or end - start < LEAST:
            return Judged(start, stretch.end, None, stretch.why or "it was too short")
        try:
            seen = self._see(start, end)
        except DiagnosisError as error:
            return Judged(start, stretch.end, None, str(error))
        if not seen.columns.samples.any():
            return Judged(start, stretch.end, None, NOTHING)
        told, detector = judge(seen.columns, seen.belief), self._detector.copy()
        alarm = detector.look(told.white)
        if alarm is None:
            if self._open is not None and not self._open.withdrawn:
                self._open = self._told(course.withdrawn(self._open, end))
            if not stretch.open:
                self._is_it_over(seen, start, end)
            if not stretch.open and not (self._partings and self._partings[-1].lasts):
                # What a fault does that lasts is no tolerance.
                self._belief, self._detector, self._noise = told.belief, detector, seen.columns.noise
            return Judged(start, stretch.end, True)
        self._part(alarm, told, seen, start, end, closes=not stretch.open)
        return Judged(start, stretch.end, False)

    def _part(
        self, alarm: Alarm, told: Innovations, seen: Seen, start: float, end: float, *, closes: bool
    ) -> None:
        """Say where rig and model part in the stretch ``seen`` from ``start`` to ``end`` s, and why perhaps."""
        since, c = alarm.since * BLOCK, alarm.channel
        before = self._open
        parting = Parting(
            start + (alarm.at + 1) * BLOCK,
            start + since,
            seen.channels[c].name,
            float(told.measured[alarm.at, c]),
            float(told.expected[alarm.at, c]),
            2.0 * float(told.band[alarm.at, c]),
        )
        longer = end - start - since > _AGAIN * (self._looked_until - start - since)
        if before is None or longer or (closes and self._looked_until < end):
            parting = self._explained(parting, seen, start, since)
            self._looked_until = end
            self._open = self._told(course.goes_on(before or parting, parting, end))

    def _explained(self, parting: Parting, seen: Seen, start: float, since: float) -> Parting:
        """Return a parting with what explains it."""
        # By the priors: what sound stretches have taught is surer than it is true to a part in a thousand.
        prior = Belief.prior(self._parameters).at_a_start(self._parameters, seen.rates)

        def known() -> tuple[Suspect, ...]:
            """What explains the stretch as it was soon after it was told, if nobody looked then."""
            until = parting.told + _SOON
            if (
                self._known
                or until > start + len(seen.run.experiment.time) * seen.run.experiment.step - LEAST
            ):
                return self._known
            then = self._see(start, until)
            return explanations(then.run, then.columns, prior, self._simulator, since, tuple).singles

        found = explanations(seen.run, seen.columns, prior, self._simulator, since, known)
        first = found.singles or tuple(pair[0] for pair in found.pairs)
        if not first:
            return parting
        self._known, catalogue = first, self._simulator.catalogue
        ends = [one.until if one.form is Form.GONE else None for one in found.singles] or [None]
        return replace(
            parting,
            since=start + first[0].since,
            causes=tuple(course.cause_of(one, catalogue[one.name], start) for one in found.singles),
            pairs=tuple(
                (course.cause_of(a, catalogue[a.name], start), course.cause_of(b, catalogue[b.name], start))
                for a, b in found.pairs
            ),
            earliest=start + min(one.since_low for one in first),
            latest=start + max(one.since_high for one in first),
            over=None if None in ends else start + max(end for end in ends if end is not None),
        )

    def _is_it_over(self, seen: Seen, start: float, end: float) -> None:
        """Say that a parting of an earlier stretch is over, if this one, which goes along, would have shown it."""
        last = self._partings[-1] if self._partings else None
        if last is None or not last.lasts:
            return
        if last.causes:
            fit, replays = Fit(seen.columns, seen.belief), Replays(seen.run, self._simulator)
            for one in last.causes:
                cause = self._simulator.catalogue[one.name]
                shapes = {shape.name: shape.nominal for shape in cause.shapes}
                (column,) = replays.columns([(cause, shapes, one.size)], 0)
                if column is None:
                    return
                left = fit.with_(column, one.size)
                if not left.size or abs(left.size) + 2.0 * left.deviation > _GONE * abs(one.size):
                    return
        elif end - start < max(_LONG, _AS_LONG * (last.told - last.since)):
            return
        self._partings[-1] = self._told(course.over(last, start, end))

    def _told(self, parting: Parting) -> Parting:
        channel = next(one for one in self._simulator.channels if one.name == parting.channel)
        return course.told(parting, channel)
