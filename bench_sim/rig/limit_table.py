"""The limits in a rig file, which replace the assumed limits. Invalid limits raise an error."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, Final

from bench_protocol.signals import Kind
from bench_protocol.suggestion import did_you_mean
from bench_protocol.table import TABLE
from bench_protocol.units import FACTORS, UNITS
from bench_protocol.words import LIMIT_KINDS, LimitKind
from bench_sim.rig.limits import LIMITS, Limit, LimitAction, detectors

ACTIONS: Final = tuple(action.name.lower().replace("_", " ") for action in LimitAction)
_KEYS: Final = (
    "signal",
    "kind",
    "at",
    "action",
    "persistence",
    "hysteresis",
    "latch",
    "over",
    "lead",
    "within",
    "level",
)


def limits_of(rows: Sequence[Mapping[str, Any]]) -> tuple[Limit, ...]:
    """Return the assumed limits with those of ``rows``. A row replaces the limit of the same signal and kind, or adds
    a limit.

    Raises ValueError with key, value and correct form.
    """
    limits = {(limit.signal, limit.kind): limit for limit in LIMITS}
    for row in rows:
        signal, kind = _reading(row.get("signal")), _kind(row.get("kind"))
        before = limits.get((signal, kind))
        try:
            limits[signal, kind] = _limit(signal, kind, row, before)
        except ValueError as error:
            raise ValueError(f"the {kind.name.lower()} limit of {signal}: {error}") from None
    found = tuple(limits.values())
    detectors(TABLE, found)  # refuses an error of a reading without a set-point
    return found


def _limit(signal: str, kind: LimitKind, row: Mapping[str, Any], before: Limit | None) -> Limit:
    for key in row:
        if key not in _KEYS:
            raise ValueError(f"{key} is not a key of a limit; {did_you_mean(key, _KEYS)}")
    if before is None and not {"at", "action"} <= row.keys():
        raise ValueError('the limit is new; add the keys "at" and "action"')
    own = TABLE[signal].si
    rate = "m/s3" if own == "m/s2" else f"{own}/s"
    units = {LimitKind.RATE: rate, LimitKind.TIMEOUT: "s", LimitKind.COUNT: "1"}
    changes: dict[str, Any] = {}
    if "at" in row:
        changes["at"] = _number("at", row["at"], units.get(kind, own))
    if "action" in row:
        changes["action"] = _action(row["action"])
    for key, unit in (
        ("persistence", "s"),
        ("over", "s"),
        ("lead", "s"),
        ("hysteresis", rate if kind is LimitKind.RATE else own),
        ("within", own),
    ):
        if key in row:
            changes[key] = _number(key, row[key], unit)
            if changes[key] < 0:
                raise ValueError(f"{key} = {row[key]!r} is negative; use 0 or more")
    if "level" in row:
        changes["level"] = _number("level", row["level"], own)
    if "latch" in row:
        if not isinstance(row["latch"], bool):
            raise ValueError(f"latch = {row['latch']!r} is not valid; use true or false")
        changes["latch"] = row["latch"]
    return replace(before, **changes) if before else Limit(signal, kind, **changes)


def _reading(name: object) -> str:
    readings = [signal.name for signal in TABLE.of_kind(Kind.MEASUREMENT)]
    if name not in readings:
        raise ValueError(f"a limit of {name!r}: there is no such reading; {did_you_mean(name, readings)}")
    return str(name)


def _kind(text: object) -> LimitKind:
    if text not in LIMIT_KINDS[1:]:
        raise ValueError(f"kind = {text!r} is unknown; use one of {', '.join(LIMIT_KINDS[1:])}")
    return LimitKind(LIMIT_KINDS.index(str(text)))


def _action(text: object) -> LimitAction:
    if text not in ACTIONS:
        raise ValueError(f"action = {text!r} is unknown; use one of {', '.join(ACTIONS)}")
    return LimitAction(ACTIONS.index(str(text)))


def _number(key: str, text: object, si: str) -> float:
    """Return ``text``, a number with its unit, in the unit ``si``. A count has no unit."""
    fitting = [unit for unit in FACTORS if UNITS[unit].si == si]
    if si == "1" and isinstance(text, (int, float)) and not isinstance(text, bool):
        return float(text)
    number, _, unit = str(text).partition(" ")
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or unit not in fitting:
        example = "a number" if si == "1" else f'a number with its unit, such as "5 {fitting[0]}"'
        raise ValueError(f"{key} = {text!r} is not valid; use {example}")
    return value * FACTORS[unit]


def listed(limits: Sequence[Limit]) -> list[tuple[str, ...]]:
    """Return the limits as texts, one tuple each: signal, kind, value, duration, hysteresis, latch, action."""
    rows: list[tuple[str, ...]] = []
    for one in limits:
        signal = TABLE[one.signal]
        at = {
            LimitKind.RATE: f"{signal.show(one.at)}/s over {one.over:g} s",
            LimitKind.TIMEOUT: f"{one.at:g} s" + (f", {signal.show(one.within)} off" if one.within else ""),
            LimitKind.COUNT: f"{one.at:g} times over {signal.show(one.level)}",
        }.get(one.kind, signal.show(one.at) + (f", {one.lead * 1e3:g} ms ahead" if one.lead else ""))
        hysteresis = "" if one.kind in (LimitKind.TIMEOUT, LimitKind.RATE) else signal.show(one.hysteresis)
        kind, action = one.kind.name.lower(), ACTIONS[one.action]
        lasting = f"{one.persistence * 1e3:g} ms"
        rows.append((one.signal, kind, at, lasting, hysteresis, "until reset" if one.latch else "", action))
    return rows
