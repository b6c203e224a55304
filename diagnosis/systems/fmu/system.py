"""Builds a system for mapped files from an FMU and the ``[fmu]`` keys of a map."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from math import inf, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench_protocol.units import UNITS
from bench_sim.fmu.description import REALS, Fmu, FmuError, FmuUnit, Variable, read_fmu
from diagnosis.contracts import (
    Channel,
    DiagnosisError,
    Hypothesis,
    MeasuredRun,
    Nuisance,
    Parameter,
    Simulator,
)
from diagnosis.systems.fmu.keys import (
    BaseKeys,
    EffectKeys,
    FmuKeys,
    MeasuredKeys,
    ShapeKeys,
    SurfaceKeys,
)
from diagnosis.systems.fmu.pool import TIMEOUT, FmuPool
from diagnosis.systems.fmu.simulator import Drive, FmuSimulator, OfVariable
from diagnosis.systems.fmu.steps import step_doubts
from diagnosis.systems.fmu.written import read_values
from diagnosis.systems.measurement import KINDS, Measured, measurement_effects
from diagnosis.systems.splines import SplineAxis, TensorSplines
from diagnosis.systems.system import System, SystemSetting, SystemSignal, difference, quantity

#: Typical offset of a signal over its range.
_OFFSET: Final = 0.02
#: Standard deviation of the uniform distribution over its range.
_EVEN: Final = 1.0 / sqrt(12.0)
#: Causes that do not apply to a signal that is held between samples.
_OF_MOTION: Final = frozenset({"lag", "latency"})
_DEFAULT: Final = MeasuredKeys()


def fmu_system(
    path: Path,
    keys: FmuKeys,
    units: Mapping[str, str],
    holds: Mapping[str, bool | None],
    map_path: Path,
) -> System:
    """Return the system of an FMU; ``units`` and ``holds`` are those of the map's columns.

    Raises DiagnosisError for an FMU that cannot be used. ``errors`` of the system holds the errors of the map.
    """
    try:
        fmu = read_fmu(path)
    except FmuError as error:
        raise DiagnosisError(str(error)) from None
    return _Maker(fmu, keys, units, holds, map_path).system()


class _Maker:
    def __init__(
        self,
        fmu: Fmu,
        keys: FmuKeys,
        units: Mapping[str, str],
        holds: Mapping[str, bool | None],
        map_path: Path,
    ) -> None:
        self.keys, self.units, self.where = keys, units, str(map_path)
        self.known = {**fmu.units, **UNITS}
        self.errors: dict[str, str] = {}
        self.fmu = self._with_units(fmu)
        stairs = {name: _stairs(one) for name, one in fmu.variables.items()} | {
            name: hold for name, hold in holds.items() if hold is not None
        }
        self.held = {name for name, hold in stairs.items() if hold}
        self.preset: Mapping[str, float] = {}
        if keys.parameters is not None:
            file = map_path.parent / keys.parameters
            with self._noted("fmu.parameters"):
                self.preset = read_values(file, self.fmu, f"{self.where}: fmu.parameters")

    @contextmanager
    def _noted(self, key: str) -> Iterator[None]:
        """Store the error of one key, so that all errors are reported at once."""
        try:
            yield
        except (DiagnosisError, FmuError) as error:
            self.errors[key] = str(error)

    def _quantity(self, one: Variable, text: str, where: str) -> float:
        return quantity(text, one.unit.si, where, self.known, relative=one.relative)

    def _difference(self, text: str, si: str, where: str) -> float:
        return difference(text, si, where, self.known)

    def _seconds(self, key: str, text: str | None) -> float | None:
        return None if text is None else quantity(text, "s", f"{self.where}: fmu.{key}")

    def _with_units(self, fmu: Fmu) -> Fmu:
        """Return the FMU with a unit for each variable: its own, else that of the map, else 1."""
        units = dict(self.units)
        for name, text in self._quantities():
            if text and not text.endswith("%") and (unit := text.strip().partition(" ")[2].strip()):
                units.setdefault(name, unit)
        variables = dict(fmu.variables)
        for name, one in variables.items():
            if not one.unit.si:
                unit = units.get(name) or "1"
                si = self.known[unit].si if unit in self.known else unit
                variables[name] = replace(one, unit=FmuUnit("", si))
        return replace(fmu, variables=variables)

    def _quantities(self) -> Iterator[tuple[str, str | None]]:
        """Yield all quantities in the map that belong to variables, as pairs of the variable's name and the text."""
        for name, base in self.keys.base.items():
            yield from ((name, text) for text in (base.value, base.low, base.high, base.spread))
        for one in self.keys.effects.values():
            yield from ((one.variable, text) for text in (one.typical, one.off, one.low, one.high))
            for name, shape in one.shapes.items():
                yield from ((name, text) for text in (*shape.tried, shape.low, shape.high))

    def system(self) -> System:
        fmu, keys = self.fmu, self.keys
        fixed = {
            *(name for name in keys.base if not _of_measurement(name)),
            *(effect.variable for effect in keys.effects.values()),
            *(name for effect in keys.effects.values() for name in effect.shapes),
        }
        inputs = [one for one in fmu.variables.values() if one.causality == "input"]
        driven = [one for one in inputs if one.name in self.units]
        outputs = [
            one
            for one in fmu.variables.values()
            if one.causality == "output" or (one.name in self.units and one.causality != "input")
        ]
        for name in self.units:
            with self._noted(f"columns.{name}"):
                fmu.variable(name, f"{self.where}: columns.{name}")
        for name in keys.gauge:
            with self._noted(f"fmu.gauge.{name}"):
                if fmu.variable(name, f"{self.where}: fmu.gauge").unit.si != "Pa":
                    raise DiagnosisError(
                        f"{self.where}: fmu.gauge: {name} is not a pressure; remove it from the list"
                    )
        if not outputs:
            raise DiagnosisError(
                f"{fmu.path} has no numeric output; export the model with the measured outputs"
            )
        settings = tuple(
            self._setting(one)
            for one in fmu.variables.values()
            if one.settable and one.name not in fixed and one not in driven
            if one.start is not None or one.causality == "input"
        )
        times: dict[str, float | None] = {}
        for key, text in (("step", keys.step), ("settle", keys.settle), ("patience", keys.patience)):
            with self._noted(f"fmu.{key}"):
                times[key] = self._seconds(key, text)
        named = tuple(self._signal(one).channel(0.0, 0.0) for one in outputs if one.name in self.units)
        self._read_keys(driven, named, {}, 1.0)  # notes errors of the map
        pool = FmuPool(fmu, times.get("patience") or TIMEOUT)
        return System(
            name=fmu.path.name,
            title=fmu.name,
            inputs=tuple(self._signal(one) for one in driven),
            outputs=tuple(self._signal(one) for one in outputs),
            settings=settings,
            simulator=lambda given, channels: self._simulator(pool, driven, channels, {}, 1.0),
            sized=lambda simulator, runs: self._simulator(
                pool,
                driven,
                simulator.channels,
                _ranges([one.name for one in simulator.channels], runs),
                runs[0].experiment.step,
            ),
            doubts=_doubts,
            sources=(fmu.path,),
            units=self.known,
            errors=self.errors,
        )

    def _signal(self, one: Variable) -> SystemSignal:
        unit = self.units.get(one.name, "")
        shown, scale = self._display_unit(unit, one.unit.si)
        return SystemSignal(
            one.name,
            one.unit.si,
            one.description or one.name,
            one.causality == "input",
            one.unit.si == "Pa" and one.name in self.keys.gauge,
            shown,
            scale,
            one.relative,
            _stairs(one),
            one.type not in REALS,
        )

    def _setting(self, one: Variable) -> SystemSetting:
        """Return a setting for a variable that is constant in each file. An input without a column has no default."""
        default = None if one.causality == "input" else self._default_value(one)
        low, high = (one.unit.to_si(bound) for bound in (one.low, one.high))
        about = f"{one.description or one.name}; a column or a value for whole files"
        return SystemSetting(one.name, one.unit.si, about, low, high, default, True, one.relative)

    def _simulator(
        self,
        pool: FmuPool,
        driven: Sequence[Variable],
        channels: tuple[Channel, ...],
        ranges: Mapping[str, float],
        delay: float,
    ) -> FmuSimulator:
        """Return the simulator. ``ranges`` (SI) are those of the signals, ``delay`` (s) is a typical delay of each."""
        keys = self.keys
        base, own, sensors, surfaces = self._read_keys(driven, channels, ranges, delay)
        catalogue: dict[str, Hypothesis] = {name: one for name, (one, _) in own.items()}
        catalogue |= {name: one for name, one in sensors.items() if name not in keys.base}
        settle = self._seconds("settle", keys.settle)
        drive = Drive(tuple(driven), self._seconds("step", keys.step), settle or 0.0, keys.hold)
        return FmuSimulator(
            pool=pool,
            drive=drive,
            channels=channels,
            nuisances=tuple(base.values()),
            catalogue=catalogue,
            effects={name: of for name, (_, of) in own.items()},
            unnamed=surfaces,
            preset=self.preset,
        )

    def _read_keys(
        self,
        driven: Sequence[Variable],
        channels: Sequence[Channel],
        ranges: Mapping[str, float],
        delay: float,
    ) -> tuple[
        dict[str, Nuisance],
        dict[str, tuple[Hypothesis, OfVariable]],
        dict[str, Hypothesis],
        tuple[tuple[str, TensorSplines], ...],
    ]:
        """Return base parameters, effects, sensor errors and surfaces from all valid keys, and store the errors of
        invalid keys.
        """
        keys = self.keys
        sensors = measurement_effects(self._measured(driven, channels, ranges, delay))
        sensors = {name: one for name, one in sensors.items() if name.partition(".")[0] in self._causes(name)}
        signals = [*(one.name for one in driven), *(channel.name for channel in channels)]
        base, own, surfaces = {}, {}, []
        for name, nuisance in keys.base.items():
            with self._noted(f"fmu.base.{name}"):
                base[name] = self._base(name, nuisance, sensors)
        for name, effect in keys.effects.items():
            with self._noted(f"fmu.effects.{name}"):
                own[name] = self._effect(name, effect)
        for number, surface in enumerate(keys.surfaces):
            with self._noted(f"fmu.surfaces.{number}"):
                surfaces.append(self._surface(surface, signals))
        return base, own, sensors, tuple(surfaces)

    def _causes(self, name: str) -> Sequence[str]:
        signal = name.partition(".")[2]
        causes = self.keys.measured.get(signal, _DEFAULT).causes
        if causes is not None:
            return causes
        return [one for one in KINDS if one not in _OF_MOTION] if signal in self.held else KINDS

    def _measured(
        self,
        driven: Sequence[Variable],
        channels: Sequence[Channel],
        ranges: Mapping[str, float],
        delay: float,
    ) -> list[Measured]:
        every: list[tuple[Variable, Any]] = [(one, "input") for one in driven]
        every += [(self.fmu.variables[one.name], "output") for one in channels]
        names = {one.name for one, _ in every}
        for name, given in self.keys.measured.items():
            with self._noted(f"fmu.measured.{name}"):
                self._check_measured(name, given, names)
        measured = []
        for one, kind in every:
            if one.type not in REALS:
                continue
            keys, where = self.keys.measured.get(one.name, _DEFAULT), f"{self.where}: fmu.measured.{one.name}"
            size, late = _OFFSET * (ranges.get(one.name, 0.0) or abs(one.unit.factor)), delay
            with self._noted(where):
                if keys.offset is not None:
                    size = self._difference(keys.offset, one.unit.si, f"{where}.offset")
                if keys.delay is not None:
                    late = quantity(keys.delay, "s", f"{where}.delay")
            signal = self._signal(one)
            measured.append(Measured(one.name, one.unit.si, kind, size, late, signal.display, signal.scale))
        return measured

    def _check_measured(self, name: str, keys: MeasuredKeys, names: Collection[str]) -> None:
        where = f"{self.where}: fmu.measured.{name}"
        if name not in names:
            raise DiagnosisError(f"{where} is not a signal with a column; use one of {', '.join(names)}")
        late = sorted({*(keys.causes or ())} & _OF_MOTION)
        if late and name in self.held:
            raise DiagnosisError(
                f"{where}.causes has {' and '.join(late)}, but {name} is held between samples, so no lag can be "
                "determined; use gain, offset or drift, or set hold = false for its column"
            )

    def _base(self, name: str, keys: BaseKeys, sensors: Mapping[str, Hypothesis]) -> Nuisance:
        where = f"{self.where}: fmu.base.{name}"
        if name in sensors:
            amplitude = sensors[name].amplitude
            if keys.spread is None:
                raise DiagnosisError(f"{where}.spread is missing: give its uncertainty in {amplitude.unit}")
            spread = self._difference(keys.spread, amplitude.unit, f"{where}.spread")
            return Nuisance(
                name, amplitude.unit, 0.0, spread, amplitude.low, amplitude.high,
                display=amplitude.display, scale=amplitude.scale, per_run=keys.per_run,
            )  # fmt: skip
        one = self._settable(name, where)
        value = self._value(one, keys.value, f"{where}.value")
        if value is None:
            raise DiagnosisError(
                f"{where}.value is missing, and the FMU has no start value of {name}; give it in {one.unit.si}"
            )
        low, high = self._bounds(one, keys.low, keys.high, where)
        spread = _EVEN * (high - low)
        if keys.spread is not None:
            spread = self._spread(one, keys.spread, value, f"{where}.spread")
        elif not 0.0 < spread < inf:
            raise DiagnosisError(
                f"{where}.spread is missing: give the uncertainty of {name} in {one.unit.si}, or low and high"
            )
        if not low <= value <= high:
            raise DiagnosisError(
                f"{where}: the value {value:g} {one.unit.si} is outside of {low:g} to {high:g} {one.unit.si}; change "
                "the value or the bounds"
            )
        display, scale = self._shown_in(
            keys.value or keys.spread or keys.low or "", one.unit.si, one.unit.name
        )
        return Nuisance(
            name, one.unit.si, value, spread, low, high,
            logarithmic=keys.logarithmic, display=display, scale=scale, per_run=keys.per_run,
        )  # fmt: skip

    def _settable(self, name: str, where: str) -> Variable:
        one = self.fmu.variable(name, where)
        if not one.settable or one.type not in REALS or one.causality == "input":
            raise DiagnosisError(
                f"{where}: {name} is {one.causality} ({one.variability}, {one.type}) in {self.fmu.path.name} and "
                "cannot be set; use a real parameter or start value"
            )
        return one

    def _default_value(self, one: Variable) -> float | None:
        """Return the value (SI) of a variable if the map gives none: from the parameter set, else from the FMU; None
        if neither has one.
        """
        own = None if one.start is None else one.unit.to_si(one.start)
        return self.preset.get(one.name, own)

    def _value(self, one: Variable, text: str | None, where: str) -> float | None:
        return self._default_value(one) if text is None else self._quantity(one, text, where)

    def _spread(self, one: Variable, text: str, value: float, where: str) -> float:
        """Return a standard deviation in SI. The text has a unit, or gives a percentage of the value."""
        if text.strip().endswith("%") and one.unit.si != "1":
            spread = abs(value) * quantity(text, "1", where)
        else:
            spread = self._difference(text, one.unit.si, where)
        if not spread > 0.0:
            raise DiagnosisError(
                f'{where} = "{text}" is not positive; give a standard deviation of more than 0'
            )
        return spread

    def _bounds(self, one: Variable, low: str | None, high: str | None, where: str) -> tuple[float, float]:
        """Return the range of the map in SI. Raises DiagnosisError if it exceeds that of the FMU."""
        own = [one.unit.to_si(bound) for bound in (one.low, one.high)]
        given = [
            otherwise if text is None else self._quantity(one, text, f"{where}.{key}")
            for text, key, otherwise in ((low, "low", own[0]), (high, "high", own[1]))
        ]
        if given[0] < own[0] - 1e-12 * abs(own[0]) or given[1] > own[1] + 1e-12 * abs(own[1]):
            raise DiagnosisError(
                f"{where}: the range {given[0]:g} to {given[1]:g} {one.unit.si} is wider than that of the FMU; use low "
                f"and high within {own[0]:g} to {own[1]:g} {one.unit.si}"
            )
        return max(given[0], own[0]), min(given[1], own[1])

    def _effect(self, name: str, keys: EffectKeys) -> tuple[Hypothesis, OfVariable]:
        where = f"{self.where}: fmu.effects.{name}"
        if name in {*self.keys.base} or name.partition(".")[0] in KINDS:
            raise DiagnosisError(f"{where}: the name {name} is in use; choose another name")
        one = self._settable(keys.variable, where)
        off = self._value(one, keys.off, f"{where}.off")
        if off is None:
            raise DiagnosisError(
                f"{where}.off is missing: give the value of {one.name} at which {name} is absent"
            )
        low, high = self._bounds(one, keys.low, keys.high, where)
        if not low <= off <= high:
            raise DiagnosisError(
                f"{where}: off = {off:g} {one.unit.si} is outside of {low:g} to {high:g}; give a value inside, "
                "at which the effect is absent"
            )
        typical = self._difference(keys.typical, one.unit.si, f"{where}.typical")
        if not typical > 0.0:
            raise DiagnosisError(
                f'{where}.typical = "{keys.typical}" is not positive; give a size of more than 0'
            )
        display, scale = self._shown_in(keys.typical, one.unit.si)
        amplitude = Parameter(
            one.name, one.unit.si, 0.0, typical, low - off, high - off, display=display, scale=scale
        )
        shapes = tuple(self._shape(name, shape, one) for shape, one in keys.shapes.items())
        grid = tuple(product(*(self._tried(shape, one, where) for shape, one in keys.shapes.items())))
        hypothesis = Hypothesis(
            name,
            keys.family,
            keys.title or name.replace("_", " "),
            amplitude,
            shapes,
            grid,
            frozenset({keys.family}),
            tuple(keys.confusers),
            equation=keys.equation,
            source=f"{self.fmu.path.name}: {one.description or one.name}",
            plain=keys.says,
            phenomenon=keys.phenomenon,
        )
        return hypothesis, OfVariable(one, off)

    def _tried(self, shape: str, keys: ShapeKeys, where: str) -> list[float]:
        one = self._settable(shape, f"{where}.shapes.{shape}")
        if not keys.tried:
            raise DiagnosisError(f"{where}.shapes.{shape}.tried is empty; give start values")
        return [self._quantity(one, text, f"{where}.shapes.{shape}.tried") for text in keys.tried]

    def _shape(self, effect: str, shape: str, keys: ShapeKeys) -> Parameter:
        where = f"{self.where}: fmu.effects.{effect}.shapes.{shape}"
        one = self._settable(shape, where)
        tried = sorted(self._tried(shape, keys, f"{self.where}: fmu.effects.{effect}"))
        low, high = self._bounds(one, keys.low, keys.high, where)
        middle = tried[len(tried) // 2]
        spread = max(tried[-1] - tried[0], 0.5 * abs(middle)) or 1.0
        if not low <= tried[0] <= tried[-1] <= high:
            raise DiagnosisError(
                f"{where}.tried: use values within {low:g} to {high:g} {one.unit.si}, not {tried[0]:g} to {tried[-1]:g}"
            )
        display, scale = self._shown_in(keys.tried[0], one.unit.si)
        return Parameter(
            shape, one.unit.si, middle, spread, low, high,
            step=0.01 * spread, logarithmic=keys.logarithmic, display=display, scale=scale,
        )  # fmt: skip

    def _surface(self, keys: SurfaceKeys, signals: Collection[str]) -> tuple[str, TensorSplines]:
        where = f"{self.where}: fmu.surfaces of {keys.signal}"
        for name in (keys.signal, *keys.over):
            if name not in signals:
                self.fmu.variable(name, where)
                raise DiagnosisError(f"{where}: {name} has no column; use one of {', '.join(signals)}")
        if len(keys.over) != 2 or keys.knots < 3:
            raise DiagnosisError(
                f"{where}: over = {', '.join(keys.over)}, knots = {keys.knots}; use two signals and at least 3 knots"
            )
        axes = []
        for name, ends in keys.over.items():
            one = self.fmu.variable(name, f"{where}: over")
            low, high = (self._quantity(one, text, f"{where}: over.{name}") for text in ends)
            if not low < high:
                raise DiagnosisError(
                    f"{where}: over.{name} goes from {ends[0]} to {ends[1]}; give the lower end first"
                )
            display, scale = self._shown_in(ends[0], one.unit.si)
            axes.append(
                SplineAxis(
                    name,
                    f"{name} in {display or one.unit.si}",
                    tuple(np.linspace(low, high, keys.knots)),
                    scale,
                )
            )
        unit = self.fmu.variables[keys.signal].unit.si
        spread = self._difference(keys.typical, unit, f"{where}: typical")
        names = " and ".join(keys.over)
        return keys.signal, TensorSplines(
            f"{keys.signal} over {names}", f"unknown part of {keys.signal} over {names}", axes[0], axes[1],
            unit, spread, frozenset({"unknown"}),
        )  # fmt: skip

    def _display_unit(self, unit: str, si: str) -> tuple[str, float]:
        """Return a display unit with its factor to SI; ("", 1) if it is for another quantity or has an offset."""
        found = self.known.get(unit)
        right = found is not None and found.si == si and found.zero == 0.0
        return (unit, found.factor) if right and found is not None else ("", 1.0)

    def _shown_in(self, text: str, si: str, otherwise: str = "") -> tuple[str, float]:
        """Return the unit of a quantity in the map with its factor, as `_display_unit` does. For a percentage the unit
        ``otherwise`` is used.
        """
        unit = text.strip().partition(" ")[2].strip()
        return self._display_unit(unit if unit in self.known and self.known[unit].si == si else otherwise, si)


def _stairs(one: Variable) -> bool:
    """Return whether a variable is piecewise constant."""
    return one.variability == "discrete" or one.type not in REALS


def _doubts(simulator: Simulator, runs: Sequence[MeasuredRun]) -> Iterator[str]:
    return step_doubts(simulator, runs) if isinstance(simulator, FmuSimulator) else iter(())


def _ranges(outputs: Sequence[str], runs: Sequence[MeasuredRun]) -> dict[str, float]:
    """Return the range of each signal in all runs (SI)."""
    names = [*runs[0].experiment.inputs, *outputs]
    every = [np.vstack([*run.experiment.inputs.values(), *run.outputs.T]) for run in runs]
    highest = np.max([np.nanmax(one, axis=1) for one in every], axis=0)
    lowest = np.min([np.nanmin(one, axis=1) for one in every], axis=0)
    return dict(zip(names, (highest - lowest).tolist(), strict=True))


def _of_measurement(name: str) -> bool:
    return name.partition(".")[0] in KINDS
