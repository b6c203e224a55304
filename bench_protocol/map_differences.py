"""What differs between the table that drivers know and the map of the rig that they find, and what still holds.

The rule: a bench goes on where everything that is *said* to the rig means the same on both sides, and everything that
its safety is read from. A reading that is elsewhere, of another scale or not there is absent, with the reason. What the
rig has beyond our table is none of our business, as long as no frame of ours would carry it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench_protocol.registers import OWN_NAMES, SEQUENCE
from bench_protocol.signals import Kind
from bench_protocol.wires import Table

#: Readings without which nobody should command a bench.
ESSENTIAL: Final = ("rig.state", "rig.reason", "rig.map_hash")
#: So many of each kind are named, the others counted.
_NAMED: Final = 6

#: Places of one signal, and how it is coded there.
Places = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Differences:
    """In words, by signal: what the rig's map has otherwise than our table."""

    missing: Mapping[str, str]  #: the rig has no such signal
    moved: Mapping[str, str]
    recoded: Mapping[str, str]  #: at the same places in another scale, size, choice or message
    new: tuple[str, ...]  #: signals of the rig that our table does not know
    refused: tuple[str, ...]  #: why a bench must not go on with this rig; empty if it may

    @property
    def absent(self) -> dict[str, str]:
        """The readings that this rig does not have where we would look for them, each with the reason."""
        return {
            **{name: f"the rig's map does not have it: {text}" for name, text in self.missing.items()},
            **{name: f"the rig's map has it elsewhere: {text}" for name, text in self.moved.items()},
            **{name: f"the rig's map has it otherwise: {text}" for name, text in self.recoded.items()},
        }

    def __str__(self) -> str:
        told = [
            _listed("missing", [f"{name} ({text})" for name, text in self.missing.items()]),
            _listed("moved", [f"{name} ({text})" for name, text in self.moved.items()]),
            _listed("otherwise", [f"{name} ({text})" for name, text in self.recoded.items()]),
            _listed("new", list(self.new)),
        ]
        return "; ".join(filter(None, told)) or "nothing that has a name"


def _listed(what: str, names: list[str]) -> str:
    if not names:
        return ""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{what}: {', '.join(names[:_NAMED])}{more}"


def compare(table: Table, places: Places) -> Differences:
    """Return what the map of a rig, by its ``places``, has otherwise than our ``table``."""
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
            missing[name] = f"ours is {_first(here)}"
        elif text := _move(here, there):
            moved[name] = text
        elif text := _recoding(here, there):
            recoded[name] = text
        elif name == "rig.state":
            refused.append(f"the rig has states that we do not know: {_shown(_added(here, there))}")
        else:
            grown.append(f"choices of {name}")
        if (name in missing or name in moved or name in recoded) and (
            kinds[name] in _SAID or name in ESSENTIAL
        ):
            refused.append(f"{name} does not agree")
    refused += _carried_unasked(table, theirs, kinds)
    new = (*(name for name in theirs if name not in ours), *grown)
    return Differences(missing, moved, recoded, new, tuple(refused))


#: What is said to a rig, or stands between people and its forces.
_SAID: Final = (Kind.SETPOINT, Kind.SETTING, Kind.ACTION, Kind.INTERLOCK)


def _by_signal(places: Places) -> dict[str, dict[str, str]]:
    """Return the places of each signal; a field of a message is coded as the message is."""
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
    """Return from where to where a signal has moved, "" if all its places are the same, choices aside."""
    left = [place for place in here if place not in there and not _is_choice(place)]
    come = [place for place in there if place not in here and not _is_choice(place)]
    if not left and not come:
        return ""
    return f"{' and '.join(left) or 'in more places'} here, {' and '.join(come) or 'nowhere'} there"


def _recoding(here: Places, there: Places) -> str:
    """Return how a signal is coded otherwise, "" if it is not; choices that were added change nothing."""
    for place, coding in here.items():
        if there.get(place) != coding:
            return f"{place} is “{coding}” here, “{there.get(place, 'nothing')}” there"
    return ""


def _added(here: Places, there: Places) -> dict[str, str]:
    return {place: content for place, content in there.items() if place not in here}


def _carried_unasked(table: Table, theirs: Mapping[str, Places], kinds: Mapping[str, Kind]) -> list[str]:
    """Return what our frames would carry without our knowing: fields that the rig reads in messages that we send."""
    sent = {f"can {message.identifier:#05x} " for message in table.messages if not message.from_rig}
    return [
        f"{name} is read from a frame that we send, in {place}"
        for name, places in theirs.items()
        if name not in kinds
        for place in places
        if any(place.startswith(one) for one in sent)
    ]


def _is_choice(place: str) -> bool:
    return place.startswith("choice ")


def _first(places: Places) -> str:
    return next(iter(places))


def _shown(places: Places) -> str:
    return ", ".join(f"{place} {coding}".strip() for place, coding in places.items())
