"""Single requests to a rig: settings with their checks, actions, contacts, and readings polled on request."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

from bench_protocol.clock import Clock
from bench_protocol.signals import Kind
from bench_protocol.units import NS
from bench_protocol.words import TO_SAFE
from drivers.errors import Misuse
from drivers.wiring.contract import Order, Sequences, Wiring, refuse_absent

#: Name of the state of a choice whose value is not known; no state has this name.
UNKNOWN: Final = "unknown"


def stop_orders(absent: Collection[str], sequences: Sequences) -> tuple[Order, ...]:
    """Return the shut-down orders of a rig without the action `TO_SAFE`; none if the rig has that action."""
    return sequences.rest if TO_SAFE in absent else ()


class Settings:
    """Writes settings all or none, triggers actions, and polls readings that do not arrive by themselves.

    Raises NotAvailable for a signal that the rig does not have.
    """

    def __init__(self, wiring: Wiring) -> None:
        self._wiring, self._table = wiring, wiring.table
        self._known: dict[str, float] = {}
        #: Called with the settings that the rig has accepted.
        self.applied: Callable[[dict[str, float]], None] = lambda values: None

    # -- settings ------------------------------------------------------------------------------------------------

    def number(self, name: str, value: float | str) -> float:
        """Return ``value``, a number (SI) or the name of a choice, as a number. Raises ValueError if it does not
        fit.
        """
        signal = self._table[name]
        if signal.kind is not Kind.SETTING:
            raise Misuse(f"{name} is a {signal.kind}; only settings can be written")
        if isinstance(value, str):
            if value not in signal.choices:
                right = signal.range_text() if signal.choices else f"a number in {signal.si}"
                raise ValueError(f"{name} = {value!r} is not valid; use {right}")
            return float(signal.choices.index(value))
        number = signal.check(float(value))
        if signal.choices and number != round(number):
            raise ValueError(
                f"{name} = {number:g} is not the number of a choice; use one of {signal.range_text()}"
            )
        return number

    def write(self, values: Mapping[str, float | str]) -> None:
        """Check all ``values`` and write them to the rig, all or none.

        Raises ValueError before anything is sent if one does not fit, and ``Refused`` if the rig rejects them.
        """
        checked = {name: self.number(name, value) for name, value in values.items()}
        refuse_absent(self._wiring, *checked)
        if checked:
            self._wiring.write(checked)
            self._known.update(checked)
            self.applied(checked)

    def read(self, name: str) -> float:
        """Return the value (SI) of an active setting in the rig."""
        if self._table[name].kind is not Kind.SETTING:
            raise Misuse(f"{name} is a {self._table[name].kind}, not a setting")
        return self.reading(name)

    def choice(self, name: str) -> str:
        """Return the name of the active choice in the rig; ``"unknown"`` if the rig does not report it."""
        number, choices = self.read(name), self._table[name].choices
        return choices[round(number)] if 0 <= number < len(choices) else UNKNOWN

    def in_force(self) -> dict[str, float]:
        """Return the active values (SI) of all settings that the rig has. Staged values are not included."""
        return self._read(self._present(Kind.SETTING))

    # -- actions, contacts, polled readings ----------------------------------------------------------------------

    def act(self, name: str) -> None:
        """Trigger an action by its name in the table (``action.apply``)."""
        actions = [signal.name for signal in self._table.of_kind(Kind.ACTION)]
        if name not in actions:
            raise Misuse(f"there is no action {name!r}; use one of {', '.join(actions)}")
        refuse_absent(self._wiring, name)
        self._wiring.act(name)

    def give(self, order: Order) -> None:
        """Write the settings and points of an order, and trigger its actions. The commander sends its set-points."""
        kinds = {name: self._table[name].kind if name in self._table.index else None for name in order.values}
        self.write({name: order.values[name] for name in kinds if kinds[name] is Kind.SETTING})
        for name in (name for name in kinds if kinds[name] is Kind.ACTION):
            self.act(name)
        if points := {name: order.values[name] for name in kinds if kinds[name] is None}:
            self._wiring.write_points(points)

    def go_safe(self, clock: Clock) -> None:
        """Order the safe position: by its action, or by the shut-down orders of a rig without that action.

        Raises NotAvailable if the rig has neither.
        """
        if not (orders := stop_orders(self._wiring.absent, self._wiring.sequences)):
            return self.act(TO_SAFE)
        for order in orders:
            self.give(order)
            clock.sleep_until(clock.now() + round(self._wiring.capabilities.latency * NS))

    def contact(self, name: str) -> bool:
        """Return the state of an interlock. True means what its description in the table of signals states, such as
        "The hard-wired emergency stop is pressed".
        """
        return self.reading(name) == 1

    def contacts(self) -> dict[str, bool]:
        """Return the states of all interlocks of the rig (see `contact`) by name."""
        contacts = self._read(self._present(Kind.INTERLOCK))
        return {name: on == 1 for name, on in contacts.items()}

    def reading(self, name: str) -> float:
        """Poll one value (SI) of the rig now; NaN if it has none."""
        refuse_absent(self._wiring, name)
        return self._read([name])[name]

    def readings(self, *names: str) -> dict[str, float]:
        """Poll several values (SI) of the rig now, as one snapshot if possible."""
        refuse_absent(self._wiring, *names)
        return self._read(names)

    def known(self, name: str) -> float:
        """Return the value (SI) read or written last, without a request to the rig; NaN before the first time."""
        return self._known.get(name, math.nan)

    def _read(self, names: Sequence[str]) -> dict[str, float]:
        values = self._wiring.read(names)
        self._known.update(values)
        return values

    def _present(self, kind: Kind) -> list[str]:
        return [signal.name for signal in self._table.of_kind(kind) if signal.name not in self._wiring.absent]
