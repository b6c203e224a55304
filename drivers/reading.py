"""Readings with an age and a quality, and the declarative lines with which a device says what can be read and set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, Final, Generic, Self, TypeVar, overload

from bench_protocol.signals import Kind
from bench_protocol.units import NS
from drivers.receiver import Receiver, stale_limits

if TYPE_CHECKING:
    from drivers.bench import Bench

#: What a choice reads as while nothing is known of it: equal to no state.
UNKNOWN: Final = "unknown"


class Quality(StrEnum):
    """How much a reading can be trusted."""

    GOOD = "good"
    STALE = "stale"  #: the last sample is too old
    MISSING = "missing"  #: no sample has come yet
    UNAVAILABLE = "unavailable"  #: the rig says that it has no value


@dataclass(frozen=True, slots=True)
class Sample:
    """A value (SI, NaN unless good), how old it is (s, infinite before the first) and its quality."""

    value: float
    age: float
    quality: Quality


class Readings:
    """The present value of every measurement and status row of the table, from CAN or, where CAN lacks it, Modbus."""

    def __init__(self, receiver: Receiver, slow: Callable[[str], float]) -> None:
        self._receiver, self._slow = receiver, slow
        self._table, self._clock = receiver.table, receiver.clock
        self._limits = [int(limit) for limit in stale_limits(self._table)]
        self._seen: dict[str, None] | None = None

    def sample(self, name: str) -> Sample:
        """Return value, age and quality of the signal ``name``; KeyError if the table has no such signal."""
        row = self._table.index[self._table[name].name]
        if self._seen is not None:
            self._seen[name] = None
        if self._limits[row] == 0:
            value = self._slow(name)
            return Sample(value, 0.0, Quality.UNAVAILABLE if math.isnan(value) else Quality.GOOD)
        value, time = self._receiver.look(row)
        if time < 0:
            return Sample(math.nan, math.inf, Quality.MISSING)
        age = max(0, self._clock.now() - time)
        if age > self._limits[row]:
            return Sample(math.nan, age / NS, Quality.STALE)
        return Sample(value, age / NS, Quality.UNAVAILABLE if math.isnan(value) else Quality.GOOD)

    def value(self, name: str) -> float:
        """Return the value of ``name`` (SI), NaN unless it is good."""
        if self._seen is not None:
            self._seen[name] = None
        row = self._table.index[name]
        limit = self._limits[row]
        if limit == 0:
            return self._slow(name)
        value, time = self._receiver.look(row)
        return value if time >= 0 and self._clock.now() - time <= limit else math.nan

    def show(self, name: str) -> str:
        """Return ``name = value unit`` for people, or why there is no value."""
        sample = self.sample(name)
        if sample.quality is Quality.GOOD:
            return f"{name} = {self._table[name].show(sample.value)}"
        since = f" for {sample.age:.3g} s" if sample.quality is Quality.STALE else ""
        return f"{name} is {sample.quality}{since}"

    @contextmanager
    def watched(self) -> Iterator[dict[str, None]]:
        """Collect the names that are read meanwhile (for the message of a wait that failed)."""
        seen: dict[str, None] = {}
        self._seen = seen
        try:
            yield seen
        finally:
            self._seen = None


class Device:
    """A named part of the bench. Its class declares every signal in one line; nothing else can be assigned."""

    __slots__ = ("_bench", "_name")
    _bench: Bench
    _name: str

    def __init__(self, bench: Bench, name: str) -> None:
        object.__setattr__(self, "_bench", bench)
        object.__setattr__(self, "_name", name)
        for declaration in self.declarations():
            declaration.check(bench.table[declaration.full_name(self)].kind, declaration.full_name(self))

    @classmethod
    def declarations(cls) -> list[Declaration[Any]]:
        """Return the declared signals of this kind of device."""
        found = {
            name: line
            for base in reversed(cls.__mro__)
            for name, line in vars(base).items()
            if isinstance(line, Declaration)
        }
        return list(found.values())

    def signals(self) -> list[str]:
        """Return the names of the signals of this device, as in the table."""
        return [declaration.full_name(self) for declaration in self.declarations()]

    def sample(self, attribute: str) -> Sample:
        """Return value, age and quality of one of its readings."""
        return self._bench.sample(f"{self._name}.{attribute}")

    def __setattr__(self, name: str, value: object) -> None:
        if not hasattr(type(self), name):
            raise AttributeError(
                f"{self._name} has no {name!r} to set; it has {', '.join(d.name for d in self.declarations())}"
            )
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._name}>"


T = TypeVar("T")


class Declaration(Generic[T]):
    """One line of a device: which signal it is. The name is that of the attribute unless told otherwise."""

    kinds: ClassVar[tuple[Kind, ...]] = ()

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.attribute = ""

    def __set_name__(self, owner: type[Device], attribute: str) -> None:
        self.attribute = attribute
        self.name = self.name or attribute

    def full_name(self, device: Device) -> str:
        """Return the name of the signal in the table."""
        return f"{device._name}.{self.name}"

    def check(self, kind: Kind, name: str) -> None:
        """TypeError if the table knows the signal as something else than this declaration does."""
        if kind not in self.kinds:
            raise TypeError(f"{name} is a {kind}, declared as {type(self).__name__}")

    @overload
    def __get__(self, device: None, owner: type[Device]) -> Self: ...
    @overload
    def __get__(self, device: Device, owner: type[Device]) -> T: ...
    def __get__(self, device: Device | None, owner: type[Device]) -> Self | T:
        return self if device is None else self.get(device._bench, self.full_name(device))

    def __set__(self, device: Device, value: T) -> None:
        self.set(device._bench, self.full_name(device), value)

    def get(self, bench: Bench, name: str) -> T:
        """Return the present value."""
        raise AttributeError(f"{name} cannot be read")

    def set(self, bench: Bench, name: str, value: T) -> None:
        """Bring the value to the rig."""
        raise AttributeError(f"{name} is read from the rig and cannot be set")


class Reading(Declaration[float]):
    """A number that the rig reports: SI, NaN unless fresh and available."""

    kinds = (Kind.MEASUREMENT, Kind.STATUS)

    def get(self, bench: Bench, name: str) -> float:
        return bench.readings.value(name)


class ChoiceReading(Declaration[str]):
    """One of several named states that the rig reports; ``"unknown"`` unless fresh."""

    kinds = (Kind.STATUS,)

    def get(self, bench: Bench, name: str) -> str:
        value = bench.readings.value(name)
        choices = bench.table[name].choices
        return choices[round(value)] if not math.isnan(value) and 0 <= value < len(choices) else UNKNOWN


class Contact(Declaration[bool]):
    """A discrete input, read when asked."""

    kinds = (Kind.INTERLOCK,)

    def get(self, bench: Bench, name: str) -> bool:
        return bench.settings.contact(name)


class Setpoint(Declaration[float]):
    """A value that the commander streams. Assigning jumps (the rig slews within one beat); ``move_to`` ramps."""

    kinds = (Kind.SETPOINT,)

    def get(self, bench: Bench, name: str) -> float:
        return bench.commander.value(name)

    def set(self, bench: Bench, name: str, value: float) -> None:
        bench.commander.set(name, value)


class Bit(Declaration[bool]):
    """A bit of the Control message."""

    kinds = (Kind.SETPOINT,)

    def get(self, bench: Bench, name: str) -> bool:
        return bench.commander.value(name) == 1

    def set(self, bench: Bench, name: str, value: bool) -> None:
        bench.commander.set(name, float(value))


class Setting(Declaration[float]):
    """A number in a holding register; assigning checks, stages and applies it."""

    kinds = (Kind.SETTING,)

    def get(self, bench: Bench, name: str) -> float:
        return bench.settings.read(name)

    def set(self, bench: Bench, name: str, value: float) -> None:
        bench.settings.write({name: value})


class ChoiceSetting(Declaration[str]):
    """A choice in a holding register, by name; assigning checks, stages and applies it."""

    kinds = (Kind.SETTING,)

    def get(self, bench: Bench, name: str) -> str:
        return bench.table[name].choices[round(bench.settings.read(name))]

    def set(self, bench: Bench, name: str, value: str) -> None:
        bench.settings.write({name: value})


class Action(Declaration[Callable[[], None]]):
    """A coil that acts on its rising edge: ``bench.action.apply()``."""

    kinds = (Kind.ACTION,)

    def get(self, bench: Bench, name: str) -> Callable[[], None]:
        return lambda: bench.settings.act(name)
