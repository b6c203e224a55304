"""Reads records of the bench as measured runs: every phase of a plan with a name ``replay …`` is one run.

A plan that applies wind and track at once gives one run, too. That run begins before the unequal preload, because the
replay must include the roll by this preload.

Phases inside of a run: samples up to the end of ``condition …`` are not scored, because this motion removes the
rubber's memory of earlier motions. In ``rest`` nothing moves. The state of the valves follows from the settings in the
events of the record.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening

from bench_protocol.rates import FAST_RATE, TICK
from bench_protocol.words import AIR_MODES, PIPE_LENGTH, SIDES
from bench_records.layout import Phase
from bench_records.record import Record, read
from bench_sim.model.actuator import actuator_sense
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, Channel, DataQuality, Dataset, DiagnosisError, Experiment, MeasuredRun
from diagnosis.systems.air_spring.gas import GAS
from diagnosis.systems.air_spring.history import Past, remembered_loads, remembered_places
from diagnosis.systems.air_spring.simulator import OUTPUTS, AirSpring
from diagnosis.systems.counted import at_its_steps, coarse, undetermined_forces, while_it_moves
from diagnosis.systems.motion import (
    BESIDE,
    LEAST,
    SENSORS,
    give,
    motion_inputs,
    sensor_noise,
    smooth,
    sudden,
)
from diagnosis.systems.twice_rounded import TwiceRounded, rounded_to, twice_rounded

REPLAY: Final = "replay "
#: The phase in which wind, track and roll act at once. It begins with a rest, as the stretches of a programme do.
COMBINED: Final = "wind and track"
#: The direction of the platform that shows the cycles of the track.
PLATFORM: Final = "platform.lateral"
#: The phase before it, in which the air is shut in and nothing moves yet.
FREED: Final = "free the bolster"
CONDITION: Final = "condition"
REST: Final = "rest"
#: Sampling interval of signals on CAN at their full rate.
STEP: Final = 1.0 / FAST_RATE
#: Longest gap of an accelerometer, in samples, that can be bridged.
_BRIDGED: Final = 2
#: For plans that are not programmes: the start of the names of phases with vertical motion of the springs.
_VERTICAL: Final = "vertical "
#: Time (s) of the first rest that gives the state at the start of a run.
_FIRST: Final = 1.0


def read_records(directories: Sequence[Path], simulator: AirSpring) -> Dataset:
    """Return every run in the records of these directories, see `dataset_of`. Raises RecordError for a directory
    without a record.
    """
    return dataset_of(directories, [read(directory) for directory in directories], simulator)


def dataset_of(directories: Sequence[Path], records: Sequence[Record], simulator: AirSpring) -> Dataset:
    """Return every run in ``records``, in SI on the grid of their samples. All runs have the role ``fit``.

    ``directories`` are those of the records. Vertical sines of other plans, such as `aw0`, are in ``beside``. Raises
    DiagnosisError if a record has nothing to replay.
    """
    digest = hashlib.sha256()
    runs: list[tuple[Path, MeasuredRun]] = []
    beside: list[MeasuredRun] = []
    channels = _as_read(simulator.channels, records)
    for directory, record in zip(directories, records, strict=True):
        digest.update(record.path.read_bytes())
        twice = _twice_rounded(record, simulator)
        found = [_run(record, phase, simulator, channels, twice) for phase in _phases(record)]
        if not found and (sines := _sines(record)) is not None:
            beside.append(_run(record, sines, simulator, channels, twice))
        elif not found:
            raise DiagnosisError(
                f"{directory} holds no phase whose name begins with {REPLAY!r}, so it cannot be replayed; use a "
                "record of the plan `screening`, `identification` or `crosswind_and_track_aw0` (or `_aw3`)"
            )
        runs += [(Path(directory), run) for run in found]
    if not runs:
        raise DiagnosisError(
            f"{directories[0]} holds sines of a plan, but no record holds runs for the fit of the model; add a record "
            "of the plan `screening`"
        )
    rows = [row for record in records for row in record.meta.get("reading", {}).get("quality", [])]
    quality = tuple(DataQuality(**row) for row in rows)  # of imported files
    return Dataset(
        channels,
        tuple(_with_unique_names(runs)),
        digest.hexdigest(),
        tuple(str(directory) for directory in directories),
        doubts=tuple(
            f"{row.file}, {row.column}: {row.found}; {row.consequence}" for row in quality if row.doubt
        ),
        quality=quality,
        beside=tuple(beside),
    )


def run_between(
    record: Record,
    start: float,
    end: float,
    simulator: AirSpring,
    *,
    counts_from: float | None = None,
    gas: Mapping[str, float] | None = None,
) -> tuple[tuple[Channel, ...], MeasuredRun]:
    """Return the part of a record between two times (s) as a run, and its channels with the resolution of the readings.

    Phases need no special name, and conditioning motions count too. The part must begin at rest, unless the ``gas`` is
    given (readings by signal, SI). Readings count from ``counts_from`` s on. Raises DiagnosisError if the part cannot
    be replayed.
    """
    channels = _as_read(simulator.channels, [record])
    stretch = Phase(f"{start:.1f} to {end:.1f} s", start, end)
    twice = _twice_rounded(record, simulator)
    conditioned = start if counts_from is None else counts_from
    return channels, _run(record, stretch, simulator, channels, twice, conditioned=conditioned, gas=gas)


def _phases(record: Record) -> Iterable[Phase]:
    for phase in record.phases:
        if phase.name.startswith(REPLAY):
            yield phase
        elif phase.name == COMBINED and PLATFORM in record.signals:
            before = [p.start for p in record.phases if p.name == FREED and p.end <= phase.start]
            yield Phase(COMBINED, max(before, default=phase.start), phase.end)


def _sines(record: Record) -> Phase | None:
    """Return the part of a plan with vertical sines of known frequency; None if there are none.

    It begins with the rest before the first vertical motion.
    """
    phases = [phase for phase in record.phases if phase.name.startswith(_VERTICAL)]
    sines = [phase for phase in phases if phase.name.startswith(f"{_VERTICAL}sine ")]
    if not sines:
        return None
    return Phase(f"{record.meta.get('plan', 'a plan')} sines", phases[0].start - _FIRST, sines[-1].end)


def _with_unique_names(runs: Sequence[tuple[Path, MeasuredRun]]) -> Iterable[MeasuredRun]:
    """Yield the runs with unique names: the path of the record is added if several runs have the same name."""
    count = Counter(run.experiment.name for _, run in runs)
    for directory, run in runs:
        name = run.experiment.name
        if count[name] > 1:
            experiment = replace(run.experiment, name=f"{name} ({directory})")
            yield replace(run, experiment=experiment)
        else:
            yield run


def _as_read(channels: Sequence[Channel], records: Sequence[Record]) -> tuple[Channel, ...]:
    """Return the channels, with the resolution of the readings if it is coarser than that of the data sheet.

    If a converter has fewer bits than assumed, only the smallest difference between readings shows it.
    """
    found = []
    for channel in channels:
        steps = [
            rounded_to(record.series(channel.name)[1]) for record in records if channel.name in record.signals
        ]
        step = min((step for step in steps if step > 0.0), default=0.0)
        as_read = replace(channel, resolution=step)
        found.append(as_read if coarse(as_read) and step > 1.5 * channel.resolution else channel)
    return tuple(found)


def _twice_rounded(record: Record, simulator: AirSpring) -> dict[str, TwiceRounded]:
    """Return the channels that are rounded twice: by their converter, and again to another grid by the bus."""
    found = {}
    for channel in simulator.channels:
        converter = float(simulator.parameters.record.sensor_resolution[OUTPUTS[channel.name]])
        if channel.name in record.signals and converter < channel.resolution:
            _, readings = record.series(channel.name)
            if (one := twice_rounded(readings, converter, channel.noise)) is not None:
                found[channel.name] = one
    return found


def _run(
    record: Record,
    phase: Phase,
    simulator: AirSpring,
    channels: Sequence[Channel],
    twice: Mapping[str, TwiceRounded],
    *,
    conditioned: float | None = None,
    gas: Mapping[str, float] | None = None,
) -> MeasuredRun:
    grid = _grid(record, phase)
    measured = {name: _sampled(record, name, grid) for name in (*SENSORS, *BESIDE)}
    measured = {name: values for name, values in measured.items() if np.isfinite(values).any()}
    for side in SIDES:
        if f"{side}.height" not in measured:
            raise DiagnosisError(
                f"{record.path}: no sample of {side}.height in {phase.name!r}; use another record"
            )
    settings = SettingsOfRecord(record)
    combined = phase.name == COMBINED
    inputs = motion_inputs(measured, STEP, simulator.parameters, free=combined) | settings.valves(grid)
    outputs = _outputs(record, grid, inputs, simulator, channels, twice)
    _without_frame_dampers(outputs, record, grid, settings, simulator)
    if combined:
        _without_history(outputs, channels, inputs[PLATFORM])
    inputs["supply.pressure"] = _interpolated(_sampled(record, "supply.pressure", grid), simulator.parameters)
    inside = [p for p in record.phases if phase.start <= p.start and p.end <= phase.end and p is not phase]
    if conditioned is None:
        conditioned = max((p.end for p in inside if p.name.startswith(CONDITION)), default=phase.start)
    rest = np.zeros(len(grid), np.bool_)
    for p in inside:
        if p.name == (FREED if combined else REST):
            rest |= (grid >= p.start) & (grid < p.end)
    on = _switched_on(record, grid[0])
    past = Past(record, grid[0], on)
    experiment = Experiment(
        phase.name.removeprefix(REPLAY),
        grid - grid[0],
        inputs,
        {
            "start": on,
            **remembered_loads(past, simulator.parameters),
            **remembered_places(past, simulator.parameters, settings.preload),
            **settings.constants(grid[0]),
            **(gas or _beginning(record, grid, rest, simulator.parameters)),
        },
        phase.duration / 60.0,
    )
    return MeasuredRun(experiment, outputs, (grid >= conditioned) & settings.predictable(grid), rest)


def _outputs(
    record: Record,
    grid: Array,
    inputs: Mapping[str, Array],
    simulator: AirSpring,
    channels: Sequence[Channel],
    twice: Mapping[str, TwiceRounded],
) -> Array:
    """Return the readings of the channels (n, c). Actuator forces are NaN where the acceleration of the bolster is not
    known well enough.
    """
    par = simulator.parameters.record
    outputs = np.column_stack([_sampled(record, channel.name, grid) for channel in simulator.channels])
    unknown = undetermined_forces(inputs, par, _lateral_acceleration_is_unknown(record, grid, inputs, par))
    for k, (channel, believed) in enumerate(zip(channels, simulator.channels, strict=True)):
        if channel.name in unknown:
            outputs[unknown[channel.name], k] = np.nan
        if channel.name in twice:
            outputs[:, k] = twice[channel.name].rounded_once(outputs[:, k])
        if coarse(believed):
            outputs[:, k] = at_its_steps(outputs[:, k])
        elif channel.resolution > believed.resolution:
            outputs[:, k] = while_it_moves(outputs[:, k], channel.resolution)
    return outputs


def _without_frame_dampers(
    outputs: Array, record: Record, grid: Array, settings: SettingsOfRecord, simulator: AirSpring
) -> None:
    """Correct, in place, the readings in ``outputs`` (n, channels) of vertical pistons in displacement control to those
    of a replay. In a replay their frames have only the stiffness k and deflect by F/k; the real ones also have damping
    c.

    With c, 20 kN at 12.5 Hz deflect the frame by an additional 8 µm, a quarter of a wave later.
    """
    par = simulator.parameters.record
    held = settings.where("vertical.control", "displacement", grid)
    places = {channel.name: k for k, channel in enumerate(simulator.channels)}
    for j, actuator in enumerate(("vertical_left", "vertical_right")):
        force = _sampled(record, f"{actuator}.force", grid)
        if f"{actuator}.displacement" not in places or np.isfinite(force).sum() < LEAST:
            continue
        known = smooth(force, sensor_noise(f"{actuator}.force", par))
        late = give(known, j, par, STEP) - known / float(par.frame_stiffness[j])
        outputs[:, places[f"{actuator}.displacement"]] -= actuator_sense(j) * held * late


def _without_history(outputs: Array, channels: Sequence[Channel], platform: Array) -> None:
    """Set to NaN the readings (n, c) that the measured motion of a free bolster does not determine.

    Pressures and temperatures are used from the start of the track. Before it, while the preload rolls the bolster,
    thermometers deviate by 15 times their noise. Forces are used in the second half of the track. Before it, friction
    still depends on earlier motions. After it, the wind falls, and micrometres decide whether small oscillations
    reverse the motion and the friction. Displacements of the pistons are not used: they are computed from the measured
    motion, whose smoothed noise is coloured and a third of the noise of these channels.
    """
    away = np.abs(platform - platform[0])
    far = away > 0.5 * away.max()
    cycle = np.cumsum(np.diff(far, prepend=False) & far)
    periodic = (cycle > 0.5 * cycle[-1]) & (np.cumsum(far[::-1])[::-1] > 0)
    for k, channel in enumerate(channels):
        if channel.kind == "displacement":
            outputs[:, k] = np.nan
        else:
            outputs[~periodic if channel.kind == "force" else cycle == 0, k] = np.nan


def _lateral_acceleration_is_unknown(
    record: Record, grid: Array, inputs: Mapping[str, Array], par: Any
) -> NDArray[np.bool_] | None:
    """Return a mask (n,): True where the accelerometer does not show the acceleration of the bolster. None if it never
    shows it.

    The acceleration is unknown in gaps. An accelerometer that reads only noise may have failed while the bolster moves.
    """
    name = "lateral.acceleration"
    if name not in inputs:
        return None
    noise = sensor_noise(name, par)
    if np.ptp(inputs[name]) < noise:
        return None
    gaps = binary_opening(np.isnan(_sampled(record, name, grid)), np.ones(_BRIDGED + 1))
    return np.asarray(sudden(inputs[name], noise) | gaps)


def _grid(record: Record, phase: Phase) -> Array:
    """Return equidistant times (n,) of the samples of a phase, without the jitter of their time stamps."""
    times, _ = record.series("left.height")
    times = times[(times >= phase.start) & (times < phase.end)]
    if len(times) < 2:
        raise DiagnosisError(f"{record.path}: no samples in {phase.name!r}; use another record")
    # Stamps modulo the interval as directions on a circle: their mean does not depend on where the circle begins.
    turn = np.angle(np.mean(np.exp(2j * np.pi * times / STEP))) / (2.0 * np.pi) * STEP
    first, last = (round((time - turn) / STEP) for time in (times[0], times[-1]))
    return turn + STEP * np.arange(first, last + 1)


def _switched_on(record: Record, time: float) -> float:
    """Return how long (s) the bench had been switched on at a ``time`` of the record (s), from its tick counter."""
    times, ticks = record.series("rig.tick") if "rig.tick" in record.signals else (np.empty(0), np.empty(0))
    return time + (float(np.median(ticks * TICK - times)) if len(times) else 0.0)


def _sampled(record: Record, name: str, grid: Array) -> Array:
    """Return the samples of a signal on the grid (n,); NaN at times without a sample."""
    result = np.full(len(grid), np.nan)
    if name in record.signals:
        times, values = record.series(name)
        place = np.rint((times - grid[0]) / STEP).astype(np.int64)
        inside = (place >= 0) & (place < len(grid))
        result[place[inside]] = values[inside]
    return result


def _interpolated(values: Array, parameters: Parameters) -> Array:
    """Return a slow signal (n,), interpolated between its samples. If it has none, return the supply pressure of the
    parameter set.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(values), float(parameters.record.supply_pressure))
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])


def _beginning(
    record: Record, grid: Array, rest: NDArray[np.bool_], parameters: Parameters
) -> dict[str, float]:
    """Return pressures and temperatures of the gas at the first sample, from readings in the first rest.

    The gas may still cool, so a line through the readings is extrapolated back to the start. The lag of the sensor is
    corrected.
    """
    still = int(np.argmin(rest)) if rest[0] and not rest.all() else len(grid)
    first = slice(0, max(min(still, round(_FIRST / STEP)), 2))
    found = {}
    for name in GAS:
        values = _sampled(record, name, grid)[first]
        known = np.isfinite(values)
        if known.sum() >= 2:
            line = np.polynomial.Polynomial.fit(STEP * np.flatnonzero(known), values[known], 1)
            found[name] = float(line(float(parameters.record.sensor_lag[sensor_of(name)])))
        elif known.any():
            found[name] = float(values[known][0])
    return found


class SettingsOfRecord:
    """The settings of a record, each with the times of its changes."""

    def __init__(self, record: Record) -> None:
        self._changes: dict[str, list[tuple[float, Any]]] = {}
        for event in record.events:
            if event.kind == "setting":
                for name, value in event.data.items():
                    self._changes.setdefault(name, []).append((record.time_of(event), value))

    def _setting_at_times(self, name: str, grid: Array, default: Any) -> list[Any]:
        """Return the value of a setting at each time of the grid."""
        changes = self._changes.get(name, [])
        times = np.array([time for time, _ in changes])
        values = [default, *(value for _, value in changes)]
        return [values[k] for k in np.searchsorted(times, grid, side="right")]

    def where(self, name: str, word: str, grid: Array, default: Any = None) -> Array:
        """Return an array (n,): 1 where a setting has the value ``word``, else 0. ``default`` is its value before the
        first change.
        """
        return np.array([float(value == word) for value in self._setting_at_times(name, grid, default)])

    def valves(self, grid: Array) -> dict[str, Array]:
        """Return the valve inputs of `AirSpring` (n,), which state whether each valve is open."""
        return {
            **{f"{side}.leveling": self.where(f"air.{side}_mode", "level", grid) for side in SIDES},
            **{f"{side}.reservoir": self.where(f"air.{side}_reservoir", "on", grid, "on") for side in SIDES},
            "dpv": self.where("air.dpv", "on", grid, "on"),
        }

    def preload(self, times: Array) -> Array:
        """Return the load (N per spring) of the shims at each time (n,); 0 if not recorded.

        The first recorded value also applies before its time.
        """
        name = "rig.nominal_preload"
        first = self._changes.get(name, [(0.0, 0.0)])[0][1]
        return np.array(self._setting_at_times(name, times, first), np.float64)

    def constants(self, time: float) -> dict[str, float]:
        """Return the settings that are constant in a run, at a ``time`` (s): its preload and the installed parts."""

        def at(name: str) -> Any:
            return self._setting_at_times(name, np.array([time]), None)[0]

        found = {}
        if (preload := at("rig.nominal_preload")) is not None:
            found["nominal_preload"] = float(preload)
        if (bore := at("rig.orifice_diameter")) is not None:
            found["orifice_diameter"] = float(bore)
        if at("rig.pipe") == "on":
            found["pipe_length"] = PIPE_LENGTH
        return found

    def predictable(self, grid: Array) -> NDArray[np.bool_]:
        """Return a mask (n,): True up to the first sample at which the mass of air becomes unknown."""
        known: NDArray[np.bool_] = np.logical_and.accumulate(self.air_known(grid))
        return known

    def air_known(self, grid: Array) -> NDArray[np.bool_]:
        """Return a mask (n,): True where no service valve is open. The bus does not report how far these valves
        open.
        """
        unknown = np.zeros(len(grid), np.bool_)
        for side in SIDES:
            unknown |= np.isin(self._setting_at_times(f"air.{side}_mode", grid, "hold"), AIR_MODES[2:])
        return ~unknown
