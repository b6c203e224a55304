"""A signal: one value on a wire, with its unit, range, resolution and Modbus address."""

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from bench_protocol.table_groups import Group
from bench_protocol.units import FACTORS, UNITS, in_unit

__all__ = ["MEASURED", "Group", "Kind", "Signal"]

#: Names that codecs, the DBC and the drivers' attributes can use: ``device.reading``, small letters, digits, ``_``.
_NAME: Final = re.compile(r"[a-z][a-z0-9_]*\.[a-z0-9_]+")


class Kind(StrEnum):
    """The kind of a signal: who writes it, and where it is transmitted."""

    MEASUREMENT = "measurement"  #: a sensor of the rig: CAN and Modbus input registers
    STATUS = "status"  #: state of the rig: CAN and Modbus input registers
    SETPOINT = "set-point"  #: streamed by the commander on CAN
    SETTING = "setting"  #: staged in Modbus holding registers, taken over by APPLY
    ACTION = "action"  #: a Modbus coil that acts on its rising edge
    INTERLOCK = "interlock"  #: a Modbus discrete input
    FURTHER = "further measurement"  #: a sensor that rigs of others may have: no wire of ours carries it


#: Signals of sensors, built-in or third-party.
MEASURED: Final = (Kind.MEASUREMENT, Kind.FURTHER)


@dataclass(frozen=True, slots=True)
class Signal:
    """One value that crosses a wire. ``low``, ``high`` and ``step`` are SI; ``unit`` is the display unit.

    ``address`` is its permanent Modbus address: the input register of the float for a reading, the holding register for
    a setting, the coil for an action, the discrete input for an interlock; None for signals on CAN only.
    """

    name: str
    kind: Kind
    unit: str
    low: float
    high: float
    step: float
    description: str
    choices: tuple[str, ...] = ()
    default: float = 0.0
    address: int | None = None
    group: Group | None = None  #: of a measurement

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"signal name {self.name!r} must be device.reading in small letters, digits and underscores"
            )
        if self.unit not in FACTORS:
            raise ValueError(f"{self.name}: unit {self.unit!r} is unknown; use one of {', '.join(FACTORS)}")
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(
                f"{self.name}: range {self.low:g} to {self.high:g} is empty; low must be below high"
            )
        if not self.step > 0:
            raise ValueError(f"{self.name}: step = {self.step:g} must be positive")
        if not self.low <= self.default <= self.high and self.kind is Kind.SETTING:
            raise ValueError(
                f"{self.name}: default {self.default:g} is outside {self.low:g} to {self.high:g}"
            )
        if self.choices and self.high != len(self.choices) - 1:
            raise ValueError(
                f"{self.name}: high must be {len(self.choices) - 1}, the number of its last choice"
            )
        if self.choices and (self.low != 0 or self.step != 1):
            raise ValueError(
                f"{self.name}: low = {self.low:g} and step = {self.step:g}; with choices use low = 0 and step = 1"
            )
        if len(set(self.choices)) < len(self.choices):
            raise ValueError(f"{self.name}: two of its choices have the same name; rename one")
        if (self.group is None) is (self.kind in MEASURED):
            right = "add its group of sensors" if self.group is None else "remove group"
            raise ValueError(f"{self.name} is a {self.kind} with group = {self.group}; {right}")

    @property
    def attribute(self) -> tuple[str, str]:
        """The driver's device and attribute: ``left.height`` is ``bench.left.height``."""
        device, _, attribute = self.name.partition(".")
        return device, attribute

    @property
    def si(self) -> str:
        """The SI unit of the values in memory and in float registers."""
        return UNITS[self.unit].si

    def show(self, value: float) -> str:
        """Return ``value`` (SI) as text, in the display unit or by the name of the choice."""
        if self.choices and not math.isnan(value) and 0 <= round(value) < len(self.choices):
            return self.choices[round(value)]
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{in_unit(value, self.unit):g}{unit}"

    def reads(self, value: float) -> str:
        """Return ``value`` (SI, not a difference) as text, rounded to the step of the signal; temperatures in °C."""
        if self.choices or self.unit == "1":
            return self.show(value)
        unit = "degC" if self.unit == "K" else self.unit
        factor, zero = UNITS[unit].factor, UNITS[unit].zero
        decimals = max(0, -math.floor(math.log10(self.step / factor) + 1e-9))
        return f"{(value - zero) / factor:.{decimals}f} {'°C' if unit == 'degC' else unit}"

    def range_text(self) -> str:
        """Return the range of the signal in the messages as text, in its display unit."""
        if self.choices:
            return " | ".join(self.choices)
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{in_unit(self.low, self.unit):g} to {in_unit(self.high, self.unit):g}{unit}"

    def check(self, value: float) -> float:
        """Return ``value`` (SI) if it fits in the messages. Raises ValueError, with value, unit and range, if not."""
        if not self.low <= value <= self.high:
            raise ValueError(
                f"{self.name} = {self.show(value)} does not fit in the messages; use {self.range_text()}"
            )
        return value
