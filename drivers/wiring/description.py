"""The description of a rig's wiring: a TOML file, read and checked before anything is connected.

Errors are WiringError and name file, key, value and allowed values. Each transport has its own keys under
``[transports.NAME]``, which `drivers.wiring.transports` reads. docs/reference/wiring.md explains every key.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import msgspec

from bench_protocol.input_limits import read_toml
from bench_protocol.os_errors import file_errors
from bench_protocol.signals import Kind, Signal
from bench_protocol.suggestion import did_you_mean
from bench_protocol.wires import Table
from drivers.errors import WiringError
from drivers.wiring.astb.keys import KIND
from drivers.wiring.contract import Capabilities
from drivers.wiring.conversion import Conversion, Linear, conversion, quantity
from drivers.wiring.expression import Combine, expression
from drivers.wiring.file_keys import SignalEntry, WiringFile
from drivers.wiring.keys import AllAtOnce, convert, duration
from drivers.wiring.lines import PLAYED, Description, PlayerLimits, SettingTarget, Source, Target
from drivers.wiring.sequences import READ, SequenceReader
from drivers.wiring.transports import open_all
from drivers.wiring.user_functions import functions_file, user_function
from drivers.wiring.written import order_names, plain_number, si_value

#: The kind of its named files.
PACKAGE: Final = "wirings"
#: Permitted difference of a setting that is read back, as a share of its range, because a rig rounds values.
_ROUNDED: Final = 0.001
#: The name of the table ``[sequences]`` in files of version 0.1.
_EARLIER: Final = "conduct"
_NOT_MENTIONED: Final = "the wiring does not mention it"


def read_description(path: Path, table: Table) -> Description:
    """Return the content of the wiring file ``path``."""
    with file_errors(f"wiring file {path}", WiringError):
        content = read_toml(path)
    return describe(content, path, table, whole=True)


def describe(
    content: Mapping[str, Any], where: Path, table: Table, under: str = "", *, whole: bool = False
) -> Description:
    """Return the description in ``content``, the keys of the file ``where`` (below its key ``under``, if given).

    All errors are raised at once. If ``whole``, the transports are checked too.
    """
    head = f"{where}: {under}." if under else f"{where}: "
    called = _EARLIER if _EARLIER in content else "sequences"
    if called == _EARLIER:
        if "sequences" in content:
            raise WiringError(f"{head}{_EARLIER} is the earlier name of sequences; keep only one of them")
        content = {"sequences" if key == _EARLIER else key: given for key, given in content.items()}
    keys = convert(head.rstrip(".: "), content, WiringFile)
    reader = _Reader(keys, where, head, table, called)
    with AllAtOnce() as wrong:
        with wrong.next():
            return reader.read()
        if whole:
            with wrong.next():
                open_all(where, keys.transports, reader.points, functions=reader.functions)
    raise AssertionError("something was wrong")


class _Reader:
    """Reads one description."""

    def __init__(self, keys: WiringFile, where: Path, head: str, table: Table, called: str) -> None:
        self._keys, self._where, self._head, self._table, self._called = keys, where, head, table, called
        self.points: list[tuple[str, str, bool]] = []
        self._written: dict[str, str] = {}
        self.functions = functions_file(f"{head}functions", keys.functions, where.parent)
        self._sources: dict[str, Source] = {}
        self._setpoints: dict[str, Target] = {}
        self._settings: dict[str, SettingTarget] = {}
        self._actions: dict[str, tuple[str, tuple[float, ...]]] = {}
        self._absent: dict[str, str] = {}

    def read(self) -> Description:
        keys, head = self._keys, self._head
        carrier = self._carrier()
        with AllAtOnce() as wrong:
            entries: dict[str, tuple[str, Any]] = {}
            with wrong.next():
                self._find_entries(entries)
            for name, (where, given) in entries.items():
                with wrong.next():
                    self._signal(where, self._table[name], convert(where, given, SignalEntry))
            player = None
            with wrong.next():
                player = None if keys.capabilities.generator else self._player()
            unsaid = [
                signal.name
                for signal in self._table.signals
                if signal.name not in entries and not (player and signal.name.startswith(PLAYED))
            ]
            # A transport of kind astb carries all signals of our own messages and registers that have no line.
            carried = [name for name in unsaid if carrier and self._table[name].kind is not Kind.FURTHER]
            unmentioned = [name for name in unsaid if name not in carried]
            self._absent = dict.fromkeys(unmentioned, _NOT_MENTIONED) | self._absent
            with wrong.next():
                identity = self._identity()
            with wrong.next():
                latency = duration(f"{head}latency", keys.latency) if keys.latency else 0.0
            reader = SequenceReader(
                f"{head}{self._called}", keys, self._table, self._sources, self._absent, self._point
            )
            with wrong.next():
                sequences = reader.sequences()
            with wrong.next():
                greetings = reader.greetings()
        capabilities = Capabilities(
            generator=keys.capabilities.generator,
            pace={"m": player.speed, "rad": player.roll_rate, "N": player.force_rate} if player else {},
            latency=latency,
            notes={**keys.capabilities.notes, **self._remembered()},
        )
        return Description(
            self._where,
            self._digest(),
            self._table,
            keys.description,
            keys.transports,
            capabilities,
            sequences,
            greetings,
            player,
            identity,
            self.functions,
            self._sources,
            self._setpoints,
            self._settings,
            self._actions,
            self._absent,
            tuple(self.points),
            carrier,
            frozenset(carried),
        )

    def _carrier(self) -> str:
        """Return the name of the transport for all signals without a line; "" if there is none."""
        transports = self._keys.transports
        if not transports:
            raise WiringError(
                f"{self._head}transports is empty; add a table [transports.NAME] with the kind of the "
                "connection"
            )
        for name in transports:
            if not name.isidentifier():
                raise WiringError(
                    f"{self._head}transports.{name}: the name must be one word of letters, digits and _"
                )
        names = [name for name, table in transports.items() if table.get("kind") == KIND]
        if len(names) > 1:
            raise WiringError(
                f"{self._head}transports: {' and '.join(names)} are of kind {KIND}; keep only one of them"
            )
        return "".join(names)

    def _identity(self) -> dict[str, float]:
        where, found = f"{self._head}identity", {}
        for point, value in order_names(self._keys.identity):
            self._point(where, point, written=False)
            found[point] = plain_number(f"{where}.{point}", value)
        return found

    def _remembered(self) -> dict[str, str]:
        """Return a sentence, for notes on the rig, on the settings that no point reads back; empty if there are
        none.
        """
        names = [name for name, one in self._settings.items() if one.fixed is None and not one.read]
        return {"settings": f"assumed to be the last written value: {', '.join(names)}"} if names else {}

    def _digest(self) -> str:
        keys = msgspec.to_builtins(self._keys)
        keys[_EARLIER] = keys.pop("sequences")  # a file keeps its digest
        digest = sha256(msgspec.json.encode(keys, order="deterministic"))
        if self.functions is not None:
            digest.update(self.functions.read_bytes())
        return digest.hexdigest()

    # -- signals -------------------------------------------------------------------------------------------------

    def _find_entries(self, found: dict[str, tuple[str, Any]]) -> None:
        """Add the lines under ``[signals]`` to ``found`` by signal: their place and content."""
        with AllAtOnce() as wrong:
            for key, given in self._keys.signals.items():
                nested = "." not in key and isinstance(given, Mapping)
                lines = {f"{key}.{sub}": one for sub, one in given.items()} if nested else {key: given}
                for name, entry in lines.items():
                    with wrong.next():
                        found[name] = self._entry(name, found), entry

    def _entry(self, name: str, others: Collection[str]) -> str:
        """Return the place of a signal's line. Raises WiringError for a line that the file must not have."""
        where = f'{self._head}signals."{name}"'
        if name not in self._table.index:
            raise WiringError(f"{where} is not a signal; {did_you_mean(name, self._table.index)}")
        if name in others:
            raise WiringError(f"{where} occurs twice; keep one line")
        if not self._keys.capabilities.generator and name.startswith(PLAYED):
            raise WiringError(
                f"{where} is not needed, because this computer plays the waves of a rig without a "
                "generator; remove the line, or set capabilities.generator = true if the rig has one"
            )
        return where

    def _signal(self, where: str, signal: Signal, entry: SignalEntry) -> None:
        if entry.absent:
            others = [key for key in _changed_keys(entry) if key != "absent"]
            if others:
                raise WiringError(f"{where} has absent and {', '.join(others)}; keep one of them")
            self._absent[signal.name] = entry.absent
            return
        _refuse_wrong_keys(where, signal, entry)
        if signal.kind in READ:
            self._sources[signal.name] = self._source(where, signal, entry)
        elif signal.kind is Kind.SETPOINT:
            point = self._target(where, signal, entry.target)
            if entry.given:
                self._point(f"{where}.given", entry.given, written=False)
            conversion = self._conversion(where, signal, entry)
            mute = [one for k, one in enumerate(signal.choices) if math.isnan(conversion.number(k))]
            if mute:
                raise WiringError(
                    f"{where}.choices lacks {', '.join(mute)}; add the number that is sent for it"
                )
            self._setpoints[signal.name] = Target(point, conversion, entry.given)
        elif signal.kind is Kind.SETTING:
            self._settings[signal.name] = self._setting(where, signal, entry)
        else:
            point = self._target(where, signal, entry.target, shared=True)
            values = entry.value if isinstance(entry.value, list) else [entry.value or 1]
            numbers = tuple(plain_number(f"{where}.value", value) for value in values)
            if not numbers:
                raise WiringError(f"{where}.value is empty; write the number that is sent to {point}")
            self._actions[signal.name] = point, numbers

    def _source(self, where: str, signal: Signal, entry: SignalEntry) -> Source:
        points = [entry.source] if isinstance(entry.source, str) else entry.source
        if not points:
            raise WiringError(f'{where}.from is missing; state the point of the rig, or absent = "reason"')
        for point in points:
            self._point(f"{where}.from", point, written=False)
        if entry.value and entry.function:
            raise WiringError(f"{where} has a value and a function; keep one of them")
        combine: Combine | None = None
        if entry.value:
            if not isinstance(entry.value, str):
                raise WiringError(
                    f"{where}.value = {entry.value!r} is not a text; write an expression in quotes"
                )
            names = [point.rpartition(".")[2] for point in points]
            if len(set(names)) < len(names):
                raise WiringError(
                    f"{where}.from: two points are called {' and '.join(names)}; use a function"
                )
            combine = expression(f"{where}.value", entry.value, names)
        elif entry.function:
            combine = self._function(f"{where}.function", entry.function, len(points))
        elif len(points) > 1:
            raise WiringError(
                f"{where}.from has {len(points)} points; add value (an expression) or function to "
                "compute one number from them"
            )
        return Source(tuple(points), combine, self._conversion(where, signal, entry))

    def _setting(self, where: str, signal: Signal, entry: SignalEntry) -> SettingTarget:
        if entry.fixed != "":
            if entry.target or entry.read or entry.initial != "":
                raise WiringError(f"{where} is fixed, so nothing is written or read; keep only the key fixed")
            fixed = si_value(f"{where}.fixed", signal, entry.fixed)
            return SettingTarget("", "", Linear(1.0, 0.0), 0.0, 0.0, fixed, fixed)
        point = self._target(where, signal, entry.target)
        if entry.read:
            self._point(f"{where}.read", entry.read, written=False)
            if entry.initial != "":
                raise WiringError(
                    f"{where} has read and initial; remove initial, because the start value is read"
                )
        initial = si_value(f"{where}.initial", signal, entry.initial) if entry.initial != "" else math.nan
        within = duration(f"{where}.within", entry.within)
        tolerance = 0.5 if signal.choices else max(signal.step, _ROUNDED * (signal.high - signal.low))
        if entry.tolerance:
            tolerance = quantity(f"{where}.tolerance", entry.tolerance, signal.si, difference=True)
        one = self._conversion(where, signal, entry)
        return SettingTarget(point, entry.read, one, within, tolerance, None, initial)

    def _conversion(self, where: str, signal: Signal, entry: SignalEntry) -> Conversion:
        return conversion(
            where,
            signal,
            unit=entry.unit,
            sign=entry.sign,
            calibration=entry.calibration,
            choices=entry.choices,
        )

    def _target(self, where: str, signal: Signal, point: str, *, shared: bool = False) -> str:
        if not point:
            raise WiringError(
                f'{where}.to is missing; state the point of the rig that is written, or absent = "reason"'
            )
        self._point(f"{where}.to", point, written=True)
        other = self._written.setdefault(point, signal.name)
        if other != signal.name and not shared:
            raise WiringError(f"{where}.to = {point!r} is already written by {other}; use another point")
        return point

    def _point(self, key: str, point: str, *, written: bool) -> None:
        name, _, rest = point.partition(".")
        transports = self._keys.transports
        if not rest:
            raise WiringError(
                f"{key} = {point!r} is not a point; write TRANSPORT.POINT, such as {next(iter(transports))}.…"
            )
        if name not in transports:
            raise WiringError(
                f"{key} = {point!r}: there is no transport {name!r}; {did_you_mean(name, transports)}"
            )
        if transports[name].get("kind") == KIND:
            raise WiringError(
                f"{key} = {point!r}: {name} is of kind {KIND}, which carries signals instead of "
                "points; remove the line"
            )
        self.points.append((key, point, written))

    def _function(self, where: str, name: str, arguments: int) -> Combine:
        if self.functions is None:
            raise WiringError(f'{where} = {name!r}: the key functions is missing; add functions = "FILE.py"')
        return user_function(where, self.functions, name, arguments)

    def _player(self) -> PlayerLimits:
        table, where = self._keys.player, f"{self._head}player"
        limits = {
            key: quantity(f"{where}.{key}", getattr(table, key), si)
            for key, si in (("lever", "m"), ("speed", "m/s"), ("roll_rate", "rad/s"), ("force_rate", "N/s"))
        }
        for key, limit in limits.items():
            if limit <= 0.0:
                raise WiringError(
                    f"{where}.{key} = {getattr(table, key)!r} is not above 0; use a positive value"
                )
        return PlayerLimits(**limits)


#: Permitted keys of a line, by the kind of its signal; ``absent`` excludes all others.
_NUMBER: Final = ("unit", "sign", "calibration", "choices")
_KEYS: Final = {
    **dict.fromkeys(READ, ("from", "value", "function", *_NUMBER)),
    Kind.SETPOINT: ("to", "given", *_NUMBER),
    Kind.SETTING: ("to", "read", "fixed", "initial", "within", "tolerance", *_NUMBER),
    Kind.ACTION: ("to", "value"),
}


def _changed_keys(entry: SignalEntry) -> list[str]:
    """Return the keys of a line that differ from their defaults."""
    fields = msgspec.structs.fields(SignalEntry)
    default = SignalEntry()
    return [one.encode_name for one in fields if getattr(entry, one.name) != getattr(default, one.name)]


def _refuse_wrong_keys(where: str, signal: Signal, entry: SignalEntry) -> None:
    right = _KEYS[signal.kind]
    for key in _changed_keys(entry):
        if key not in right:
            raise WiringError(
                f"{where}.{key} is not a key of {_article(signal.kind)}; the keys are {', '.join(right)}, absent"
            )


def _article(kind: Kind) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
