"""A simulated fault: its name, its place, its parameters with unit and range, and what a driver sees of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from bench_protocol.suggestion import did_you_mean
from bench_protocol.table import TABLE
from bench_protocol.units import WRITTEN_UNITS
from bench_sim.parameters.loading import ParameterError, read_value
from bench_sim.rig.faults.insertion import InsertionPoints

#: Marks a number in the unit of the sensor that has the fault, and a number in this unit per second.
OF_SENSOR: Final = "of the sensor"
OF_SENSOR_PER_SECOND: Final = "of the sensor, per second"

#: Values of a fault's parameters by name: numbers in SI, choices as texts.
Values = Mapping[str, Any]
#: Breaks something at the insertion points, and returns what repairs it.
Begin = Callable[[InsertionPoints, Values], Callable[[], None]]


class FaultError(ValueError):
    """An unknown fault or an invalid value. The text states the correct form."""


class FaultPlace(StrEnum):
    """The part of the rig that has the fault."""

    BUS = "bus"
    MODBUS = "modbus"
    SENSORS = "sensors"
    PLANT = "plant"
    RIG = "rig"


@dataclass(frozen=True, slots=True)
class FaultNumber:
    """A numeric parameter of a fault, with its range in ``unit``. Without a default, the user must give a value."""

    name: str
    unit: str  #: one of `WRITTEN_UNITS`, `OF_SENSOR` or `OF_SENSOR_PER_SECOND`
    low: float
    high: float
    text: str
    default: float | None = None
    whole: bool = False

    @property
    def span(self) -> str:
        """Return the range as text."""
        if self.unit in (OF_SENSOR, OF_SENSOR_PER_SECOND):
            return f"± the range {self.unit}"
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.low:g} to {self.high:.12g}{unit}"

    @property
    def usual(self) -> str:
        """Return the default as text, or "" if there is none."""
        if self.default is None:
            return ""
        return f"{self.default:g}" + ("" if self.unit == "1" else f" {self.unit}")

    @property
    def of_sensor(self) -> bool:
        """Whether unit and range depend on the sensor that has the fault."""
        return self.unit in (OF_SENSOR, OF_SENSOR_PER_SECOND)

    def span_for(self, sensor: str) -> str:
        """Return the range as text. If the range depends on a sensor, that of ``sensor`` is used."""
        unit, low, high = self._range(sensor)
        return f"{low:g} to {high:.12g}" + ("" if unit == "1" else f" {unit}")

    def _range(self, sensor: str) -> tuple[str, float, float]:
        """Return the unit, and the limits in this unit. They may depend on ``sensor``."""
        if not self.of_sensor:
            return self.unit, self.low, self.high
        signal = TABLE[sensor]
        unit, rate = signal.unit, self.unit == OF_SENSOR_PER_SECOND
        if rate:
            unit = next((one for one in (f"{unit}/s", f"{signal.si}/s") if one in WRITTEN_UNITS), "m/s3")
        elif unit not in WRITTEN_UNITS:
            unit = signal.si
        high = (signal.high - signal.low) / WRITTEN_UNITS[unit].factor
        return unit, -high, high

    def read(self, text: Any, sensor: str) -> float:
        """Return ``text`` as a number in SI. ``sensor`` is needed if the unit depends on it. Raises FaultError for an
        invalid text.
        """
        unit, low, high = self._range(sensor)
        si, factor, _ = WRITTEN_UNITS[unit]
        try:
            value = read_value(self.name, text, si)
        except ParameterError as error:
            raise FaultError(str(error)) from None
        # In the unit of the text: 0.3 bar is not exactly 0.3 times 100 000 Pa.
        slack = 1e-12 * max(abs(low), abs(high)) * factor
        if not low * factor - slack <= value <= high * factor + slack:
            raise FaultError(f"{self.name} = {text} is outside {self.span_for(sensor)}")
        if self.whole and value != round(value):
            raise FaultError(
                f"{self.name} = {text} is not a whole number; use one from {self.span_for(sensor)}"
            )
        return value


@dataclass(frozen=True, slots=True)
class FaultChoice:
    """A parameter of a fault with a choice of words. Without a default, the user must give one of them."""

    name: str
    choices: tuple[str, ...]
    text: str
    default: str | None = None

    @property
    def span(self) -> str:
        """Return the choices as text."""
        return " or ".join(f"`{choice}`" for choice in self.choices)

    @property
    def usual(self) -> str:
        """Return the default, or "" if there is none."""
        return self.default or ""

    def read(self, text: Any, sensor: str) -> str:
        """Return ``text`` if it is one of the choices. Otherwise raises FaultError."""
        del sensor
        if str(text) in self.choices:
            return str(text)
        raise FaultError(f"{self.name} = {text} is unknown; {did_you_mean(text, self.choices)}")


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault. ``target`` is the name of a parameter, or "". With a target, the fault can be active several
    times, once for each value of the target.
    """

    name: str
    place: FaultPlace
    title: str  #: one sentence that describes the fault
    seen: str  #: one sentence: the effect for a driver
    begin: Begin
    parameters: tuple[FaultNumber | FaultChoice, ...] = ()
    target: str = ""
    lasts: float | None = None  #: s, if no duration is given

    def read(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all values (numbers in SI, choices as text) from texts with units, such as ``{"area": "2 mm2"}``.

        Raises FaultError with name, value, unit and correct form.
        """
        known = {one.name: one for one in self.parameters}
        for key in given:
            if key not in known:
                raise FaultError(f"{key} is not a parameter of {self.name}; {did_you_mean(key, known)}")
        values: dict[str, Any] = {}
        try:
            for one in self.parameters:
                text = given.get(one.name, one.usual)
                if text == "":
                    raise FaultError(f"{one.name} ({one.text}) is missing; use {one.span}".replace("`", ""))
                values[one.name] = one.read(text, str(values.get("sensor", "")))
        except FaultError as error:
            raise FaultError(f"{self.name}: {error}") from None
        return values

    def label(self, values: Values) -> str:
        """Return the label of the active fault, such as ``bias.left.height``. Without a target it is the name of the
        fault.
        """
        return f"{self.name}.{values[self.target]}" if self.target else self.name
