"""Matches signals of the bench with points of a rig, by the words of their names and by their units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher
from typing import Final, NamedTuple

from astb.acceptance.skeleton.points import DescribedPoint
from bench_protocol.signals import Kind, Signal
from bench_protocol.units import UNITS

#: Synonyms of the words in the names of our signals.
_SYNONYMS: Final = {
    "left": ("links", "l", "li"),
    "right": ("rechts", "r", "re"),
    "pressure": ("druck", "p", "press"),
    "temperature": ("temp", "temperatur", "gas"),
    "force": ("kraft", "f", "push", "forces"),
    "displacement": ("position", "positions", "pos", "place", "weg", "stroke", "piston", "travel"),
    "height": ("laser", "hoehe", "heights", "höhe"),
    "acceleration": ("acc", "accel", "accelerometer", "beschleunigung"),
    "cell": ("zelle", "cells", "loadcell", "messdose"),
    "bellows": ("balg",),
    "auxiliary": ("aux", "chamber", "tank", "zusatz", "behaelter"),
    "supply": ("versorgung", "feed"),
    "platform": ("plattform", "table", "shaker"),
    "vertical": ("up", "vert", "lift", "heave", "senkrecht"),
    "lateral": ("across", "quer", "shift", "sway", "sideways"),
    "roll": ("tilt", "wank"),
    "setpoint": ("set", "soll", "demand"),
    "target": ("ziel",),
    "mode": ("control", "regelung"),
    "valve": ("ventil", "valves"),
    "reservoir": ("join", "joined"),
    "state": ("status", "zustand"),
    "reason": ("fault", "stoerung"),
    "estop": ("emergency", "notaus"),
    "preload": ("shims", "shim", "vorspannung"),
    "orifice": ("plates", "plate", "blende"),
    "dpv": ("bridge",),
}
_CONCEPT: Final = {word: concept for concept, words in _SYNONYMS.items() for word in (concept, *words)}
#: A point has at most one word of each of these groups.
_SLOTS: Final = (
    frozenset({"left", "right"}),
    frozenset({"pressure", "temperature", "force", "displacement", "height", "acceleration", "cell"}),
    frozenset({"bellows", "auxiliary", "supply", "platform", "cell"}),
    frozenset({"vertical", "lateral", "roll"}),
    frozenset({"1", "2", "3", "4", "5", "6"}),
    frozenset({"target", "valve", "reservoir"}),
)
_FILLERS: Final = frozenset(
    {"is", "are", "the", "of", "in", "stop", "load", "rig", "nominal", "diameter", "at", "spring", "feder"}
)
#: Words of settings: a writable point with one of them is not a reading.
_SAID_TO_IT: Final = frozenset({"setpoint", "target"})
#: Words that a unit implies.
_BY_UNIT: Final = {"Pa": "pressure", "K": "temperature"}
#: Optional words: an actuator on one side is a vertical one.
_IMPLIED: Final = frozenset({"vertical", "mode", "pressure", "temperature"})
CLEAR: Final = 0.8
MARGIN: Final = 0.15
POSSIBLE: Final = 0.3
#: Factors on the score of a writable point: as a reading, and as the point that reports a setting.
PERHAPS_READ: Final = 0.9
TOLD_BACK: Final = 0.75


class Match(NamedTuple):
    """The certain point of a signal, if there is one, and all possible points, the most likely first."""

    clear: DescribedPoint | None
    candidates: Sequence[tuple[float, DescribedPoint]]


def match(
    signals: Iterable[Signal], points: Sequence[DescribedPoint], *, read_back: bool = False
) -> dict[str, Match]:
    """Return the matching points of each signal, by its name.

    With ``read_back``, a setting is matched with points that report it, not with points that are written.
    """
    table = {
        signal.name: [(score(signal, point, read_back=read_back), point) for point in points]
        for signal in signals
    }
    best: dict[str, list[float]] = {}
    for rows in table.values():
        for value, point in rows:
            best.setdefault(point.name, []).append(value)
    for values in best.values():
        values.sort(reverse=True)
    found = {}
    for name, rows in table.items():
        ordered = sorted((row for row in rows if row[0] >= POSSIBLE), key=lambda row: -row[0])
        clear = None
        if ordered and ordered[0][0] >= CLEAR:
            value, point = ordered[0]
            others = [ordered[1][0]] if len(ordered) > 1 else []
            rivals = best[point.name]
            others += (
                [rivals[1]] if rivals[0] == value and len(rivals) > 1 else [rivals[0]] * (rivals[0] > value)
            )
            clear = point if all(value - other >= MARGIN for other in others) else None
        found[name] = Match(clear, ordered[:4])
    return found


def score(signal: Signal, point: DescribedPoint, *, read_back: bool = False) -> float:
    """Return how well ``point`` fits ``signal``, from 0 (impossible) to 1 (every word agrees)."""
    goes = signal.kind in (Kind.SETPOINT, Kind.SETTING, Kind.ACTION) and not read_back
    if not (point.written if goes else point.read):
        return 0.0
    fits = _unit_fits(signal, point.unit)
    if not goes and point.written:
        fits *= TOLD_BACK if read_back else PERHAPS_READ
    if not fits:
        return 0.0
    wanted, own = _of_signal(signal), _words(point.own)
    context = _words(point.context)
    if (si := UNITS.get(point.unit)) and si.si in _BY_UNIT:
        context |= {_BY_UNIT[si.si]}
    for slot in _SLOTS:
        if own & slot:
            context -= slot
    has = own | context
    if any(wanted & slot and has & slot and not wanted & has & slot for slot in _SLOTS):
        return 0.0
    if not goes and point.written and has & _SAID_TO_IT - wanted:
        return 0.0
    shared = wanted & has
    needed = wanted - (_IMPLIED - has) if len(wanted - _IMPLIED) else wanted
    surplus = own - wanted - _IMPLIED
    alike = SequenceMatcher(None, signal.name.replace(".", "_"), point.own.lower()).ratio()
    if not shared:
        return 0.0
    return fits * (0.95 * len(shared) / len(needed | shared | surplus) + 0.05 * alike)


def _of_signal(signal: Signal) -> frozenset[str]:
    device, _, attribute = signal.name.partition(".")
    words = _words(attribute if device in ("rig", "interlock", "air") else f"{device}_{attribute}")
    if device == "air" and attribute.endswith("_mode"):
        words |= {"valve"}
    return words


def _words(text: str) -> frozenset[str]:
    split = re.findall(r"[A-ZÄÖÜ]?[a-zäöü]+|[A-ZÄÖÜ]+(?![a-zäöü])|\d+", text)
    return frozenset(_CONCEPT.get(word.lower(), word.lower()) for word in split) - _FILLERS


def _unit_fits(signal: Signal, unit: str) -> float:
    """Return 1 for a unit of the same quantity, 0 for a unit of another quantity, and 0.8 for an unknown unit or none.
    For a signal without a unit, return 1 only for none.
    """
    if signal.unit == "1":
        return float(unit in ("", "1"))
    if not unit or unit not in UNITS:
        return 0.8
    si = UNITS[unit].si
    return float(si == signal.si or (si == "kg" and signal.si == "N"))
