"""The twin of a run: follows its record, compares it with the model, and searches for causes of deviations."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from bench_records.record import Record
from bench_records.twin import Deviation, Judged, LastMinute, TwinStory
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, Channel, DiagnosisError, MeasuredRun
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.records import STEP as SAMPLE
from diagnosis.systems.records import run_between
from diagnosis.twin import course
from diagnosis.twin.carried import Carried, GasOf
from diagnosis.twin.causes import explanations
from diagnosis.twin.detector import Alarm, Detector
from diagnosis.twin.fitting import Fit
from diagnosis.twin.forms import Form, SizedCause
from diagnosis.twin.innovations import (
    BLOCK,
    Columns,
    Estimate,
    Innovations,
    columns_of,
    gas_rates,
    judge,
    parameters_of,
)
from diagnosis.twin.last_minute import joined
from diagnosis.twin.replays import Replays
from diagnosis.twin.slices import Sliced, Work
from diagnosis.twin.stretches import (
    BEGINNING,
    LEAST,
    MOVING,
    NOTHING,
    SETTLES,
    STEP,
    Stretch,
    stretches,
)

#: The last part (s) of the record is not judged yet, because smoothing a motion needs later samples.
_WAITS: Final = 0.5
#: The cause of a deviation is searched again when the stretch has grown by this factor.
_AGAIN: Final = 1.6
#: If two causes may act, the search for the first one uses samples until this time (s) after its report.
_SOON: Final = 2.0
#: A cause is over if less than this part of its size remains (k = 2).
_GONE: Final = 0.5
#: A deviation without an explanation is over if rig and model agree for this many times the duration from its start to
#: its report, and for at least this many s.
_AS_LONG: Final = 2.0
_LONG: Final = 20.0
#: A replay may start in the stretch before the present one, but at most this many s earlier.
_BACK: Final = 300.0


class Seen(NamedTuple):
    """A stretch as it is judged: its measured run, and the state that is assumed at the start of its replay."""

    start: float  #: s, of the replay
    gas: dict[str, float] | None  #: settings of the gas at the start, if the rig is not at rest
    run: MeasuredRun
    channels: tuple[Channel, ...]
    columns: Columns
    estimate: Estimate
    rates: dict[str, float]  #: K/s, of the gas where it starts


class _Search(NamedTuple):
    """A search for the cause of a deviation, based on the samples received until ``end`` s."""

    work: Sliced[tuple[Deviation, tuple[SizedCause, ...]]]
    start: float  #: s, of the replay
    end: float


class Twin:
    """Compares the model with ``parameters`` with the ``record`` of a run. The record may still grow. ``model`` is the
    name of the model.

    Raises DiagnosisError if the rig has no sensor that the model can be compared with.
    """

    def __init__(self, record: Record, parameters: Parameters, model: str) -> None:
        # Thermometers are too slow and too coarse to show deviations; their readings only start a stretch.
        judged = tuple(
            name for name in OUTPUTS if not name.endswith("_temperature") and name in record.signals
        )
        if not judged:
            raise DiagnosisError(
                f"{record.path} has no pressure and no force that can be compared with a model; record at "
                "least one of them"
            )
        self._record, self._model = record, model
        self._simulator = AirSpring(parameters, effects=CATALOGUE, only=judged)
        self._parameters = parameters_of(self._simulator)
        self._estimate = Estimate.prior(self._parameters)
        self._detector = Detector(len(self._simulator.channels), BLOCK)
        self._noise: Array | None = None  # of sensors, from the first stretch that agrees with the model
        self._gas = GasOf(parameters)
        self._before: tuple[Seen, Estimate] | None = None  # the last stretch, and the estimate after it
        self._carried: Carried | None = None  # of it into the present one
        self._closed: list[Judged] = []
        self._deviations: tuple[Deviation, ...] = ()
        self._open: Deviation | None = None
        self._known: tuple[SizedCause, ...] = ()  # the explanation of the present stretch when it was shorter
        self._looked_until = 0.0
        self._since = BEGINNING  # a stretch whose beginning will not be another one
        self._later = False
        self._search: _Search | None = None
        #: Deviations of finished stretches: the first is under search, the others appeared meanwhile.
        self._waiting: list[Deviation] = []
        self._until = 0.0
        self._last: tuple[Judged, ...] = ()
        self._minute: LastMinute | None = None  # until the end of the last stretch that could be judged
        self._last_minute: LastMinute | None = None

    @property
    def searches(self) -> bool:
        """Whether a search for the cause of a deviation is still in progress."""
        return self._search is not None

    @property
    def looks_back_to(self) -> float:
        """The time (s) from which on the twin needs all samples of the record. Before it, means over a second are
        enough.
        """
        first = self._since.start if self._search is None else min(self._since.start, self._search.start)
        return first - _BACK

    @property
    def story(self) -> TwinStory:
        """All results so far."""
        all_deviations = self._deviations
        for one in (*self._waiting, self._open):
            all_deviations = course.joined(all_deviations, one)
        return TwinStory(
            self._model,
            self._until,
            (*self._closed, *self._last),
            tuple(
                course.described(one, self._channel(one), self._simulator.catalogue) for one in all_deviations
            ),
            self._last_minute,
        )

    def look(self, *, ended: bool = True, later: bool = False) -> TwinStory:
        """Judge the samples received since the last look, and return all results so far.

        With ``later``, the search for causes waits until `search` is called, unless the run has ended.
        """
        self._later = later and not ended
        if not self._later and self._waiting:
            self.search()
        until = self._closed[-1].end if self._closed else 0.0
        open_one: tuple[Judged, ...] = ()
        for stretch in stretches(self._record, ended=ended, since=self._since):
            if stretch.start < until - 0.5 * STEP:
                continue
            one = self._judge(stretch)
            if stretch.open:
                open_one = (one,)
                if stretch.sure:
                    self._since = stretch
            else:
                self._close(one)
            self._simulator.forget()  # each stretch occurs once in a look
        self._until, self._last = self._record.duration, open_one
        return self.story

    def search(self, seconds: float = inf) -> None:
        """Continue the search for causes for about ``seconds`` of processor time, and store its result if it ends."""
        if self._search is None:
            return
        found = self._search.work.go_on(seconds)
        self._simulator.forget()
        if found is None:
            return
        end, (deviation, first) = self._search.end, found
        self._search = None
        if self._waiting:
            explained, *meanwhile = self._waiting
            for one in (course.extend_deviation(explained, deviation, end), *meanwhile):
                self._deviations = course.joined(self._deviations, one)
            self._waiting = []
        else:
            self._known = first or self._known
            self._open = course.extend_deviation(self._open or deviation, deviation, end)

    def _close(self, one: Judged) -> None:
        """Store the results of a finished stretch, and complete its search for causes unless this is done `later`."""
        self._closed.append(one)
        if one.along is None:
            self._before = None
        if not self._later:
            self.search()
        if self._open is not None:
            if self._search is not None:
                self._waiting.append(self._open)
            else:
                self._deviations = course.joined(self._deviations, self._open)
        self._open, self._known = None, ()

    def _see(self, stretch: Stretch, end: float, before: Seen | None = None) -> Seen:
        """Return a stretch as it is judged until ``end`` s. ``before`` is the same stretch as judged in an earlier
        look.

        Raises DiagnosisError if it cannot be replayed.
        """
        start, gas = (before.start, before.gas) if before else (stretch.start, None)
        if stretch.moving and not before:
            start, gas = self._in_motion(stretch.start)
        channels, run = run_between(
            self._record, start, end, self._simulator, counts_from=stretch.start, gas=gas
        )
        columns = columns_of(run, channels, self._simulator, self._noise)
        rates = {} if stretch.moving else gas_rates(self._record, start)
        estimate = self._estimate.at_a_start(self._parameters, rates)
        return Seen(start, gas, run, channels, columns, estimate, rates)

    def _in_motion(self, at: float) -> tuple[float, dict[str, float]]:
        """Return the start (s) of the replay for a stretch that begins at ``at`` s in a motion, and the gas at the
        start of the replay.
        """
        if self._before is None or abs(self._closed[-1].end - at) > 0.5 * STEP:
            raise DiagnosisError(MOVING)
        seen, estimate = self._before
        if self._carried is None:
            self._carried = self._gas.carried(seen.run, self._parameters, estimate, at - SETTLES - seen.start)
        times, _ = self._record.series("left.height")
        first = float(times[np.searchsorted(times, seen.start)])
        return first + (self._carried.sample - 0.5) * SAMPLE, self._carried.gas

    def _judge(self, stretch: Stretch) -> Judged:
        end = stretch.end - (_WAITS if stretch.open else 0.0)
        start = stretch.start
        if stretch.why or end - start < LEAST:
            return Judged(start, stretch.end, None, stretch.why or "the part of the run is too short")
        if stretch.open and self._open is not None and self._searched_now:
            return Judged(start, stretch.end, False)  # until it is known why, it is taken to part
        try:
            seen = self._see(stretch, end)
        except DiagnosisError as error:
            return Judged(start, stretch.end, None, str(error))
        if not seen.columns.samples.any():
            return Judged(start, stretch.end, None, NOTHING)
        innovations, detector = judge(seen.columns, seen.estimate), self._detector.copy()
        alarm = detector.look(innovations.white)
        self._last_minute = joined(self._minute, seen.start, seen.channels, innovations)
        if alarm is not None:
            self._part(alarm, innovations, stretch, seen, end)
        else:
            if self._open is not None and not self._open.withdrawn:
                self._open = course.withdrawn(self._open, end)
                if self._searched_now:
                    self._search = None
            if not stretch.open:
                self._is_it_over(seen, start, end)
            lasts = self._waiting or (self._deviations and self._deviations[-1].lasts)
            if not stretch.open and not lasts:
                # The effect of a lasting fault is not a tolerance.
                self._estimate, self._detector, self._noise = (
                    innovations.estimate,
                    detector,
                    seen.columns.noise,
                )
        if not stretch.open:
            self._before, self._carried, self._minute = (seen, innovations.estimate), None, self._last_minute
        return Judged(start, stretch.end, alarm is None)

    def _part(self, alarm: Alarm, innovations: Innovations, stretch: Stretch, seen: Seen, end: float) -> None:
        """Report the deviation of a ``stretch``, judged until ``end`` s, and start the search for its cause."""
        start, since, c = seen.start, alarm.since * BLOCK, alarm.channel
        before = self._open
        deviation = Deviation(
            start + (alarm.at + 1) * BLOCK,
            start + since,
            seen.channels[c].name,
            float(innovations.measured[alarm.at, c]),
            float(innovations.expected[alarm.at, c]),
            2.0 * float(innovations.band[alarm.at, c]),
        )
        longer = end - start - since > _AGAIN * (self._looked_until - start - since)
        new = before is None or before.withdrawn
        if self._later and new:
            again = replace(before, withdrawn=False) if before else replace(deviation, searched=False)
            self._open = course.extend_deviation(before or again, again, end)
        if not self._later:
            self._search = None  # the result from all samples is better
        if self._search is None and (new or longer or (not stretch.open and self._looked_until < end)):
            self._search = _Search(Sliced(self._explained(deviation, stretch, seen, since)), start, end)
            self._looked_until = end
            if not self._later:
                self.search()

    @property
    def _searched_now(self) -> bool:
        """Whether a search for causes of a deviation in the present stretch is in progress."""
        return self._search is not None and not self._waiting

    def _explained(
        self, deviation: Deviation, stretch: Stretch, seen: Seen, since: float
    ) -> Work[tuple[Deviation, tuple[SizedCause, ...]]]:
        """Search the causes of a deviation. Return the deviation with them, and the single causes or the first causes
        of pairs.
        """
        # Use the priors: the estimate from sound stretches claims more precision than it has.
        start, before = seen.start, self._known
        prior = Estimate.prior(self._parameters).at_a_start(self._parameters, seen.rates)

        def known() -> Work[Sequence[SizedCause]]:
            """Return the causes found by an earlier search. If there was no search, search the causes in the stretch up
            to shortly after the detection.
            """
            until = deviation.detected + _SOON
            if before or until > start + len(seen.run.experiment.time) * seen.run.experiment.step - LEAST:
                return before
            then = self._see(stretch, until, seen)
            soon = yield from explanations(
                then.run, then.columns, prior, self._simulator, since, _no_suspects
            )
            return soon.singles + soon.worse

        found = yield from explanations(seen.run, seen.columns, prior, self._simulator, since, known)
        first = found.singles or tuple(pair[0] for pair in found.pairs)
        if not first:
            return deviation, ()
        catalogue = self._simulator.catalogue
        ends = [one.until if one.form is Form.GONE else None for one in found.singles] or [None]
        explained = replace(
            deviation,
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
        return explained, first + found.worse

    def _is_it_over(self, seen: Seen, start: float, end: float) -> None:
        """Report the end of an earlier deviation, if this stretch would have shown it but agrees with the model."""
        last = self._deviations[-1] if self._deviations else None
        if last is None or not last.lasts or self._waiting:
            return
        if last.causes:
            fit, replays = Fit(seen.columns, seen.estimate), Replays(seen.run, self._simulator)
            for one in last.causes:
                cause = self._simulator.catalogue[one.name]
                shapes = {shape.name: shape.nominal for shape in cause.shapes}
                (column,) = replays.columns([(cause, shapes, one.size)], 0)
                if column is None:
                    return
                left = fit.with_(column, one.size)
                if not left.size or abs(left.size) + 2.0 * left.deviation > _GONE * abs(one.size):
                    return
        elif end - start < max(_LONG, _AS_LONG * (last.detected - last.since)):
            return
        self._deviations = (*self._deviations[:-1], course.over(last, start, end))

    def _channel(self, deviation: Deviation) -> Channel:
        return next(one for one in self._simulator.channels if one.name == deviation.channel)


def _no_suspects() -> Work[Sequence[SizedCause]]:
    """Return an empty sequence of known causes, as work in slices."""
    yield from ()
    return ()
