"""Insertion points of faults: parts of a running rig that a fault can change. They are restored when the fault ends."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from bench_sim.model.layout import Input
from bench_sim.model.plant import Plant
from bench_sim.rig.can_bus import CanBus
from bench_sim.rig.faults.bus_stage import FaultStage, FrameFault
from bench_sim.rig.faults.in_tick import DISTURBANCE, DISTURBANCES_MAX, DisturbanceKind, FaultArrays
from bench_sim.rig.faults.modbus_filter import ModbusFilter
from bench_sim.rig.faults.schedule import Schedule, Undo
from bench_sim.rig.springs import ReplacementSprings

_DISTURBANCES, _INPUTS = 0, 1


class Breakable(Protocol):
    """The methods of a rig that faults of the whole rig use."""

    def press_estop(self) -> None: ...
    def release_estop(self) -> None: ...
    def cut_power(self) -> None: ...
    def power_on(self) -> None: ...
    def hold_program(self) -> None: ...
    def set_mains(self, *, there: bool) -> None:
        """Switch the mains power on or off. Without mains, valves and actuators have no power."""

    def stall(self, duration: int) -> None:
        """Delay the next tick by ``duration`` ns. This has an effect only in real time."""


class Wire(Protocol):
    """An interface of the rig whose connections can be cut."""

    def cut(self) -> None:
        """Close all connections and refuse new ones."""

    def restore(self) -> None:
        """Accept clients again."""


@dataclass(frozen=True)
class Wires:
    """The interfaces of the rig that faults can interrupt. ``can`` is None for a bus without connections."""

    bus: CanBus
    can: Wire | None
    modbus: Wire


class TickFaults:
    """Manages the faults of readings and plant inputs in a compiled tick."""

    def __init__(self, arrays: FaultArrays, controls: Any) -> None:
        self._arrays, self._controls = arrays, controls
        self._rows: list[npt.NDArray[np.void]] = []
        self._holds: list[dict[Input, float]] = []

    def disturb(
        self, sensor: int, kind: DisturbanceKind, value: float, *, chance: float = 0.0, seed: int = 0
    ) -> Undo:
        """Apply a fault to the reading of ``sensor`` from now on. Return a function that ends the fault.

        `DisturbanceKind` describes ``value`` and ``chance`` (per sample); ``seed`` selects the random numbers. Raises
        RuntimeError if too many readings have a fault.
        """
        if len(self._rows) == DISTURBANCES_MAX:
            raise RuntimeError(
                f"{DISTURBANCES_MAX} readings are disturbed already; switch off one of these faults first"
            )
        row = np.array([(sensor, kind, value, chance, self._controls["tick"], seed)], DISTURBANCE)
        self._save()
        self._rows.append(row)
        self._write()

        def undo() -> None:
            self._save()
            self._rows = [one for one in self._rows if one is not row]
            self._write()

        return undo

    def hold(self, values: Mapping[Input, float]) -> Undo:
        """Keep plant inputs at ``values``, whatever the controls command. Return a function that ends this.

        If several faults keep the same input, the latest applies.
        """
        held = dict(values)
        self._holds.append(held)
        self._write()

        def undo() -> None:
            self._holds = [one for one in self._holds if one is not held]
            self._write()

        return undo

    def _save(self) -> None:
        """Copy the disturbances back from the arrays of the tick, which has added the values of stuck readings."""
        for place, row in enumerate(self._rows):
            row[0] = self._arrays.disturbances[place]

    def _write(self) -> None:
        counts, disturbances, inputs = self._arrays
        for place, row in enumerate(self._rows):
            disturbances[place] = row[0]
        inputs[:] = math.nan
        for held in self._holds:
            for place, value in held.items():
                inputs[place] = value
        counts[_DISTURBANCES], counts[_INPUTS] = len(self._rows), len(self._holds)


class ParameterFaults:
    """The changes of plant parameters by active faults. After the last one ends, the old values are
    restored exactly.
    """

    def __init__(self, parameters: Any, owned: Collection[str] = ()) -> None:
        self._parameters, self._owned = parameters, owned
        self._sound: dict[str, npt.NDArray[np.float64]] = {}
        self._changes: list[tuple[tuple[str, ...], Callable[[Any], None]]] = []

    def change(self, names: tuple[str, ...], change: Callable[[Any], None]) -> Undo:
        """Change the parameters ``names`` by ``change(record)``. Return a function that ends the change.

        Raises RuntimeError for parameters of springs that an FMU computes.
        """
        self.own(names)
        entry = names, change
        self._rebuild([*self._changes, entry])

        def undo() -> None:
            self._rebuild([one for one in self._changes if one is not entry])

        return undo

    def own(self, names: Collection[str]) -> None:
        """Raise RuntimeError if any of these parameters belongs to springs that an FMU computes."""
        if owned := [name for name in names if name in self._owned]:
            raise RuntimeError(
                f"{', '.join(owned)}: an FMU computes the springs, so its own parameters apply; change "
                "them in spring_map.parameters"
            )

    def under(self, alter: Callable[[], None]) -> None:
        """Call ``alter()``, which changes the values without faults. Apply the faults to the new values afterwards."""
        changes = self._changes
        self._rebuild([])
        alter()
        self._rebuild(changes)

    def _rebuild(self, changes: list[tuple[tuple[str, ...], Callable[[Any], None]]]) -> None:
        par = self._parameters
        for name, sound in self._sound.items():
            par[name] = sound
        touched = {name for names, _ in changes for name in names}
        self._sound = {name: np.array(par[name]) for name in touched}
        self._changes = changes
        for _, change in changes:
            change(par)


class InsertionPoints:
    """All insertion points of a rig. The interfaces are connected last, and faults that began earlier apply from then
    on.
    """

    def __init__(
        self, rig: Breakable, plant: Plant, controls: Any, springs: ReplacementSprings | None = None
    ) -> None:
        self.rig: Final = rig
        self.schedule: Final = Schedule(controls)
        self.arrays: Final = FaultArrays.none()
        self.tick: Final = TickFaults(self.arrays, controls)
        self.parameters: Final = ParameterFaults(plant.parameters, springs.owned if springs else ())
        self.gas_constant: Final = float(plant.parameters.gas_constant)
        self.sensor_low: Final = plant.parameters.sensor_low.copy()
        self.sensor_high: Final = plant.parameters.sensor_high.copy()
        self.modbus: Final = ModbusFilter()
        self._stage: Final = FaultStage()
        self._wires: Wires | None = None
        self._cut: list[str] = []

    def connect(self, wires: Wires) -> None:
        """Connect the bus and the interfaces, and apply their active faults."""
        self._wires = wires
        if not self._stage.unused:
            wires.bus.add(self._stage)
        for name in dict.fromkeys(self._cut):
            self._act(name, cut=True)

    def on_bus(self, fault: FrameFault) -> Undo:
        """Apply ``fault`` to the frames of the bus. Return a function that ends the fault.

        The stage stays on the bus after the first fault, because its removal would have to wait for frames in
        progress.
        """
        fresh = self._stage.unused
        end = self._stage.add(fault)
        if fresh and self._wires:
            self._wires.bus.add(self._stage)
        return end

    def cut(self, name: str) -> Undo:
        """Close all connections of ``can`` or ``modbus``, and refuse new ones. Return a function that ends this."""
        self._cut.append(name)
        if self._cut.count(name) == 1:
            self._act(name, cut=True)

        def undo() -> None:
            self._cut.remove(name)
            if name not in self._cut:
                self._act(name, cut=False)

        return undo

    def _act(self, name: str, *, cut: bool) -> None:
        wires = self._wires
        wire = None if wires is None else wires.can if name == "can" else wires.modbus
        if wire is not None:
            (wire.cut if cut else wire.restore)()
