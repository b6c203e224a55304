"""An effect is a named cause that changes the plant's parameters. Its amplitude is 0 when it is not present."""

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
    """Return the index of one spring in a quantity of both springs, or of both."""
    return slice(None) if place is None else place


class ShownBy(Enum):
    """The test that makes an effect visible in the readings of a bench."""

    MOTION = "the springs are moved, leveling and differential pressure valves isolated"
    CONNECTED_VALVES = "the springs are moved while these valves are connected and open"
    COMMANDS = "the actuators are commanded: what they then do is not enough"


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect, in SI: its nominal and typical values, and its limits."""

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
    """Return a change that adds a parameter of the effect to a quantity of the plant.

    A quantity of both springs changes on the side of the effect, or on both. A quantity of sensors changes for
    ``sensors``, or for those in ``by_place`` at the place of the effect.
    """
    return partial(_add, quantity, parameter, sensors, by_place)


def scales(quantity: str, parameter: str) -> Change:
    """Return a change that increases a quantity of the plant by a share, which is a parameter of the effect."""
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
    """Return the index of the first free element; raise ValueError if fewer than ``wanted`` are free."""
    used = int((amounts != 0.0).sum())
    if used + wanted > len(amounts):
        raise ValueError(
            f"{what}: {used} of {len(amounts)} are used and {wanted} more are needed; remove another effect"
        )
    return used


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect. With amplitude 0 `change` leaves the record unchanged, bit for bit.

    Its declared properties are tested: its readings are continuously differentiable in the amplitude at 0 (unless it is
    not ``smooth``), and air stays in the springs (unless it ``loses_air``) and keeps its energy.
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
        """Whether a replay of the measured motion can identify it; otherwise only the simulated rig can have it."""
        return self.smooth and self.shown_by is not ShownBy.COMMANDS
