"""The twin of a run: follows its record, judges what can be judged, and looks for a cause where rig and model part."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from bench_records.record import Record
from bench_records.twin import Judged, Parting, PossibleCause, TwinStory
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import Parameters
from bench_twin.causes import Suspect, suspects
from bench_twin.detector import Detector
from bench_twin.innovations import BLOCK, Belief, Columns, columns_of, gas_rates, judge, parameters_of
from bench_twin.stretches import LEAST, STEP, Stretch, stretches
from diagnosis.contracts import Array, Channel, DiagnosisError, Hypothesis, MeasuredRun
from diagnosis.finding import decimals
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.records import run_between

#: A motion is smoothed by what comes after it: so much of the end (s) waits for that.
_WAITS: Final = 0.5
#: A stretch that parted is looked at again for its cause when what came since is so many times as long.
_AGAIN: Final = 1.6
#: What the replay of a cause may be off by that did not act from the start, as a part of its size: an orifice of which
#: half is blocked comes out 3.5 % too open.
_ROUGHLY: Final = 0.02


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
        partings = (*self._partings, *([self._open] if self._open else []))
        return TwinStory(self._model, self._record.duration, (*self._closed, *open_one), partings)

    def _close(self, one: Judged) -> None:
        self._closed.append(one)
        if self._open is not None:
            self._partings.append(self._open)
            self._open = None

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
            run, channels, columns, belief, rates = self._see(start, end)
        except DiagnosisError as error:
            return Judged(start, stretch.end, None, str(error))
        told, detector = judge(columns, belief), self._detector.copy()
        alarm = detector.look(told.white)
        if alarm is None:
            if not stretch.open:
                self._belief, self._detector, self._noise = told.belief, detector, columns.noise
            self._open = None
            return Judged(start, stretch.end, True)
        since, c = alarm.since * BLOCK, alarm.channel
        before = self._open
        parting = Parting(
            start + (alarm.at + 1) * BLOCK,
            start + since,
            channels[c].name,
            float(told.measured[alarm.at, c]),
            float(told.expected[alarm.at, c]),
            2.0 * float(told.band[alarm.at, c]),
        )
        longer = end - start - since > _AGAIN * (self._looked_until - start - since)
        if before is None or longer or (not stretch.open and self._looked_until < end):
            # By the priors: what sound stretches have taught is surer than it is true to a part in a thousand.
            prior = Belief.prior(self._parameters).at_a_start(self._parameters, rates)
            if found := suspects(run, columns, prior, self._simulator, since):
                parting = replace(
                    parting,
                    since=start + found[0].since,
                    causes=tuple(_cause(one, self._simulator.catalogue[one.name]) for one in found),
                    earliest=start + min(one.since_low for one in found),
                    latest=start + max(one.since_high for one in found),
                )
            self._looked_until = end
        else:
            parting = replace(
                parting,
                since=before.since,
                causes=before.causes,
                earliest=before.earliest,
                latest=before.latest,
            )
        self._open = _told(parting, channels[c])
        return Judged(start, stretch.end, False)


def _cause(one: Suspect, hypothesis: Hypothesis) -> PossibleCause:
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
    return PossibleCause(one.name, hypothesis.title, one.size, low, high, shown)


def _since(parting: Parting) -> str:
    """Return since when, with the interval where one is known that is wider than a second shows."""
    if parting.earliest is None or parting.latest is None or parting.latest - parting.earliest < 1.0:
        return f"{parting.since:.0f} s"
    return f"{parting.since:.0f} s ({parting.earliest:.0f} to {parting.latest:.0f} s)"


def _told(parting: Parting, channel: Channel) -> Parting:
    """Return a parting with its sentence."""
    off, scale = parting.measured - parting.expected, channel.scale
    unit = channel.display or channel.unit
    places = decimals(-parting.band / scale, parting.band / scale)
    sentence = (
        f"From {_since(parting)} on, {channel.name} reads {abs(off) / scale:.{places}f} {unit} "
        f"{'more' if off > 0.0 else 'less'} than the model expects (band ± {parting.band / scale:.{places}f} {unit}), "
        f"told at {parting.told:.1f} s."
    )
    if parting.causes:
        causes = [f"{one.title}, {one.shown}" for one in parting.causes]
        sentence += f" It would be explained by: {'; or '.join(causes)}."
    else:
        sentence += " No single cause of the catalogue explains it."
    return replace(parting, sentence=sentence)
