"""An effect is a physical cause that changes parameters of the plant. With amplitude 0 the effect is absent."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any, Final

import numpy as np

#: Families of effects, by location: spring (rubber, gas, flow), measurement (sensor, acquisition) or actuation (rig).
FAMILIES: Final = ("rubber", "gas", "flow", "sensor", "acquisition", "rig")

#: Where an effect of one spring can sit. An effect without a place concerns the bench as a whole, or both springs.
PLACES: Final = ("left", "right")


def springs(place: int | None) -> slice | int:
    """Return the index of one spring in a parameter of both springs, or a slice of both if ``place`` is None."""
    return slice(None) if place is None else place


class ShownBy(Enum):
    """The kind of test that makes an effect visible in the readings of a bench."""

    MOTION = "the springs are moved, leveling and differential pressure valves isolated"
    CONNECTED_VALVES = "the springs are moved while these valves are connected and open"
    COMMANDS = "the actuators are commanded: what they then do is not enough"


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect: nominal and typical value, and limits, all in SI units."""

    name: str
    unit: str  #: SI
    display: str  #: unit that people write and read, one of `bench_protocol.units.WRITTEN_UNITS`
    scale: float  #: SI per display unit
    nominal: float  #: amplitude: 0
    typical: float  #: amplitude: the size of an ordinary fault; shape: its middle
    low: float
    high: float
    logarithmic: bool = False


#: ``change(par, place, values)`` alters the parameter record in place; place is 0 or 1 (side), or None.
Change = Callable[[Any, int | None, Mapping[str, float]], None]


def adds(
    quantity: str,
    parameter: str,
    sensors: Sequence[int] | None = None,
    *,
    by_place: Sequence[int | Sequence[int]] | None = None,
) -> Change:
    """Return a `Change` that adds a parameter of the effect to a parameter of the plant.

    A plant parameter of both springs changes on the side of the effect, or on both sides if it has none. A plant
    parameter of sensors changes for ``sensors``, or for the sensors in ``by_place`` at the place of the effect.
    """
    return partial(_add, quantity, parameter, sensors, by_place)


def scales(quantity: str, parameter: str) -> Change:
    """Return a `Change` that multiplies a parameter of the plant by 1 + a parameter of the effect."""
    return partial(_scale, quantity, parameter)


def _add(
    quantity: str,
    parameter: str,
    sensors: Sequence[int] | None,
    by_place: Sequence[int | Sequence[int]] | None,
    par: Any,
    place: int | None,
    values: Mapping[str, float],
) -> None:
    before = getattr(par, quantity)
    if np.ndim(before) == 0:
        setattr(par, quantity, before + values[parameter])
        return
    if by_place is not None:
        assert place is not None
        sensors = by_place[place]  # type: ignore[assignment]
    before[springs(place) if sensors is None else sensors] += values[parameter]


def _scale(quantity: str, parameter: str, par: Any, place: int | None, values: Mapping[str, float]) -> None:
    before, factor = getattr(par, quantity), 1.0 + values[parameter]
    if np.ndim(before) == 0:
        setattr(par, quantity, before * factor)
    else:
        before[springs(place)] *= factor


def free_slots(amounts: Any, wanted: int, what: str) -> int:
    """Return the index of the first free element. Raises ValueError if fewer than ``wanted`` elements are free."""
    used = int((amounts != 0.0).sum())
    if used + wanted > len(amounts):
        raise ValueError(
            f"{what}: {used} of {len(amounts)} are used and {wanted} more are needed; remove another effect"
        )
    return used


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect. With amplitude 0 `change` leaves the parameter record unchanged, bit for bit.

    Tests check the declared properties. If ``smooth``, the readings are continuously differentiable in the amplitude
    at 0. Unless it ``loses_air``, the mass of the air is constant and energy is conserved.
    """

    name: str
    family: str  #: one of `FAMILIES`
    title: str
    amplitude: EffectParameter
    change: Change
    plain: str = ""  #: sentence that describes the plant with the effect; {side} is replaced by its place
    shapes: tuple[EffectParameter, ...] = ()
    grid: tuple[tuple[float, ...], ...] = ((),)
    places: tuple[str, ...] = ()  #: () or `PLACES`
    touches: frozenset[str] = frozenset()  #: of force, gas, flow, sensor, timing
    confusers: tuple[str, ...] = ()
    richer: tuple[str, ...] = ()
    #: The phenomenon of which this effect is one law, if other effects describe the same; {side} is replaced by its
    #: place.
    phenomenon: str = ""
    equation: str = ""
    source: str = ""
    separated_by: str = ""  #: the run that distinguishes it from its confusers
    shown_by: ShownBy = ShownBy.MOTION
    loses_air: bool = False  #: air leaves the springs through it
    smooth: bool = True  #: False: readings jump as the amplitude grows, whichever size it has
    parameters: tuple[EffectParameter, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", (self.amplitude, *self.shapes))

    @property
    def diagnosable(self) -> bool:
        """Whether a diagnosis can identify this effect from the measured motion. Otherwise only the simulated rig can
        have it.
        """
        return self.smooth and self.shown_by is not ShownBy.COMMANDS
