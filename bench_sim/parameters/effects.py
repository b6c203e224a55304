"""Reads effects from text such as `leak.left=0.2mm2`, checks them against the catalogue, and adds them to a parameter
set.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Final, Protocol, Self, TypeVar

from bench_protocol.suggestion import did_you_mean
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.parameters.loading import Entry, ParameterError, check_range, read_value

#: Values (SI) of effects by name and place, such as ``{"leak.left": {"area": 2e-7}}``.
Effects = Mapping[str, Mapping[str, float]]


class ParameterSet(Protocol):
    """The methods that a parameter set needs for changes. `Parameters` has them."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def name(self) -> str: ...
    @property
    def effects(self) -> Effects: ...
    def with_values(self, **changes: Any) -> Self:
        """Return a copy with some values changed (SI)."""


Set = TypeVar("Set", bound=ParameterSet)

_EXAMPLE: Final = "NAME[.PLACE]=AMPLITUDE[, SHAPE=VALUE]"


def find_effect(name: str) -> tuple[Effect, int | None]:
    """Return the effect called ``name`` (such as ``leak.left`` or ``maxwell``), and the index of its place or None.
    Places left and right are 0 and 1.

    Raises `ParameterError` for an unknown effect or place.
    """
    kind, _, place = name.partition(".")
    effect = CATALOGUE.get(kind)
    if effect is None:
        known = [
            f"{one.name}.{place}" if place else one.name
            for one in CATALOGUE.values()
            for place in _places(one)
        ]
        raise ParameterError(
            f"{name} is not an effect; {did_you_mean(name, known, '`astb list effects` lists them')}"
        )
    if place not in _places(effect):
        right = did_you_mean(name, [f"{kind}.{one}" if one else kind for one in _places(effect)])
        raise ParameterError(f"{name} is not an effect; {right}")
    return effect, effect.places.index(place) if place else None


def read_effect(name: str, given: Mapping[str, Any]) -> dict[str, float]:
    """Return the values (SI) of the effect ``name`` from texts with units. Parameters without a text are left out.

    Raises `ParameterError` for an unknown effect or parameter, or an invalid text.
    """
    effect, _ = find_effect(name)
    _check_names(name, effect, given)
    return {
        one.name: read_value(f"{name}: {one.name}", given[one.name], one.unit)
        for one in effect.parameters
        if one.name in given
    }


def read_effect_text(name: str, text: Any) -> dict[str, float]:
    """Return the values (SI) of the effect ``name`` from a text like ``0.1, time=0.5 s``, which begins with the
    amplitude. Raises `ParameterError` for an invalid text.
    """
    effect, _ = find_effect(name)
    amplitude, *shapes = str(text).split(",")
    given = {effect.amplitude.name: amplitude.strip()}
    for shape in shapes:
        key, equals, value = shape.partition("=")
        key = key.strip()
        if not equals or key in given:
            raise ParameterError(f"{name} = {text!r} cannot be read; write it like {_EXAMPLE}")
        given[key] = value.strip()
    return read_effect(name, given)


def show_effect(name: str, values: Mapping[str, float]) -> str:
    """Return values (SI) of the effect ``name`` as a text that `read_effect_text` can read, such as ``0.1, time=0.5
    s``.
    """
    effect, _ = find_effect(name)
    texts = {}
    for one in effect.parameters:
        if one.name in values:
            unit = "" if one.display == "1" else f" {one.display}"
            texts[one.name] = f"{values[one.name] / one.scale:g}{unit}"
    amplitude = texts.pop(effect.amplitude.name)
    return ", ".join([amplitude, *(f"{shape}={text}" for shape, text in texts.items())])


def with_effects(parameters: Set, effects: Effects) -> Set:
    """Return a copy of ``parameters`` with these additional ``effects`` (SI).

    Missing shape parameters get their nominal value. Raises `ParameterError` for an invalid value, for a missing
    amplitude, and for an effect that the set already has.
    """
    added = {name: _complete(name, values) for name, values in effects.items()}
    for name in added:
        if name in parameters.effects:
            raise ParameterError(f"{name} is already in {parameters.name}; give it only once")
    return replace(parameters, effects={**parameters.effects, **added})


def apply_effects(record: Any, entries: Mapping[str, Entry], effects: Effects) -> None:
    """Apply ``effects`` to the parameter record in place. Raises `ParameterError` if a parameter leaves its range, or
    if no element is free for an additional branch or friction element.
    """
    for name, values in effects.items():
        effect, place = find_effect(name)
        try:
            effect.change(record, place, values)
        except ValueError as error:  # no room left among the rubber's extra elements
            raise ParameterError(f"{name} cannot be added: {error}") from None
        for parameter, entry in entries.items():
            try:
                check_range(parameter, replace(entry, value=record[parameter]))
            except ParameterError as error:
                raise ParameterError(f"{name} is too large: {error}") from None


def _complete(name: str, values: Mapping[str, float]) -> dict[str, float]:
    effect, _ = find_effect(name)
    _check_names(name, effect, values)
    if effect.amplitude.name not in values:
        raise ParameterError(f"{name} has no {effect.amplitude.name}; add this amplitude")
    complete = {one.name: float(values.get(one.name, one.nominal)) for one in effect.parameters}
    for one in effect.parameters:
        _check(name, one, complete[one.name])
    return complete


def _check(name: str, one: EffectParameter, value: float) -> None:
    if not one.low <= value <= one.high:  # NaN is outside
        number, low, high = (f"{side / one.scale:g} {one.display}" for side in (value, one.low, one.high))
        raise ParameterError(f"{name}: {one.name} = {number} is outside {low} to {high}")


def _check_names(name: str, effect: Effect, given: Mapping[str, Any]) -> None:
    known = [one.name for one in effect.parameters]
    for key in given:
        if key not in known:
            raise ParameterError(f"{key} is not a parameter of {name}; {did_you_mean(key, known)}")


def _places(effect: Effect) -> tuple[str, ...]:
    return effect.places or ("",)
