"""Repeats a recorded run of a simulated rig, and continues it with a change from an instant on.

A record has no states of rubber, gas, valves and controls. But a simulated rig in virtual time depends only on its
seed: the same plan on the same rig gives the same states, bit by bit. So the run is repeated from its beginning,
compared with the record up to that instant, and changed there. Its noise stays the same, so all differences come from
the change.
"""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from astb.rehearsal.otherwise import Otherwise, exact
from astb.rig_file import FaultEntry, Simulation
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_records.layout import RecordError
from bench_records.record import Record, read
from bench_records.result import Check, read_result
from bench_sim.parameters.loading import read_value
from test_plans.discovery import plans, unknown

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from test_plans.plan import Plan

#: End of the line before the list of deviations; the panel finds the list by it.
AFTER_THAT: Final = "; after that:"
#: Number of signals in the report, the earliest deviations first.
_TOLD: Final = 6
#: A reading deviates if the difference from its old value is larger than this number of its resolution steps.
_PARTED: Final = 3.0


class SignalDeviation(NamedTuple):
    """A signal with other values than before: first time (s), and the largest difference as text."""

    signal: str
    since: float
    words: str


class Changes(NamedTuple):
    """New settings from an instant on: faults with their parameters, effects by name, and model parameters by name."""

    faults: "Sequence[tuple[str, Mapping[str, str]]]"
    effects: "Mapping[str, str]"
    parameters: "Mapping[str, Any]"


class Past(NamedTuple):
    """A recorded run, the time (s) of the change, and the changes."""

    record: Record
    plan: "Plan"
    at: float
    changes: Changes

    @classmethod
    def named(cls, text: str, changes: Changes) -> "Past":
        """Return the run and the time in a text ``RUN@TIME``.

        Raises ValueError or RecordError, which state the correct form.
        """
        directory, mark, time = text.rpartition("@")
        if not mark:
            raise ValueError(f"--from {text}: write RUN@TIME, such as runs/aw0@70s")
        record = read(Path(directory))
        return cls(record, plan_of(record), read_value("time", time, "s"), changes)

    @property
    def seed(self) -> int:
        """The seed of the rig."""
        return int(self.record.meta["seed"])

    @property
    def begins(self) -> float:
        """The time of the rig (s) at which the change begins."""
        return self.at + self.record.start_ns / NS

    def again(self, simulation: Simulation) -> dict[str, Any]:
        """Return the arguments with which `rehearse` repeats and changes the run on the rig of a ``simulation``.

        Raises ParameterError for impossible changes.
        """
        changed = self._changed(simulation)
        otherwise = Otherwise.of(changed, self.seed, self.changes.effects, self.changes.parameters)
        return {
            "simulation": changed,
            "seed": self.seed,
            "prepare": partial(otherwise.begin, at=self.begins),
            "notes": self._notes(otherwise),
        }

    def _changed(self, simulation: Simulation) -> Simulation:
        """Return ``simulation`` with the effects of the recorded run, and with the new faults from the time of the
        change on.
        """
        if not 0.0 < self.at < self.record.duration:
            raise RecordError(
                f"{self.at:g} s is not within {self.record.path}; choose a time between 0 and "
                f"{self.record.duration:.1f} s"
            )
        begin = f"{self.begins:.3f} s"
        entries = [FaultEntry(name, values={**values}, at=begin) for name, values in self.changes.faults]
        own = exact(self.record.meta.get("parameters", {}).get("effects", {}))
        return replace(simulation, effects=own, faults=(*simulation.faults, *entries))

    def _notes(self, otherwise: Otherwise) -> list[str]:
        """Return the changes at that time as text; nothing if there are none."""
        broken = [
            " ".join((name, *(f"{k}={v}" for k, v in values.items()))) for name, values in self.changes.faults
        ]
        changes = [*otherwise.told, *broken]
        return (
            [f"{self.record.path.parent} continues from {self.at:g} s with {'; '.join(changes)}"]
            if changes
            else []
        )

    def report(self, directory: Path) -> list[str]:
        """Return a text that compares the repeated run in ``directory`` with the original one.

        Raises RecordError if they differ before the time of the change.
        """
        kept = self.record.path.parent
        found = deviating_signals(self.record, read(directory), self.at)
        lines = [
            f"{one.signal} deviates from {one.since:.2f} s on; largest deviation: {one.words}"
            for one in found
        ]
        lines += changed_checks(read_result(kept).checks, read_result(directory).checks)
        begin = f"  up to {self.at:g} s the run is identical with {kept}{AFTER_THAT}"
        return [begin, *(f"    {line}" for line in lines or ["no deviation from the original run"])]


def plan_of(record: Record) -> "Plan":
    """Return the plan of a recorded run with its parameters. Raises RecordError for a run that cannot be repeated."""
    meta = record.meta
    name = meta.get("plan", "")
    if meta.get("sealed_effects"):
        raise RecordError(
            f"{record.path}: the effects of its rig are sealed, so the run cannot be repeated; use another run"
        )
    if not meta.get("simulated") or meta.get("time") != "virtual":
        raise RecordError(
            f"{record.path} is not a run of a simulated rig in virtual time, so it cannot be repeated; "
            "use a run of `astb run --virtual`"
        )
    known = plans()
    if name not in known:
        raise RecordError(f"{record.path}: {unknown(name, 'give the folder with this plan')}")
    return known[name].given(meta.get("set", {}))


def deviating_signals(before: Record, now: Record, at: float) -> list[SignalDeviation]:
    """Return the measurements of the repeated run that deviate from the record after ``at`` s, the earliest first.

    Only the first six are returned. Raises RecordError if a signal deviates before ``at``, because then the rig is not
    the same.
    """
    found = []
    for name in sorted(set(before.signals) & set(now.signals)):
        (times, values), (again, anew) = before.series(name), now.series(name)
        early, same = times < at, again < at
        if not (
            np.array_equal(times[early], again[same])
            and np.array_equal(values[early], anew[same], equal_nan=True)
        ):
            raise RecordError(
                _not_the_same(before, name, times[early], values[early], again[same], anew[same])
            )
        if TABLE[name].kind is Kind.MEASUREMENT and (one := _deviation(name, before, now, at)):
            found.append(one)
    return sorted(found, key=lambda one: one.since)[:_TOLD]


def _deviation(name: str, before: Record, now: Record, at: float) -> SignalDeviation | None:
    (times, values), (again, anew) = before.series(name), now.series(name)
    if not len(times) or not (both := (again >= at) & (again <= times[-1])).any():
        return None
    was = np.interp(again[both], times, values)
    off = np.abs(anew[both] - was)
    beyond = np.flatnonzero(off > _PARTED * TABLE[name].step)
    if not len(beyond):
        return None
    most, reads = int(np.nanargmax(off)), TABLE[name].reads
    at_most = (
        f"{reads(float(anew[both][most]))} instead of {reads(float(was[most]))} at {again[both][most]:.1f} s"
    )
    return SignalDeviation(name, float(again[both][beyond[0]]), at_most)


def _not_the_same(record: Record, name: str, *series: "np.typing.NDArray[np.float64]") -> str:
    times, values, again, anew = series
    count = min(len(values), len(anew))
    differ = np.flatnonzero((values[:count] != anew[:count]) | (times[:count] != again[:count]))
    when = f"{times[differ[0]]:.3f} s" if len(differ) else f"{times[-1] if len(times) else 0.0:.3f} s"
    return (
        f"{record.path} cannot be reproduced with this rig and this software: {name} deviates from {when} on; give "
        "--rig, --model and --effect of that run, and use its commit "
        f"({record.meta.get('commit', 'unknown')})"
    )


def changed_checks(before: "Sequence[Check]", now: "Sequence[Check]") -> list[str]:
    """Return the checks with changed results, as text."""
    was = {one.name: str(one) for one in before}
    lines = [
        f"{one}  (before: {was[one.name]})" if one.name in was else f"{one}  (before: no such check)"
        for one in now
        if was.get(one.name) != str(one)
    ]
    return lines + [
        f"{name}: not judged  (before: {was[name]})" for name in was if name not in {one.name for one in now}
    ]
