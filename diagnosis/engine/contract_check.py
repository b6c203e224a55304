"""Checks that a simulator meets its contract, on one experiment before the diagnosis.

Theory of operation
-------------------
A diagnosis uses derivatives of the outputs: by each parameter, and by the amplitude of each effect at amplitude 0. If
outputs depend on more than the arguments, are not finite or have no derivative there, the diagnosis names a wrong
cause, or fails far from the error. So before any fit, the first samples of a run are simulated

* twice with another simulation between: the outputs must be the same bits;
* with each base parameter at the ends of its range, or five prior deviations away where it has none;
* with each effect at amplitude 0, where the outputs must be those without it, bit for bit;
* with each effect at two small amplitudes, and on both sides of 0 where both are physical: the changes of the outputs
  must be proportional to them (C¹). If an ordinary size changes the outputs and a small one does not, the derivative is
  missing;
* with each effect and its shapes at the ends of their ranges.

Errors that these samples do not reach, such as an error at an end stop, are not found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import exp, isfinite

import numpy as np

from diagnosis.contracts import (
    Array,
    DiagnosisError,
    Effects,
    Experiment,
    Hypothesis,
    Job,
    Parameter,
    Simulator,
)
from diagnosis.engine.config import CHECKED_SAMPLES, CURVED, FAR, ROUNDING, STEPS_OF_SIZE
from diagnosis.engine.simulation import described, simulate
from diagnosis.estimates import percent


def check_contract(simulator: Simulator, experiment: Experiment) -> None:
    """Raise DiagnosisError if a simulator breaks `contracts.Simulator` on the first samples of an experiment.

    The text names the effect and the parameters with their values, and the correct form.
    """
    _check_declarations(simulator)
    with np.errstate(all="ignore"):  # what is not finite is reported as such
        trial = _trial(simulator, _beginning(experiment))
        trial.check_parameters()
        for effect in simulator.catalogue.values():
            trial.check_effect(effect)
        for surface in simulator.surfaces:
            middle = surface.coefficients[len(surface.coefficients) // 2]
            others = {one.name: 0.0 for one in surface.coefficients}
            trial.check_amplitude(surface.name, middle, others)


def _check_declarations(simulator: Simulator) -> None:
    """Raise DiagnosisError if names collide or if numbers in the declarations contradict each other."""
    for name, effect in simulator.catalogue.items():
        where = f"{simulator.name}: the effect {name}"
        if effect.name != name:
            raise DiagnosisError(
                f"{where} has the name {effect.name!r}; the name must be equal to the key in the catalogue"
            )
        if effect.amplitude.nominal != 0.0 or not effect.amplitude.low <= 0.0 <= effect.amplitude.high:
            raise DiagnosisError(
                f"{where}: its amplitude {effect.amplitude.name} has the nominal value {effect.amplitude.nominal:g} "
                f"and the range {effect.amplitude.low:g} to {effect.amplitude.high:g}; the nominal value must be 0, at "
                "which the effect is absent, and the range must include 0"
            )
        for point in effect.grid:
            if len(point) != len(effect.shapes):
                raise DiagnosisError(
                    f"{where}: the point {point} of its grid has {len(point)} values; give one for each of its shapes "
                    f"({', '.join(shape.name for shape in effect.shapes) or 'none'})"
                )
    for what, names in (
        ("channels", [one.name for one in simulator.channels]),
        ("parameters", [one.name for one in simulator.nuisances]),
        ("effects and surfaces", [*simulator.catalogue, *(one.name for one in simulator.surfaces)]),
    ):
        for name in names:
            if names.count(name) > 1:
                raise DiagnosisError(
                    f"{simulator.name}: two of its {what} have the name {name!r}; rename one of them"
                )
    for parameter in _parameters(simulator):
        if not parameter.low <= parameter.nominal <= parameter.high or (
            parameter.logarithmic and not parameter.nominal > 0.0
        ):
            raise DiagnosisError(
                f"{simulator.name}: {parameter.name} has the nominal value {parameter.nominal:g} {parameter.unit} and "
                f"the range {parameter.low:g} to {parameter.high:g}; the nominal value must be inside the range"
                + (", above 0 as it is fitted as a logarithm" if parameter.logarithmic else "")
            )
        if not 0.0 < _size(parameter) < np.inf:
            raise DiagnosisError(
                f"{simulator.name}: {parameter.name} has spread {parameter.spread:g} and step {parameter.step:g} "
                f"{parameter.unit}; at least one of them must be positive and finite"
            )


def _parameters(simulator: Simulator) -> Iterator[Parameter]:
    yield from simulator.nuisances
    for effect in simulator.catalogue.values():
        yield from effect.parameters


def _beginning(experiment: Experiment) -> Experiment:
    """Return the first samples of an experiment. The arrays are read-only, so that a simulator cannot change them."""
    inputs = {name: values[:CHECKED_SAMPLES].copy() for name, values in experiment.inputs.items()}
    for values in inputs.values():
        values.setflags(write=False)
    return replace(experiment, time=experiment.time[:CHECKED_SAMPLES], inputs=inputs)


def _trial(simulator: Simulator, experiment: Experiment) -> _Trial:
    nominal = {nuisance.name: nuisance.nominal for nuisance in simulator.nuisances}
    base = np.array(simulate(simulator, Job(experiment, nominal, {})))
    return _Trial(simulator, experiment, nominal, base)


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """A simulator, an experiment, and the outputs (n, c) of the base model at its nominal values."""

    simulator: Simulator
    experiment: Experiment
    nominal: Mapping[str, float]
    base: Array

    def check_parameters(self) -> None:
        self._refuse_infinite(self.base, {}, {})
        for nuisance in self.simulator.nuisances:
            for value in _ends(nuisance, FAR):
                self.outputs({nuisance.name: value}, {})
        again = simulate(self.simulator, Job(self.experiment, self.nominal, {}))
        if again.tobytes() != self.base.tobytes():
            raise DiagnosisError(
                f"{self.simulator.name} returned other outputs when it was run again with the same arguments, "
                f"{described(self.simulator, self.nominal, {})}; they differ by up to "
                f"{np.nanmax(np.abs(again - self.base)):.3g}; "
                "a simulator must not keep data from one run to the next, and must not use random numbers"
            )

    def check_effect(self, effect: Hypothesis) -> None:
        for point in effect.grid:
            shapes = dict(zip((shape.name for shape in effect.shapes), point, strict=True))
            self.check_amplitude(effect.name, effect.amplitude, shapes)
        values = {shape.name: value for shape, value in zip(effect.shapes, effect.grid[0], strict=True)}
        for size in _ends(effect.amplitude, 1.0):
            self.outputs({}, {effect.name: {effect.amplitude.name: size, **values}})
        values = {effect.amplitude.name: _ordinary(effect.amplitude), **values}
        for shape in effect.shapes:
            for value in _ends(shape, 1.0):
                self.outputs({}, {effect.name: values | {shape.name: value}})

    def check_amplitude(self, effect: str, amplitude: Parameter, others: Mapping[str, float]) -> None:
        """Raise DiagnosisError if an effect changes outputs at amplitude 0, or is not proportional to a small
        amplitude.
        """

        def change(size: float) -> Array:
            return self.outputs({}, {effect: {amplitude.name: size, **others}}) - self.base

        def case(*sizes: float) -> str:
            at = [f"{amplitude.name} = {size:.6g} {amplitude.unit}" for size in sizes]
            shapes = [f"{name} = {value:.6g}" for name, value in others.items() if value != 0.0]
            return f"{self.simulator.name}: the effect {effect} at {', '.join([' and '.join(at), *shapes])}"

        absent = change(0.0)
        if absent.any():
            raise DiagnosisError(
                f"{case(0.0)} changes the outputs by up to {np.abs(absent).max():.3g}; with the amplitude 0, the "
                "outputs must be identical to those without the effect"
            )
        ordinary = _ordinary(amplitude)
        step = np.copysign(min(amplitude.difference, abs(ordinary)), ordinary)
        whole, half = change(step), change(0.5 * step)
        rounding = ROUNDING * np.abs(self.base).max(axis=0) * np.sqrt(len(self.base))
        size, bent = (np.linalg.norm(values, axis=0) for values in (whole, 2.0 * half - whole))
        if np.any(size > rounding) or np.any(bent > rounding):
            if np.any(bent > CURVED * np.maximum(size, bent) + 3.0 * rounding):
                raise DiagnosisError(
                    f"{case(0.5 * step, step)} is not proportional to its amplitude: twice the first change is off by "
                    f"{_share(bent, size)} of the second; use an effect with a derivative at 0, such as a friction "
                    "a·tanh(v/v_0) or a lag that is linear in its time constant"
                )
            if amplitude.low <= -step <= amplitude.high:
                kink = np.linalg.norm(change(-step) + whole, axis=0)
                if np.any(kink > CURVED * np.maximum(size, kink) + 2.0 * rounding):
                    raise DiagnosisError(
                        f"{case(-step, step)} has a kink at 0: both amplitudes should change the outputs by "
                        f"opposite amounts, but the sum of both changes is {_share(kink, size)} of one of them; if "
                        "only one sign is physical, give the amplitude low=0.0, else make the effect smooth"
                    )
        elif np.any(np.linalg.norm(change(ordinary), axis=0) > rounding):
            raise DiagnosisError(
                f"{case(step)} changes nothing, but at {amplitude.name} = {ordinary:.6g} {amplitude.unit} it does: the "
                "effect has no derivative at 0, so no search can find it; for a lag, use the exact response to a "
                "straight line between two samples"
            )

    def outputs(self, parameters: Mapping[str, float], effects: Effects) -> Array:
        """Return the outputs with changed parameters or effects. Raises DiagnosisError if they are not finite."""
        merged = {**self.nominal, **parameters}
        outputs = simulate(self.simulator, Job(self.experiment, merged, effects))
        self._refuse_infinite(outputs, merged, effects)
        return outputs

    def _refuse_infinite(self, outputs: Array, parameters: Mapping[str, float], effects: Effects) -> None:
        if not np.isfinite(outputs).all():
            row, column = (int(i) for i in np.argwhere(~np.isfinite(outputs))[0])
            raise DiagnosisError(
                f"{self.simulator.name}: {self.simulator.channels[column].name} is {outputs[row, column]} at "
                f"{self.experiment.time[row]:.6g} s of the run {self.experiment.name}, at "
                f"{described(self.simulator, parameters, effects)}; outputs must be finite in the whole range of the "
                "parameters: narrow this range, or correct the equation"
            )


def _share(part: Array, whole: Array) -> str:
    return percent(float(np.max(part / np.maximum(whole, 1e-300))), 3)


def _size(parameter: Parameter) -> float:
    """Return the expected deviation of a parameter from its nominal value: its spread, or some steps if it has no
    prior.
    """
    return parameter.spread if 0.0 < parameter.spread < np.inf else STEPS_OF_SIZE * parameter.step


def _ordinary(amplitude: Parameter) -> float:
    """Return an amplitude of ordinary size and physical sign."""
    return (
        min(_size(amplitude), amplitude.high)
        if amplitude.high > 0.0
        else max(-_size(amplitude), amplitude.low)
    )


def _ends(parameter: Parameter, far: float) -> Iterator[float]:
    """Yield the ends of a parameter's range; for an open end, ``far`` spreads from the nominal value."""
    for bound, away in ((parameter.low, -far), (parameter.high, far)):
        distance = away * _size(parameter)
        if isfinite(bound):
            yield bound
        elif parameter.logarithmic:
            yield parameter.nominal * exp(distance / parameter.nominal)
        else:
            yield parameter.nominal + distance
