"""What an effect is: a named cause that changes the plant's parameters, by an amount that is zero when it is absent."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

#: Where an effect of one spring can sit. An effect without a place concerns the bench as a whole, or both springs.
PLACES: Final = ("left", "right")


def springs(place: int | None) -> slice | int:
    """Index of one spring in a quantity that each has, or of both."""
    return slice(None) if place is None else place


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect, in SI: what it is without further knowledge, how far it may lie, what is possible."""

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


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect. With amplitude 0 `change` leaves the record bit for bit as it was; the output is C¹ in it at 0."""

    name: str
    family: str  #: rubber, gas, flow, sensor, acquisition, rig
    title: str
    amplitude: Quantity
    change: Change
    shapes: tuple[Quantity, ...] = ()
    grid: tuple[tuple[float, ...], ...] = ((),)
    places: tuple[str, ...] = ()  #: () or `PLACES`
    touches: frozenset[str] = frozenset()  #: of force, gas, flow, sensor, timing
    confusers: tuple[str, ...] = ()
    richer: tuple[str, ...] = ()
    equation: str = ""
    source: str = ""
    separated_by: str = ""  #: the run that tells it from its confusers
    diagnosable: bool = True  #: False: the rig can have it, but no replay of an imposed motion can tell
    parameters: tuple[Quantity, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", (self.amplitude, *self.shapes))
