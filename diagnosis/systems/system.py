"""The definition of a system for mapped files: its signals, its settings, and its simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol.unit_names import ReadUnit, UnknownUnit, read_unit
from bench_protocol.units import UNITS, Unit
from diagnosis.contracts import Array, Channel, DiagnosisError, MeasuredRun, Simulator

#: The quantity of a channel, by its SI unit.
KINDS: Final = {"N": "force", "Pa": "pressure", "K": "temperature", "m": "displacement"}


@dataclass(frozen=True, slots=True)
class SystemSignal:
    """One measured quantity that a system can use: an input that drives it, or an output that it predicts."""

    name: str
    unit: str  #: SI
    title: str
    required: bool = True
    gauge: bool = False  #: for a pressure: the reference that the system needs; a map states that of the file
    display: str = ""  #: unit that people read, with ``scale`` SI per unit
    scale: float = 1.0
    relative: bool = False  #: a difference: the zero of a unit does not count, 1 degC is 1 K
    held: bool = False  #: for an input: whether it is held between samples, unless a map states otherwise
    whole: bool = False  #: numbers between two samples mean nothing

    def channel(self, noise: float, resolution: float) -> Channel:
        """Return the output channel of this signal; ``noise`` and ``resolution`` in SI, 0: unknown."""
        kind = KINDS.get(self.unit, "")
        return Channel(self.name, self.unit, noise, resolution, kind, self.display, self.scale)


@dataclass(frozen=True, slots=True)
class SystemSetting:
    """A constant of the user's rig, such as the bore of a cylinder. Without ``default`` (SI) the map must state it."""

    name: str
    unit: str  #: SI
    title: str
    low: float
    high: float
    default: float | None = None
    #: Whether the simulator takes it from the settings of each experiment, so that it may differ from file to file.
    per_file: bool = False
    relative: bool = False  #: as of a `SystemSignal`


@dataclass(frozen=True, slots=True)
class System:
    """A system that can be diagnosed from mapped files: its signals and settings, and functions that make its simulator
    and inputs.
    """

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
    #: signals (n,) of one record by name -> settings that only its runs have
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
    #: Files that it is made of, together with its code: a finding holds for these.
    sources: tuple[Path, ...] = ()
    #: The units that a map may name.
    units: Mapping[str, Unit] = field(default_factory=lambda: UNITS)
    #: Errors in its map, by key.
    errors: Mapping[str, str] = field(default_factory=dict)

    @property
    def signals(self) -> Mapping[str, SystemSignal]:
        """Every signal by name."""
        return {signal.name: signal for signal in (*self.inputs, *self.outputs)}


class Errors:
    """Collects the errors of one map, so that all are reported together."""

    def __init__(self, texts: Iterable[str] = ()) -> None:
        self._texts = list(texts)

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Catch a DiagnosisError in the block and store it; the program continues after the block."""
        try:
            yield
        except DiagnosisError as error:
            self.note(str(error))

    def note(self, text: str) -> None:
        """Store the text of an error."""
        self._texts.append(text)

    def report(self) -> None:
        """Raise a DiagnosisError with a line for each error, if there is any."""
        if self._texts:
            raise DiagnosisError("\n".join(dict.fromkeys(self._texts)))


def unit_of(text: str, units: Mapping[str, Unit]) -> ReadUnit:
    """Return the unit with this name from ``units``; other names are parsed in any usual spelling. Raises UnknownUnit
    if this fails.
    """
    return ReadUnit(units[text]) if text in units else read_unit(text)


def conversion(
    unit: str, si: str, where: str, units: Mapping[str, Unit] = UNITS, *, relative: bool = False
) -> tuple[float, float]:
    """Return (factor, zero) with SI = factor·value + zero. For a difference (``relative``) the zero is 0.

    Raises DiagnosisError if ``unit`` is not a unit of the quantity with the SI unit ``si``.
    """
    if unit == si:
        return 1.0, 0.0
    try:
        found = unit_of(unit, units)
    except UnknownUnit as error:
        raise DiagnosisError(f"{where}: {error}; use one of {_allowed_units(si, units)}") from None
    if not found.measures(si):
        raise DiagnosisError(
            f'{where}: "{unit}" is not a unit of this quantity; use one of {_allowed_units(si, units)}'
        )
    return found.unit.factor, 0.0 if relative else found.unit.zero


def _allowed_units(si: str, units: Mapping[str, Unit]) -> str:
    return ", ".join(sorted({si, *(name for name, one in units.items() if one.si == si)}))


def quantity(
    text: str, si: str, where: str, units: Mapping[str, Unit] = UNITS, *, relative: bool = False
) -> float:
    """Return a quantity such as "25 mm" in SI, see `conversion`. Raises DiagnosisError that states the place
    (``where``) and the correct form.
    """
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        raise DiagnosisError(
            f'{where} = "{text}" does not begin with a number; write it as "12.5 {_example(si)}"'
        ) from None
    if not unit.strip() and si != "1":
        raise DiagnosisError(f'{where} = "{text}" has no unit; write it as "{text.strip()} {_example(si)}"')
    factor, zero = conversion(unit.strip() or "1", si, f'{where} = "{text}"', units, relative=relative)
    if not np.isfinite(value):
        raise DiagnosisError(f'{where} = "{text}" must be a finite number')
    return factor * value + zero


def difference(text: str, si: str, where: str, units: Mapping[str, Unit] = UNITS) -> float:
    """Return a difference or a width in SI, as `quantity` does, but without the zero of the unit: 1 degC is 1 K."""
    return quantity(text, si, where, units, relative=True)


def _example(si: str) -> str:
    return {"m": "mm", "Pa": "bar", "s": "ms", "m3": "litre"}.get(si, si)
