"""The fault panel of a rig: it switches faults on and off, and lists the active ones with start and end."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from bench_protocol.rates import TICK
from bench_sim.rig.controls import Happened
from bench_sim.rig.faults.catalogue import find_fault
from bench_sim.rig.faults.fault import Fault, FaultError
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.schedule import Undo

#: More than this is a mistake, in s: a day.
LONGEST: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """A fault in a rig file. It begins ``at`` s of the rig's time, and lasts for ``lasting`` s or until the end of
    the run.
    """

    name: str
    values: Mapping[str, Any]
    at: float = 0.0
    lasting: float | None = None


@dataclass(frozen=True, slots=True)
class ActiveFault:
    """An active fault. Times are in s of the rig's time."""

    label: str
    fault: Fault
    given: Mapping[str, Any]
    since: float
    until: float | None
    undos: tuple[Undo, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the description of this active fault, for JSON."""
        return {
            "label": self.label,
            "name": self.fault.name,
            "values": dict(self.given),
            "since": self.since,
            "until": self.until,
        }


class FaultPanel:
    """Switches faults on and off at the insertion ``points`` of a rig. The caller must hold the rig's lock."""

    def __init__(self, points: InsertionPoints) -> None:
        self.points: Final = points
        self._on: dict[str, ActiveFault] = {}

    @property
    def time(self) -> float:
        """The rig's time in s."""
        return round(self.points.schedule.tick * TICK, 6)

    @property
    def active(self) -> tuple[ActiveFault, ...]:
        """The active faults, in the order in which they were switched on."""
        return tuple(self._on.values())

    def on(self, name: str, given: Mapping[str, Any], lasting: float | None = None) -> ActiveFault:
        """Switch a fault on, or replace it if it is active. It ends after ``lasting`` s. Without this time, the kind of
        fault decides whether it ends. ``given`` has texts with units by name of parameter. Return the active fault.

        Raises FaultError for an unknown fault or invalid values; then nothing changes. Also raises FaultError for a
        fault that this rig cannot have now; the fault that it replaces is then off.
        """
        fault = find_fault(name)
        values = fault.read(given)
        _check_time("for", lasting, TICK)
        label = fault.label(values)
        if label in self._on:
            self._undo(label)
        lasting = fault.lasts if lasting is None else lasting
        schedule = self.points.schedule
        undos: list[Undo] = []
        until = None
        try:
            undos.append(fault.begin(self.points, values))
        except RuntimeError as error:
            raise FaultError(f"{label}: {error}") from None
        if lasting is not None:
            end = schedule.tick + max(1, round(lasting / TICK))
            undos.append(schedule.at(end, lambda: self._undo(label)))
            until = round(end * TICK, 6)
        self._on[label] = active = ActiveFault(label, fault, given, self.time, until, tuple(undos))
        return active

    def off(self, name: str) -> list[str]:
        """Switch off the fault with this label, all faults of this name, or ``all``. Return the labels of these
        faults.

        Raises FaultError if there is no such fault, or if it is not on.
        """
        if name == "all":
            labels = list(self._on)
        else:
            labels = [label for label, one in self._on.items() if name in (label, one.fault.name)]
            if not labels:
                find_fault(name.partition(".")[0])
                now_on = f"these faults are on: {', '.join(self._on)}" if self._on else "no fault is on"
                raise FaultError(f"{name} is not on; {now_on}")
        for label in labels:
            self._undo(label)
        return labels

    def plan(self, planned: PlannedFault) -> None:
        """Switch a fault on at its time, or at once if the time has passed. Raises FaultError like `on`."""
        find_fault(planned.name).read(planned.values)
        _check_time("at", planned.at, 0.0)
        _check_time("for", planned.lasting, TICK)

        def begin() -> None:
            self.on(planned.name, planned.values, planned.lasting)

        tick = round(planned.at / TICK)
        if tick <= self.points.schedule.tick:
            begin()
        else:
            self.points.schedule.at(tick, begin)

    def decide(self, happened: Happened) -> None:
        """Switch on and off the faults whose time has come."""
        if Happened.FAULT in happened:
            self.points.schedule.run()

    def _undo(self, label: str) -> None:
        # A fault is undone in the reverse order of its steps; the undo of an expired step has no effect.
        for undo in reversed(self._on.pop(label).undos):
            undo()


def _check_time(name: str, value: float | None, least: float) -> None:
    if value is not None and not least <= value <= LONGEST:
        raise FaultError(f"{name} = {value:g} s is outside {least:g} to {LONGEST:g} s")
