"""A system that files of any origin can be mapped to: the signals and settings that it takes, and its simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol.units import UNITS
from diagnosis.contracts import Array, Channel, DiagnosisError, MeasuredRun, Simulator

#: What a channel measures, by its SI unit.
KINDS: Final = {"N": "force", "Pa": "pressure", "K": "temperature", "m": "displacement"}


@dataclass(frozen=True, slots=True)
class SystemSignal:
    """One measured quantity that a system can use: an input that drives it, or an output that it predicts."""

    name: str
    unit: str  #: SI
    title: str
    required: bool = True
    gauge: bool = False  #: of a pressure: what the system wants; a map says what the file holds
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0

    def channel(self, noise: float, resolution: float) -> Channel:
        """Return the output channel of this signal; ``noise`` and ``resolution`` in SI, 0: unknown."""
        kind = KINDS.get(self.unit, "")
        return Channel(self.name, self.unit, noise, resolution, kind, self.display, self.scale)


@dataclass(frozen=True, slots=True)
class SystemSetting:
    """A constant of the user's rig, such as the bore; without ``default`` (SI) the map must give it."""

    name: str
    unit: str  #: SI
    title: str
    low: float
    high: float
    default: float | None = None
    #: Whether the simulator takes it from the settings of each experiment, so that it may differ from file to file.
    per_file: bool = False


@dataclass(frozen=True, slots=True)
class System:
    """What can be diagnosed from mapped files: what it needs, and how its simulator and its inputs are made."""

    name: str
    title: str
    inputs: tuple[SystemSignal, ...]
    outputs: tuple[SystemSignal, ...]
    settings: tuple[SystemSetting, ...]
    #: (settings in SI, measured channels) -> the simulator of exactly these channels
    simulator: Callable[[Mapping[str, float], tuple[Channel, ...]], Simulator]
    #: (step in s, seconds since the start of the file (n,), inputs and outputs (n,) by name) -> inputs of the simulator
    prepare: Callable[[float, Array, Mapping[str, Array]], Mapping[str, Array]] = (
        lambda step, clock, measured: measured
    )
    #: the same arguments -> (n,) stretches without motion, which show the noise alone
    rest: Callable[[float, Array, Mapping[str, Array]], NDArray[np.bool_]] = lambda step, clock, measured: (
        np.zeros(len(clock), dtype=np.bool_)
    )
    #: what one record measured (n,) by name -> settings that only its runs have
    begin: Callable[[Mapping[str, Array]], Mapping[str, float]] = lambda measured: {}
    #: Whether the state at the start of a replay is soon forgotten, so that a run may be replayed from a little before
    #: it. Else all runs of a file are replayed from its start, which they share.
    forgets: bool = False
    #: Pairs (force, displacement) whose work ∮ F dx is not negative, whatever the system lacks.
    passive: tuple[tuple[str, str], ...] = ()
    #: (simulator, runs as the map reads them) -> the simulator with the sizes that its effects may have in these
    sized: Callable[[Simulator, Sequence[MeasuredRun]], Simulator] = lambda simulator, runs: simulator
    #: the same arguments -> sentences on what of the simulation itself cannot be right
    doubts: Callable[[Simulator, Sequence[MeasuredRun]], Iterator[str]] = lambda simulator, runs: iter(())
    #: Files that it is made of, beside its code: a finding holds for these.
    sources: tuple[Path, ...] = ()

    @property
    def signals(self) -> Mapping[str, SystemSignal]:
        """Every signal by name."""
        return {signal.name: signal for signal in (*self.inputs, *self.outputs)}


def conversion(unit: str, si: str, where: str) -> tuple[float, float]:
    """Return (factor, zero) with SI = factor·value + zero; DiagnosisError if ``unit`` is no unit of ``si``."""
    if unit == si:
        return 1.0, 0.0
    found = UNITS.get(unit)
    if found is None or found[0] != si:
        known = ", ".join(sorted(name for name, (base, _, _) in UNITS.items() if base == si))
        raise DiagnosisError(f'{where}: "{unit}" is no unit of this quantity; right would be one of {known}')
    return found[1], found[2]


def quantity(text: str, si: str, where: str) -> float:
    """Return "25 mm" in SI; DiagnosisError names ``where`` it stands and what would be right."""
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        raise DiagnosisError(
            f'{where} = "{text}" begins with no number; right would be such as "12.5 {_example(si)}"'
        ) from None
    factor, zero = conversion(unit.strip() or "1", si, f'{where} = "{text}"')
    if not np.isfinite(value):
        raise DiagnosisError(f'{where} = "{text}" is no finite number')
    return factor * value + zero


def difference(text: str, si: str, where: str) -> float:
    """As `quantity`, for what is a difference or a width: 1 degC is 1 K."""
    value = quantity(text, si, where)
    return value - conversion(text.strip().partition(" ")[2].strip() or "1", si, where)[1]


def _example(si: str) -> str:
    return {"m": "mm", "Pa": "bar", "s": "ms", "m3": "litre"}.get(si, si)
