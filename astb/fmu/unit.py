"""The content of one kind of FMU: its variables, the code inside, and the texts of its pages."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol.words import ACTUATORS, SIDES
from bench_sim.model.quantities import Quantity
from bench_sim.parameters.loading import Entry


class Kind(IntEnum):
    """The kind of a variable, which determines where an instance of the FMU stores it."""

    MOTION = 0  #: input, extrapolated within a communication step
    INPUT = 1  #: input, held over a communication step
    BEGIN = 2  #: initial parameter: the share of the air at the start
    FIXED = 3  #: parameter that cannot change after the start
    TUNABLE = 4  #: parameter that can change during a simulation
    OUTPUT = 5


#: Parameters that each actuator has.
_OF_ACTUATORS: Final = (
    "actuator_delay",
    "actuator_damping",
    "actuator_f",
    "actuator_relief",
    "actuator_s",
    "actuator_unload",
    "frame_",
)


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar variable, in SI.

    Outputs have no start value. With ``whole``, the values are integers that represent choices.
    """

    name: str
    unit: str
    kind: Kind
    place: int
    description: str
    start: float | None = None
    low: float = -inf
    high: float = inf
    whole: bool = False


@dataclass(frozen=True, slots=True)
class Code:
    """Two compiled functions, and the size of their working memory.

    ``start(x, memory, u, parameters, motion, air, work, out)`` begins at rest; all arguments except the inputs are
    zero. ``advance(x, memory, u, parameters, motion, since, dt, steps, work, out)`` advances by steps; the first one is
    ``since`` s after the motion was given. ``memory`` and ``parameters`` are arrays of one record. Neither function
    allocates arrays.
    """

    name: str
    start: Callable[..., Any]
    advance: Callable[..., Any]
    memory: np.dtype[np.void]
    parameters: np.dtype[np.void]
    states: int
    inputs: int
    motions: int
    outputs: int
    #: Rows of the working memory; each is as long as all states.
    rows: int
    #: Number of bytes of ``memory`` that are written, from the first on.
    remembered: int
    #: The C file that checks where the model is valid.
    checks: str


@dataclass(frozen=True, slots=True, eq=False)
class Unit:
    """An FMU to be written. Tools show ``name`` and ``said``; ``about`` are the paragraphs of its page."""

    code: Code
    name: str
    said: str
    about: tuple[str, ...]
    variables: Sequence[Variable]
    #: Default values of the parameters, as consecutive numbers.
    defaults: NDArray[np.float64]
    #: Indices by their names in C.
    places: Mapping[str, int]
    #: Pairs of parameters that only make sense in one order.
    orders: Sequence[tuple[str, str]] = ()


def offset(kinds: np.dtype[np.void], field: str) -> int:
    """Return the offset in bytes of a ``field`` in a record."""
    fields: Any = kinds.fields
    return int(fields[field][1])


def parameters_of(
    quantities: Sequence[Quantity],
    entries: Mapping[str, Entry],
    record: Any,
    kinds: np.dtype[np.void],
    fixed: Collection[str],
) -> Iterator[Variable]:
    """Yield the scalar variables of these ``quantities`` with bounds and provenance; ``record`` has their values.

    ``kinds`` is the data type in which the FMU stores them.
    """
    for quantity in quantities:
        name = quantity.name
        entry = entries[name]
        kind = Kind.FIXED if name in fixed else Kind.TUNABLE
        values = np.asarray(record[name], dtype=np.float64)
        first = offset(kinds, name) // 8
        text = f"{name.replace('_', ' ')}; {entry.provenance}: {entry.source}"
        for place, index in enumerate(np.ndindex(values.shape)):
            value, low, high = (float(one[index]) for one in (values, entry.low, entry.high))
            yield Variable(
                _scalar(name, values.shape, index),
                quantity.unit,
                kind,
                first + place,
                text,
                value,
                min(low, value),
                max(high, value),
            )


def _scalar(name: str, shape: tuple[int, ...], index: tuple[int, ...]) -> str:
    """Return the name of one element: with the name of its side or its actuator, or with indices from 1."""
    if not shape:
        return name
    if name.startswith(_OF_ACTUATORS):
        return f"{ACTUATORS[index[0]]}.{name}"
    if shape == (2,) and "_surface_" not in name:
        return f"{SIDES[index[0]]}.{name}"
    return f"{name}[{','.join(str(i + 1) for i in index)}]"
