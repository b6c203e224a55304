"""The paper's experiments on the virtual bench: running their plans, and reading the results of several rigs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from astb.rig_file import RigFile, Simulation
from astb.run import connected, describe
from astb.session import build_rig, virtual_session
from astb_studies.paper import combined
from astb_studies.paper.sweeps.frequency import ALL_FREQUENCIES, DAMPING_FROM
from bench_protocol.arrays import Floats
from bench_protocol.units import mm, ms
from bench_protocol.words import SIDES
from bench_records.record import read
from bench_records.result import Outcome, Result, read_result
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from test_plans.analysis import HEIGHTS, VERTICAL_CELLS, first_harmonic
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.steps.waves import COUNT_LATE, LEAD

if TYPE_CHECKING:
    from bench_records.record import Record


#: The plans of figures 6 to 11, the longest first, and the one that moves the platform as a track would (figure 5).
PLANS: Final = (
    "lateral_offset",
    "lateral_pressure_aw3",
    "damping_ratio",
    "frequency_sweep_aw3",
    "frequency_sweep_aw0",
    "lateral_pressure_aw0",
    "roll_angle_aw0",
    "roll_angle_aw3",
    "aw0",
)
#: The plan whose record is identified, on the first rig.
IDENTIFICATION: Final = "identification"

#: Of samples on CAN (s): whole cycles take one more.
PERIOD: Final = 5 * ms
#: The phase of plan ``aw0`` in which the platform follows the paper's equation (24).
TRACK_PHASE: Final = "unilateral cosine"


class NoBenchResult(RuntimeError):
    """A plan was blocked, or its result lacks a curve that a figure needs; the text names both."""


def directory_of(out: Path, plan: str, seed: int) -> Path:
    """Return the folder of the record of one plan on one rig."""
    return out / "bench" / f"{plan}-{seed}"


def measure(
    plan: str,
    seed: int,
    out: Path,
    name: str = "",
    given: Mapping[str, str] = MappingProxyType({}),
    parameters: str = "astb",
) -> None:
    """Run one plan in virtual time on its own rig and leave record and result below ``out``.

    ``given`` are parameters of the plan as text, and ``name`` is the name of the run. ``parameters``
    name the set of the rig, or a file of them.
    """
    simulation = Simulation(parameters=parameters, seed=seed)
    rig = RigFile(name="virtual", time="virtual", simulation=simulation)
    with virtual_session(build_rig(simulation), simulation) as session, connected(session):
        execute(
            plans()[plan].given(given),
            session.bench,
            directory_of(out, name or plan, seed),
            meta=describe(session, rig),
            rig=rig.name,
            seed=seed,
        )


@dataclass(frozen=True, slots=True)
class Points:
    """A curve (SI): mean over the rigs, and the lowest and the highest of them at each point."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats

    def __getitem__(self, which: npt.NDArray[np.bool_]) -> "Points":
        return Points(self.x[which], self.y[which], self.low[which], self.high[which])


@dataclass(frozen=True, slots=True)
class Harmonics:
    """First harmonics of one vertical sine of ``frequency`` (Hz), means of both springs: height, force, pressure."""

    frequency: float
    height: complex
    force: complex
    pressure: complex


@dataclass(frozen=True, slots=True)
class BenchResults:
    """The results of the plans, one for each rig."""

    results: Mapping[str, Sequence[Result]]
    pressures: Mapping[
        str, Sequence[tuple[str, float]]
    ]  #: of the first rig: phase, mean gauge pressure (Pa) in it
    track: tuple[Floats, Floats]  #: platform displacement (m) over time (s) while it followed the track
    combined: Mapping[str, Result] = field(default_factory=dict)  #: of the first rig, by `combined.name_of`
    rides: Mapping[str, Result] = field(default_factory=dict)  #: of the first rig, by `combined.ride_name`
    harmonics: Sequence[Harmonics] = ()  #: of the first rig's vertical sweep under AW0

    def points(self, plan: str, group: str, name: str, *, first: bool = False) -> Points:
        """Return one curve of a plan, of all rigs or of the ``first`` alone; NoBenchResult if it was not kept."""
        kept = []
        for result in self.results[plan][: 1 if first else None]:
            found = [one for one in result.curves if (one.group, one.name) == (group, name)]
            if not found:
                raise NoBenchResult(f"{plan} has no curve {name!r} of {group!r}")
            kept.append((found[0].xs, found[0].ys))
        xs, ys = (np.array([one[k] for one in kept], np.float64) for k in (0, 1))
        return Points(xs.mean(axis=0), ys.mean(axis=0), ys.min(axis=0), ys.max(axis=0))

    def lateral_stiffness(self, load: str, amplitude: float, *, first: bool = False) -> Points:
        """Return K′ (N/m) of one spring over gauge pressure (Pa), for one load case and amplitude (m)."""
        return self.points(
            f"lateral_pressure_{load.lower()}",
            f"Lateral stiffness K' per spring, {load}",
            f"{amplitude / mm:g} mm",
            first=first,
        )

    def at_once(self, load: str, over: str, check: str) -> Points:
        """Return a ``check`` in wind, track and roll at once, for one spring, ``over`` the varied quantity (SI).

        ``low`` and ``high`` of the points are the ends of the expanded uncertainty.
        """
        rows = []
        for given in combined.VARIED[over]:
            name = combined.name_of(load, given)
            # Also where the specimen states no limits for it.
            group = f"{check}, wind and track"
            one = next((one for one in self.combined[name].curves if one.group == group), None)
            if one is None or one.ys[0] is None or not one.expanded or one.expanded[0] is None:
                raise NoBenchResult(f"{name} measured no {check}")
            p = self.pressure(name, combined.PHASE)
            half, U = 0.5 * one.ys[0], 0.5 * one.expanded[0]
            rows.append((combined.place(over, given, p), half, half - U, half + U))
        return Points(*(np.array(column, np.float64) for column in zip(*rows, strict=True)))

    def loss_without_gas(self, area: float) -> Points:
        """Return K″ of F − p·A (N/m) over the frequency (Hz): the loss in which there is no gas."""
        f = np.array([one.frequency for one in self.harmonics])
        K = np.array([(one.pressure * area - one.force) / one.height for one in self.harmonics])
        return Points(f, K.imag, K.imag, K.imag)

    def pressure(self, plan: str, phase: str, skip: int = 0, count: int | None = None) -> float:
        """Return the mean gauge pressure (Pa) in the bellows over the phases so named, ``skip`` of them left out.

        After leveling, springs that are moved to design height have slightly less than the pressure of the load.
        """
        found = [p for name, p in self.pressures[plan] if name.startswith(phase)][skip:]
        if not found:
            raise NoBenchResult(f"{plan} has no phase {phase!r} number {skip}")
        return float(np.mean(found[:count]))


def gather(out: Path, seeds: Sequence[int], *, quick: bool) -> BenchResults:
    """Read the results of `measure`. Raises NoBenchResult, with the reason, if a plan was blocked."""
    results = {plan: [read_result(directory_of(out, plan, seed)) for seed in seeds] for plan in PLANS}
    at_once, rode = (
        {name: read_result(directory_of(out, name, seeds[0])) for name, *_ in cases}
        for cases in (combined.cases(), combined.rides(quick))
    )
    for plan, found in {**results, **{name: [one] for name, one in {**at_once, **rode}.items()}}.items():
        for result in found:
            if result.verdict is Outcome.BLOCKED:
                raise NoBenchResult(f"{plan} on rig {result.seed} was blocked: {result.reason}")
    records = {plan: read(directory_of(out, plan, seeds[0])) for plan in (*PLANS, *at_once)}
    track = records["aw0"]
    phase = next(one for one in track.phases if one.name == TRACK_PHASE)
    times, platform = track.series("platform.vertical")
    inside = (times >= phase.start) & (times <= phase.end)
    return BenchResults(
        results,
        {plan: _pressures(record) for plan, record in records.items()},
        (times[inside] - phase.start, platform[inside] - platform[inside][0]),
        at_once,
        rode,
        harmonics(records["frequency_sweep_aw0"]),
    )


def at_once_on_the_model(fitted: object, parameters: str, load: str) -> dict[str, Floats]:
    """Return gauge pressures (Pa) and K' of one spring (N/m) of `BenchResults.at_once` on a rig with ``parameters``.

    ``fitted``, which every job of the model gets, is in the file of the parameters, too.
    """
    names = {combined.name_of(load, given): given for given in combined.VARIED["pressure"]}
    with TemporaryDirectory(prefix="astb-at-once-") as directory:
        out = Path(directory)
        for name, given in names.items():
            measure(combined.plan_of(load), 0, out, name, given, parameters)
        pressures = {name: _pressures(read(directory_of(out, name, 0))) for name in names}
        results = {name: read_result(directory_of(out, name, 0)) for name in names}
    rig = BenchResults({}, pressures, (np.zeros(0), np.zeros(0)), results)
    found = rig.at_once(load, "pressure", combined.STIFFNESS)
    return {"p": found.x, "K": found.y}


def harmonics(record: "Record") -> list[Harmonics]:
    """Return the first harmonics of the vertical sines with the orifice plate, each without the lag of its sensor."""
    par = load("astb").record
    phases = [phase for phase in record.phases if phase.name.startswith("vertical sine")]
    found = []
    for phase, f in zip(phases, ALL_FREQUENCIES, strict=False):
        # Whole cycles that have swung in; the last one fades out.
        end = phase.end - COUNT_LATE - 1.0 / f
        begin = end - max(1, round((end - phase.start) * f) - max(1, ceil(LEAD * f))) / f - PERIOD

        def of(*names: str, f: float = f, begin: float = begin, end: float = end) -> complex:
            total = 0j
            for name in names:
                times, values = record.series(name)
                inside = (times >= begin) & (times < end)
                late = 1.0 + 2j * np.pi * f * float(par.sensor_lag[sensor_of(name)])
                total += 0.5 * first_harmonic(times[inside], values[inside], f) * late
            return total

        if f >= DAMPING_FROM:
            pressures = (f"{side}.bellows_pressure" for side in SIDES)
            found.append(Harmonics(f, of(*HEIGHTS), of(*VERTICAL_CELLS), of(*pressures)))
    return found


def _pressures(record: "Record") -> list[tuple[str, float]]:
    means = np.zeros(len(record.phases))
    for side in SIDES:
        times, values = record.series(f"{side}.bellows_pressure")
        edges = np.searchsorted(times, [(phase.start, phase.end) for phase in record.phases])
        sums = np.concatenate([[0.0], np.cumsum(values)])
        means += 0.5 * (sums[edges[:, 1]] - sums[edges[:, 0]]) / np.maximum(edges[:, 1] - edges[:, 0], 1)
    return [(phase.name, float(p)) for phase, p in zip(record.phases, means, strict=True)]
