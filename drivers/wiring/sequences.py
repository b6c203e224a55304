"""The sequences of a rig, read from its wiring: start-up, reset, shut-down, and orders on connection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol, get_args

from bench_protocol.signals import MEASURED, Kind
from bench_protocol.suggestion import did_you_mean
from bench_protocol.wires import Table
from bench_protocol.words import STATES, AirFate
from drivers.errors import WiringError
from drivers.wiring.contract import Order, Sequences, Step
from drivers.wiring.conversion import Choices
from drivers.wiring.file_keys import StepTable, WiringFile
from drivers.wiring.keys import AllAtOnce, convert, duration
from drivers.wiring.lines import Greetings, Source
from drivers.wiring.written import order_names, plain_number, si_value

#: Kinds of signals that are only read.
READ: Final = (*MEASURED, Kind.STATUS, Kind.INTERLOCK)
_FATES: Final[tuple[AirFate, ...]] = get_args(AirFate)


class NotePoint(Protocol):
    """Register the point that the line ``key`` names. Raises WiringError for an invalid one."""

    def __call__(self, key: str, point: str, *, written: bool) -> None: ...


class SequenceReader:
    """Reads the table ``[sequences]`` at ``where`` in a ``file``, for a rig with these sources."""

    def __init__(
        self,
        where: str,
        file: WiringFile,
        table: Table,
        sources: Mapping[str, Source],
        absent: Mapping[str, str],
        point: NotePoint,
    ) -> None:
        self._where, self._table = where, table
        self._keys, self._transports = file.sequences, file.transports
        self._sources, self._absent, self._point = sources, absent, point

    def sequences(self) -> Sequences:
        """Return the sequences. Raises WiringError for all invalid steps and orders."""
        where, table = self._where, self._keys
        states = self._states()
        with AllAtOnce() as wrong:
            for state in table.at_rest:
                with wrong.next():
                    self._state(f"{where}.at_rest", state, states)
            with wrong.next():
                up = self._steps(f"{where}.up", table.up, states)
            with wrong.next():
                reset = self._steps(f"{where}.reset", table.reset, states)
            with wrong.next():
                rest = self._orders(f"{where}.rest", table.rest)
            air: dict[str, AirFate] = {}
            for state, given in table.air.items():
                with wrong.next():
                    air[state] = self._fate(f"{where}.air", state, given, states)
        return Sequences(up, reset, rest, tuple(table.at_rest), air)

    def greetings(self) -> Greetings:
        """Return the orders after connecting, before disconnecting, and after writing settings: points and actions."""
        found = []
        for key in ("open", "close", "apply"):
            where, tables = f"{self._where}.{key}", getattr(self._keys, key)
            orders = self._orders(where, tables)
            for name in (name for order in orders for name in order.values):
                if name in self._table.index and self._table[name].kind is not Kind.ACTION:
                    raise WiringError(
                        f"{where}: {name} is a {self._table[name].kind}; use points and actions"
                    )
            found.append(orders)
        return Greetings(*found)

    def _states(self) -> Sequence[str]:
        """Return the states that the rig can report; all states if the line of ``rig.state`` is invalid, none if the
        rig has no state. Raises WiringError for sequences without a state.
        """
        source = self._sources.get("rig.state")
        if source is None and "rig.state" not in self._absent:
            return STATES
        if source is None:
            if self._keys.up or self._keys.reset or self._keys.rest:
                raise WiringError(
                    f'{self._where} change the state of the rig, but signals."rig.state" is missing or '
                    'absent; state the point of "rig.state"'
                )
            return ()
        assert isinstance(source.conversion, Choices), "a state is a choice"
        return [STATES[number] for number in source.conversion.numbers]

    def _state(self, where: str, state: str, states: Sequence[str]) -> None:
        if state not in STATES:
            raise WiringError(f"{where}: {state!r} is not a state of a bench; {did_you_mean(state, STATES)}")
        if state not in states:
            raise WiringError(
                f'{where}: the rig never reports {state}; signals."rig.state".choices has {", ".join(states)}'
            )

    def _fate(self, where: str, state: str, given: str, states: Sequence[str]) -> AirFate:
        """Return the state of the air in a state of the rig."""
        self._state(where, state, states)
        for fate in _FATES:
            if fate == given:
                return fate
        raise WiringError(f"{where}.{state} = {given!r} is unknown; {did_you_mean(given, _FATES)}")

    def _steps(self, where: str, tables: Sequence[Any], states: Sequence[str]) -> tuple[Step, ...]:
        steps = []
        with AllAtOnce() as wrong:
            for number, given in enumerate(tables, 1):
                with wrong.next():
                    steps.append(self._step(f"{where}[{number}]", given, states))
        return tuple(steps)

    def _step(self, place: str, given: Any, states: Sequence[str]) -> Step:
        table = convert(place, given, StepTable)
        for key, names in (("start", table.start), ("end", table.end)):
            if not names:
                raise WiringError(f"{place}.{key} is empty; write one state or several")
            for state in names:
                self._state(f"{place}.{key}", state, states)
        return Step(
            tuple(table.start),
            self._orders(f"{place}.orders", table.orders),
            tuple(table.end),
            self._orders(f"{place}.prepare", table.prepare),
            table.bumpless,
            self._orders(f"{place}.afterwards", table.afterwards),
            duration(f"{place}.within", table.within) if table.within else None,
        )

    def _orders(self, where: str, tables: Sequence[Mapping[str, Any]]) -> tuple[Order, ...]:
        orders = []
        with AllAtOnce() as wrong:
            for number, given in enumerate(tables, 1):
                values: dict[str, float] = {}
                for name, value in order_names(given):
                    with wrong.next():
                        values[name] = self._ordered(f"{where}[{number}]", name, value)
                orders.append(Order(values))
        return tuple(orders)

    def _ordered(self, where: str, name: str, given: Any) -> float:
        """Return the SI value that an order gives ``name``, a signal or a point of the rig."""
        if name not in self._table.index:
            if name.partition(".")[0] not in self._transports:
                known = [*self._table.index, *(f"{transport}." for transport in self._transports)]
                raise WiringError(
                    f"{where}: {name!r} is neither a signal nor a point; {did_you_mean(name, known)}"
                )
            self._point(where, name, written=True)
            return plain_number(f"{where}.{name}", given)
        signal = self._table[name]
        if signal.kind in READ:
            raise WiringError(f"{where}: {name} is a {signal.kind} and cannot be ordered; remove it")
        if name in self._absent:
            raise WiringError(f"{where}: the rig has no {name} ({self._absent[name]}); remove it")
        return si_value(f"{where}.{name}", signal, given)
