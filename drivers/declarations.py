"""Declarations with which a device class lists its readings and settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Final, Generic, NoReturn, Self, TypeVar, overload

from bench_protocol.signals import MEASURED, Kind
from bench_protocol.suggestion import did_you_mean
from drivers.link import Link
from drivers.reading import Sample

#: Longest representation of a device on one line; a longer one has a line for each signal.
REPR_WIDTH: Final = 100


class Device:
    """A named part of the bench. Its class declares each signal in one line. Other attributes cannot be assigned."""

    __slots__ = ("_link", "_name")
    _link: Link
    _name: str

    def __init__(self, link: Link, name: str) -> None:
        object.__setattr__(self, "_link", link)
        object.__setattr__(self, "_name", name)
        for declaration in self.declarations():
            signal = link.table[declaration.full_name(self)]
            declaration.check(signal.kind, signal.name)
            declaration.__doc__ = f"{signal.description} ({signal.kind}, {signal.range_text()})."

    @classmethod
    def declarations(cls) -> list[Declaration[Any]]:
        """Return the declared signals of this device class."""
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

    if not TYPE_CHECKING:  # a type checker would accept any name because of it

        def __getattr__(self, name: str) -> NoReturn:
            raise no_such_attribute(self, name, "" if name.startswith("_") else self._name)

    def __setattr__(self, name: str, value: object) -> None:
        if not hasattr(type(self), name):
            known = [line.attribute for line in self.declarations()]
            raise AttributeError(
                f"{self._name} has no attribute {name!r} to set; {did_you_mean(name, known)}"
            )
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return the known values without a request to the rig, so that it is fast and raises no error."""
        values = [line.show(self._link, line.full_name(self)) for line in self.declarations()]
        head = f"<{type(self).__name__} {self._name}"
        if not values:
            return f"{head}>"
        text = f"{head}: {', '.join(values)}>"
        return text if len(text) <= REPR_WIDTH else "\n    ".join((f"{head}:", *values)) + ">"


def no_such_attribute(thing: object, name: str, called: str) -> AttributeError:
    """Return the error for a missing attribute ``name`` of ``thing``, with the nearest existing name.

    ``called`` names the thing in the message. Names with a leading underscore get no suggestion, because copies and
    notebooks request them.
    """
    if name.startswith("_"):
        return AttributeError(name)
    known = [one for one in dir(type(thing)) if not one.startswith("_")]
    # Given a name and an object, Python would append a second suggestion.
    return AttributeError(
        f"{called} has no attribute {name!r}; {did_you_mean(name, known)}", name="", obj=None
    )


T = TypeVar("T")


class Declaration(Generic[T]):
    """Declares an attribute of a device for the signal DEVICE.ATTRIBUTE, or DEVICE.NAME if ``name`` is given."""

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
        """Raise TypeError if the kind of the signal in the table differs from that of this declaration."""
        if kind not in self.kinds:
            raise TypeError(
                f"{name} is a {kind}, but is declared as {type(self).__name__}; correct the declaration"
            )

    @overload
    def __get__(self, device: None, owner: type[Device]) -> Self: ...
    @overload
    def __get__(self, device: Device, owner: type[Device]) -> T: ...
    def __get__(self, device: Device | None, owner: type[Device]) -> Self | T:
        return self if device is None else self.get(device._link, self.full_name(device))

    def __set__(self, device: Device, value: T) -> None:
        self.set(device._link, self.full_name(device), value)

    def show(self, link: Link, name: str) -> str:
        """Return the known value of the signal as text, without a request to the rig."""
        if name in link.wiring.absent:
            return f"{self.attribute}: absent ({link.wiring.absent[name]})"
        value = self.known(link, name)
        if math.isnan(value):
            return f"{self.attribute}: {self.unknown(link, name)}"
        return f"{self.attribute} = {link.table[name].show(value)}"

    def known(self, link: Link, name: str) -> float:
        """Return the value (SI) known without a request to the rig, NaN if there is none."""
        return link.settings.known(name)

    def unknown(self, link: Link, name: str) -> str:
        """Return as text the reason for a missing value."""
        return "not read yet"

    def get(self, link: Link, name: str) -> T:
        """Return the present value."""
        raise AttributeError(f"{name} cannot be read")

    def set(self, link: Link, name: str, value: T) -> None:
        """Write the value to the rig."""
        raise AttributeError(f"{name} is read from the rig and cannot be set; use a set-point or a setting")


class Reported(Declaration[T]):
    """A value that the rig reports by itself or on request."""

    def known(self, link: Link, name: str) -> float:
        return link.readings.known(name)

    def unknown(self, link: Link, name: str) -> str:
        return link.readings.unknown(name)


class Reading(Reported[float]):
    """A number (SI) that the rig reports; NaN if it is stale or not available."""

    kinds = (*MEASURED, Kind.STATUS)

    def get(self, link: Link, name: str) -> float:
        return link.readings.value(name)


class ChoiceReading(Reported[str]):
    """One of several named states that the rig reports; ``"unknown"`` if it is stale or not available."""

    kinds = (Kind.STATUS,)

    def get(self, link: Link, name: str) -> str:
        return link.readings.choice(name)


class Contact(Declaration[bool]):
    """A discrete input, polled at each access."""

    kinds = (Kind.INTERLOCK,)

    def get(self, link: Link, name: str) -> bool:
        return link.settings.contact(name)


class Streamed(Declaration[T]):
    """A value that the commander streams."""

    kinds = (Kind.SETPOINT,)

    def known(self, link: Link, name: str) -> float:
        return link.commander.value(name)

    def unknown(self, link: Link, name: str) -> str:
        return "not given"


class Setpoint(Streamed[float]):
    """A set-point, sent in every cycle. An assignment takes effect within one cycle; ``move_to`` of a device uses a
    ramp.
    """

    def get(self, link: Link, name: str) -> float:
        return link.commander.value(name)

    def set(self, link: Link, name: str, value: float) -> None:
        link.commander.set(name, value)


class Bit(Streamed[bool]):
    """A bit of the Control message."""

    def get(self, link: Link, name: str) -> bool:
        return link.commander.value(name) == 1

    def set(self, link: Link, name: str, value: bool) -> None:
        link.commander.set(name, float(value))


class Setting(Declaration[float]):
    """A number in a holding register. An assignment checks the value, writes it and activates it."""

    kinds = (Kind.SETTING,)

    def get(self, link: Link, name: str) -> float:
        return link.settings.read(name)

    def set(self, link: Link, name: str, value: float) -> None:
        link.settings.write({name: value})


class ChoiceSetting(Declaration[str]):
    """A choice in a holding register, by name. An assignment checks the choice, writes it and activates it."""

    kinds = (Kind.SETTING,)

    def get(self, link: Link, name: str) -> str:
        return link.settings.choice(name)

    def set(self, link: Link, name: str, value: str) -> None:
        link.settings.write({name: value})


class Action(Declaration[Callable[[], None]]):
    """An action of the rig, called as a function: ``bench.action.apply()`` sets its coil."""

    kinds = (Kind.ACTION,)

    def get(self, link: Link, name: str) -> Callable[[], None]:
        return lambda: link.settings.act(name)

    def unknown(self, link: Link, name: str) -> str:
        return link.table[name].description
