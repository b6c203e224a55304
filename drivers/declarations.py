"""The declarative lines with which a device says what can be read and set."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Generic, NoReturn, Self, TypeVar, overload

from bench_protocol.signals import Kind
from bench_protocol.suggestion import meant
from drivers.link import Link
from drivers.reading import Sample


class Device:
    """A named part of the bench. Its class declares every signal in one line; nothing else can be assigned."""

    __slots__ = ("_link", "_name")
    _link: Link
    _name: str

    def __init__(self, link: Link, name: str) -> None:
        object.__setattr__(self, "_link", link)
        object.__setattr__(self, "_name", name)
        for declaration in self.declarations():
            declaration.check(link.table[declaration.full_name(self)].kind, declaration.full_name(self))

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
        return self._link.sample(f"{self._name}.{attribute}")

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("_"):  # asked for by copies, notebooks and the like
            raise AttributeError(name)
        known = [one for one in dir(type(self)) if not one.startswith("_")]
        # With a name of its own Python would add what it thinks was meant, and say it twice.
        raise AttributeError(f"{self._name} has no {name!r}; {meant(name, known)}", name="", obj=None)

    def __setattr__(self, name: str, value: object) -> None:
        if not hasattr(type(self), name):
            known = [line.attribute for line in self.declarations()]
            raise AttributeError(f"{self._name} has no {name!r} to set; {meant(name, known)}")
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
        return self if device is None else self.get(device._link, self.full_name(device))

    def __set__(self, device: Device, value: T) -> None:
        self.set(device._link, self.full_name(device), value)

    def get(self, link: Link, name: str) -> T:
        """Return the present value."""
        raise AttributeError(f"{name} cannot be read")

    def set(self, link: Link, name: str, value: T) -> None:
        """Bring the value to the rig."""
        raise AttributeError(f"{name} is read from the rig and cannot be set")


class Reading(Declaration[float]):
    """A number that the rig reports: SI, NaN unless fresh and available."""

    kinds = (Kind.MEASUREMENT, Kind.STATUS)

    def get(self, link: Link, name: str) -> float:
        return link.readings.value(name)


class ChoiceReading(Declaration[str]):
    """One of several named states that the rig reports; ``"unknown"`` unless fresh."""

    kinds = (Kind.STATUS,)

    def get(self, link: Link, name: str) -> str:
        return link.readings.choice(name)


class Contact(Declaration[bool]):
    """A discrete input, read when asked."""

    kinds = (Kind.INTERLOCK,)

    def get(self, link: Link, name: str) -> bool:
        return link.settings.contact(name)


class Setpoint(Declaration[float]):
    """A value that the commander streams. Assigning jumps (the rig slews within one beat); ``move_to`` ramps."""

    kinds = (Kind.SETPOINT,)

    def get(self, link: Link, name: str) -> float:
        return link.commander.value(name)

    def set(self, link: Link, name: str, value: float) -> None:
        link.commander.set(name, value)


class Bit(Declaration[bool]):
    """A bit of the Control message."""

    kinds = (Kind.SETPOINT,)

    def get(self, link: Link, name: str) -> bool:
        return link.commander.value(name) == 1

    def set(self, link: Link, name: str, value: bool) -> None:
        link.commander.set(name, float(value))


class Setting(Declaration[float]):
    """A number in a holding register; assigning checks, stages and applies it."""

    kinds = (Kind.SETTING,)

    def get(self, link: Link, name: str) -> float:
        return link.settings.read(name)

    def set(self, link: Link, name: str, value: float) -> None:
        link.settings.write({name: value})


class ChoiceSetting(Declaration[str]):
    """A choice in a holding register, by name; assigning checks, stages and applies it."""

    kinds = (Kind.SETTING,)

    def get(self, link: Link, name: str) -> str:
        return link.settings.choice(name)

    def set(self, link: Link, name: str, value: str) -> None:
        link.settings.write({name: value})


class Action(Declaration[Callable[[], None]]):
    """A coil that acts on its rising edge: ``bench.action.apply()``."""

    kinds = (Kind.ACTION,)

    def get(self, link: Link, name: str) -> Callable[[], None]:
        return lambda: link.settings.act(name)
