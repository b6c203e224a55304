"""Differences between the table of the drivers and the map of the connected rig.

A bench runs if all commands, and all signals needed for safety, have the same meaning on both sides. A reading that the
rig has elsewhere, in another scale, or not at all counts as missing, with the reason. Additional signals of the rig are
ignored unless they are in one of our frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench_protocol.registers import OWN_NAMES, SEQUENCE
from bench_protocol.signals import Kind
from bench_protocol.wires import Table

#: Readings that are required for commanding a bench.
ESSENTIAL: Final = ("rig.state", "rig.reason", "rig.map_hash")
#: Number of signals of each kind that are named; the others are counted.
_NAMED: Final = 6

#: Places of one signal, and its coding there.
Places = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Differences:
    """Differences of the rig's map from the ASTB table of signals, as text by signal."""

    missing: Mapping[str, str]  #: the rig has no such signal
    moved: Mapping[str, str]
    recoded: Mapping[str, str]  #: at the same places in another scale, size, choice or message
    new: tuple[str, ...]  #: signals of the rig that the ASTB table does not have
    refused: tuple[str, ...]  #: why a bench must not go on with this rig; empty if it may

    @property
    def absent(self) -> dict[str, str]:
        """The readings that this rig does not have at the expected place, each with the reason."""
        return {
            **{name: f"the rig's map does not have it: {text}" for name, text in self.missing.items()},
            **{name: f"the rig's map has it in another place: {text}" for name, text in self.moved.items()},
            **{
                name: f"the rig's map has it in another coding: {text}" for name, text in self.recoded.items()
            },
        }

    def __str__(self) -> str:
        lines = [
            _listed("missing", [f"{name} ({text})" for name, text in self.missing.items()]),
            _listed("moved", [f"{name} ({text})" for name, text in self.moved.items()]),
            _listed("otherwise", [f"{name} ({text})" for name, text in self.recoded.items()]),
            _listed("new", list(self.new)),
        ]
        return "; ".join(filter(None, lines)) or "no signal differs by name"


def _listed(what: str, names: list[str]) -> str:
    if not names:
        return ""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{what}: {', '.join(names[:_NAMED])}{more}"


def compare(table: Table, places: Places) -> Differences:
    """Return the differences of a rig's map, given by its ``places``, from our ``table``."""
    ours, theirs = _by_signal(table.places), _by_signal(places)
    kinds = {signal.name: signal.kind for signal in table.signals}
    missing, moved, recoded = {}, {}, {}
    refused, grown = [], []
    for name, here in ours.items():
        there = theirs.get(name, {})
        if name == SEQUENCE or here == there:
            continue
        if name in OWN_NAMES:
            refused.append(f"{name} is {_shown(there) or 'missing'}, not {_shown(here)}")
            continue
        if not there:
            missing[name] = f"ours is {_first_place(here)}"
        elif text := _move(here, there):
            moved[name] = text
        elif text := _recoding(here, there):
            recoded[name] = text
        elif name == "rig.state":
            refused.append(
                f"the rig has states that these drivers do not know: {_shown(_added(here, there))}"
            )
        else:
            grown.append(f"choices of {name}")
        if (name in missing or name in moved or name in recoded) and (
            kinds[name] in _SAID or name in ESSENTIAL
        ):
            refused.append(f"{name} differs")
    refused += _carried_unasked(table, theirs, kinds)
    new = (*(name for name in theirs if name not in ours), *grown)
    return Differences(missing, moved, recoded, new, tuple(refused))


#: Kinds of signals that command a rig, or protect people from its forces.
_SAID: Final = (Kind.SETPOINT, Kind.SETTING, Kind.ACTION, Kind.INTERLOCK)


def _by_signal(places: Places) -> dict[str, dict[str, str]]:
    """Return the places of each signal, with its coding in each. The coding of a CAN field includes that of its
    message.
    """
    found: dict[str, dict[str, str]] = {}
    for place, content in places.items():
        space, where, *rest = place.split()
        if space == "choice":
            found.setdefault(where, {})[place] = content
        elif space != "can":
            name, _, coding = content.partition(" ")
            found.setdefault(name, {})[place] = coding
        elif rest[:1] == ["bit"]:
            name, _, coding = content.partition(", ")
            frame = " ".join(filter(None, (places.get(f"can {where}"), places.get(f"can {where} data id"))))
            found.setdefault(name, {})[place] = f"{coding} in {frame}"
    return found


def _move(here: Places, there: Places) -> str:
    """Return as text the places that a signal has only here, or only on the rig. Return "" if all places are equal;
    places of choices are ignored.
    """
    left = [place for place in here if place not in there and not _is_choice(place)]
    come = [place for place in there if place not in here and not _is_choice(place)]
    if not left and not come:
        return ""
    return f"{' and '.join(left) or 'in more places'} here, {' and '.join(come) or 'nowhere'} there"


def _recoding(here: Places, there: Places) -> str:
    """Return the different coding of a signal, "" if it is equal; additional choices are not a difference."""
    for place, coding in here.items():
        if there.get(place) != coding:
            return f"{place} is “{coding}” here, “{there.get(place, 'nothing')}” there"
    return ""


def _added(here: Places, there: Places) -> dict[str, str]:
    return {place: content for place, content in there.items() if place not in here}


def _carried_unasked(table: Table, theirs: Mapping[str, Places], kinds: Mapping[str, Kind]) -> list[str]:
    """Return fields that the rig reads in the ASTB messages although the ASTB table does not have them."""
    sent = {f"can {message.identifier:#05x} " for message in table.messages if not message.from_rig}
    return [
        f"{name} is read by the rig from a frame that these drivers send, in {place}"
        for name, places in theirs.items()
        if name not in kinds
        for place in places
        if any(place.startswith(one) for one in sent)
    ]


def _is_choice(place: str) -> bool:
    return place.startswith("choice ")


def _first_place(places: Places) -> str:
    return next(iter(places))


def _shown(places: Places) -> str:
    return ", ".join(f"{place} {coding}".strip() for place, coding in places.items())
