"""Rehearses a plan: runs it on the simulated rig, and reports extremes, margins, and limits that would end the plan."""

from collections.abc import Callable, Sequence
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
from msgspec.structs import replace

from astb.operators import with_hand
from astb.rehearsal.envelope import Extreme, envelope, step_at
from astb.rehearsal.watch import Closest, LimitWatch, Trip
from astb.rig_file import RigFile, Simulation
from astb.rig_limits import KnownLimit, known_limits
from astb.run import describe, new_directory, undisturbed
from astb.session import build_rig, describe_rig, virtual_session, wiring_of
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_protocol.words import LimitKind
from bench_records.disk import kept
from bench_records.record import read
from bench_records.result import Outcome, Result
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.limit_table import ACTIONS
from bench_sim.rig.limits import LimitAction
from test_plans.execution import execute

if TYPE_CHECKING:
    from bench_sim.rig.rig import Rig
    from test_plans.operator import Operator
    from test_plans.plan import Plan
    from test_plans.run import Watcher
    from test_plans.specimen import Specimen

REHEARSAL: Final = "rehearsal.json"
#: kg in a cubic metre of dry air at 0 °C and 101 325 Pa (DIN 1343).
_NORMAL_DENSITY: Final = 1.2922
#: Signals that plans use: if a real rig lacks some of them, the simulated one lacks them too.
_ASKED: Final = (Kind.MEASUREMENT, Kind.SETPOINT, Kind.SETTING)
_PLACES: Final = (LimitKind.LOWER, LimitKind.UPPER)
#: Signals that only our wires have, and that no plan needs.
_OUR_WIRES: Final = ("control.", "lease.")


class LimitMargin(msgspec.Struct, frozen=True):
    """The smallest margin of a plan to one limit.

    Values are SI, in the quantity that the limit judges, such as a rate.
    """

    signal: str
    kind: str
    at: float
    judged: float | None  #: the largest value that lasted as long as the limit requires; None: there was none
    margin: float | None
    used: float  #: fraction of the distance from the first reading to the limit: 1 is at the limit
    time: float  #: s since the run began
    step: str
    action: str
    source: str
    limit: str  #: in words
    closest: str
    began: str = ""  #: first reading, as text; "" for a quantity without a position


class Refusal(msgspec.Struct, frozen=True):
    """The limit that would trip first and end the plan."""

    step: str
    signal: str
    kind: str
    judged: float  #: SI
    at: float
    time: float  #: s since the run began
    words: str


class Rehearsal(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a rehearsal; limits are sorted by remaining margin, the smallest first."""

    plan: str
    title: str
    rig: str
    model: str
    parameters: dict[str, str]
    refusal: Refusal | None
    limits: list[LimitMargin]
    envelope: list[Extreme]
    indicated: list[str]  #: limits that would trip and only report it
    duration: float  #: s
    air: float  #: m³ at 0 °C and 1013 mbar that the springs took in
    verdict: Outcome  #: of the plan on the simulated spring
    reason: str
    notes: list[str] = []  #: notes on the rehearsed rig for the reader

    def write(self, directory: Path) -> Path:
        """Write ``rehearsal.json`` into ``directory``. Raises RecordError for a disk that fails."""
        path = directory / REHEARSAL
        with kept(path):
            path.write_bytes(msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n")
        return path


def rehearse(
    plan: "Plan",
    rig: RigFile,
    path: Path,
    out: Path,
    *,
    simulation: Simulation | None = None,
    seed: int | None = None,
    specimen: "Specimen | None" = None,
    operator: "Operator | None" = None,
    watcher: "Watcher | None" = None,
    begin: Callable[[dict[str, Any]], None] = lambda meta: None,
    prepare: Callable[["Rig"], None] = lambda rig: None,
    notes: Sequence[str] = (),
) -> tuple[Rehearsal, Path]:
    """Run ``plan`` in virtual time on the simulation of ``rig``; return the result, and the directory of its record.

    The default of ``simulation`` is that of `simulation_of`; the limits are those of ``rig`` in any case. Signals that
    the wiring of a real rig lacks are missing on the simulated one, too. ``begin`` receives the metadata of the record;
    ``prepare`` receives the simulated rig before it runs, and ``notes`` describe this change. Raises ValueError for an
    invalid limit or parameter, WiringError for an invalid wiring, RecordError for a directory that cannot be written.
    """
    limits, absent = known_limits(rig), _lacking(rig, path)
    simulation = simulation or simulation_of(rig)
    simulated = build_rig(simulation, seed)
    prepare(simulated)
    watch = LimitWatch(simulated, [one.limit for one in limits])
    directory = new_directory(out, f"{plan.name}-rehearsal")
    with virtual_session(simulated, simulation, seed, watch.run, absent) as session:
        describe_rig(session.bench, rig, path)
        session.bench.connect()
        meta = describe(session, replace(rig, simulation=simulation)) | {"rehearsal": True}
        if notes:
            meta["otherwise"] = list(notes)
        begin(meta)
        with undisturbed():
            result = execute(
                plan,
                session.bench,
                directory,
                meta=meta,
                rig=rig.name,
                seed=session.seed,
                watcher=watcher,
                specimen=specimen,
                operator=with_hand(operator, session.bench.hand),
            )
    model = session.parameters.name if session.parameters else ""
    found = _conclude(plan, rig.name, model, limits, watch, result, directory)
    found = replace(found, notes=[*notes, *_notes(rig, model, limits, absent)])
    found.write(directory)
    return found, directory


def _conclude(
    plan: "Plan",
    rig: str,
    model: str,
    limits: list[KnownLimit],
    watch: LimitWatch,
    result: Result,
    directory: Path,
) -> Rehearsal:
    """Return the rehearsal from the judged limits, the result of the plan, and the record in ``directory``."""
    record = read(directory)

    def seconds(tick: int) -> float:
        return (tick * TICK_NS - record.start_ns) / NS

    over = watch.over
    return Rehearsal(
        plan=plan.name,
        title=result.title,
        rig=rig,
        model=model,
        parameters=result.parameters,
        refusal=_refusal(limits, over, result, seconds) if over else None,
        limits=_margins(limits, watch.closest(), result, seconds),
        envelope=envelope(record, result.phases, seconds(over.tick) if over else float("inf")),
        indicated=[
            f"{limits[trip.row].limit.trip_message(trip.judged)} at {seconds(trip.tick):.2f} s"
            for trip in watch.trips
            if limits[trip.row].limit.action is LimitAction.INDICATE
        ],
        duration=result.duration,
        air=watch.air / _NORMAL_DENSITY,
        verdict=result.verdict,
        reason=result.reason,
    )


def simulation_of(rig: RigFile) -> Simulation:
    """Return the simulation of ``rig``: that of its file, or the default simulation with the limits of a real rig."""
    return rig.simulation or Simulation(limits=rig.limits)


def _lacking(rig: RigFile, path: Path) -> dict[str, str]:
    """Return the signals that plans use and ``rig`` does not have, with the reasons."""
    if not rig.wiring:
        return {}
    absent = wiring_of(rig, path).absent
    return {
        name: why
        for name, why in absent.items()
        if TABLE[name].kind in _ASKED and not name.startswith(_OUR_WIRES)
    }


def _notes(rig: RigFile, model: str, limits: list[KnownLimit], absent: dict[str, str]) -> list[str]:
    if rig.simulation is not None:
        return []
    assumed = sum(one.source == "assumed" for one in limits)
    notes = [f"{rig.name} is a real rig; the rehearsal simulates it with the parameter set {model}"]
    if assumed:
        notes.append(
            f"{assumed} of {len(limits)} limits are assumed; state them under [[limits]] in the rig file"
        )
    if absent:
        notes.append(f"like the real rig, the simulated rig has no {', '.join(absent)}")
    return notes


def _refusal(
    limits: list[KnownLimit], trip: Trip, result: Result, seconds: Callable[[int], float]
) -> Refusal:
    limit, time = limits[trip.row].limit, seconds(trip.tick)
    kind = limit.kind.name.lower()
    step = step_at(result.phases, time)
    return Refusal(step, limit.signal, kind, trip.judged, limit.at, time, limit.trip_message(trip.judged))


def _margins(
    limits: list[KnownLimit], closest: list[Closest], result: Result, seconds: Callable[[int], float]
) -> list[LimitMargin]:
    rows = []
    for (limit, source), near in zip(limits, closest, strict=True):
        if limit.action is LimitAction.NONE:
            continue
        sense = -1.0 if limit.kind is LimitKind.LOWER else 1.0
        way, gone = sense * (limit.at - near.rest), sense * (near.judged - near.rest)
        margin = sense * (limit.at - near.judged)
        used = gone / way if way > 0.0 else nan
        time = seconds(near.tick)
        rows.append(
            LimitMargin(
                signal=limit.signal,
                kind=limit.kind.name.lower(),
                at=limit.at,
                judged=None if isnan(near.judged) else near.judged,
                margin=None if isnan(margin) else margin,
                used=0.0 if isnan(near.judged) else 1.0 if isnan(used) else max(used, 0.0),
                time=time,
                step=step_at(result.phases, time),
                action=ACTIONS[limit.action],
                source=source,
                limit=_in_display_unit(limit.signal, limit.kind, limit.at),
                closest="" if isnan(near.judged) else _in_display_unit(limit.signal, limit.kind, near.judged),
                began=_in_display_unit(limit.signal, limit.kind, near.rest)
                if limit.kind in _PLACES and not isnan(near.rest)
                else "",
            )
        )
    return sorted(rows, key=lambda row: -row.used)


def _in_display_unit(signal: str, kind: LimitKind, value: float) -> str:
    """Return the quantity of a limit of this kind as text: a value, its rate, a time, a number."""
    if kind is LimitKind.TIMEOUT:
        return f"{value * 1e3:.0f} ms"
    if kind is LimitKind.COUNT:
        return f"{value:g}"
    number, _, unit = TABLE[signal].show(value).partition(" ")
    return f"{float(number):.4g} {unit}" + ("/s" if kind is LimitKind.RATE else "")
