"""Assignment of received frames to messages, and counts of dropped frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

from bench_protocol import j1939
from bench_protocol.units import NS
from drivers.wiring.can.message import Message
from drivers.wiring.contract import Remark

#: Number of foreign identifiers that are listed in a remark.
_TOLD_MAX: Final = 6
_WORDS: Final = {
    "corrupt": "a wrong checksum, or too short for one",
    "short": "shorter than described: what fits is read",
    "unknown": "a page that is not described",
    "foreign": "of another source address",
    "repeated": "the same count as before",
    "lost": "missing by their count",
}
#: Kinds of loss that make readings doubtful, if they affect more than one frame in a hundred.
_DOUBTFUL: Final = ("corrupt", "unknown", "repeated", "lost", "foreign")
_FEW: Final = 0.01


class Reception:
    """Identifies frames by identifier, or with J1939 by group, and counts received, dropped and foreign frames."""

    def __init__(self, messages: Mapping[str, Message], is_ours: Callable[[str], bool]) -> None:
        self._messages, self._is_ours = messages, is_ours
        usable = [one for one in messages.values() if not one.refused]
        self._exact = {(one.coding.frame_id, bool(one.coding.is_extended_frame)): one for one in usable}
        groups: dict[int, list[Message]] = {}
        for one in usable:
            if one.j1939:
                groups.setdefault(j1939.group_of(one.coding.frame_id), []).append(one)
        self._groups = {
            group: found for group, all_of in groups.items() if (found := _message_of_group(all_of))
        }
        self.begin()

    def begin(self) -> None:
        """Reset the counts of an earlier connection."""
        #: Frames lost, repeated, corrupt, short, of an unknown page, of another source, by message.
        self.counts: dict[str, dict[str, int]] = {}
        self.received: Counter[str] = Counter()
        self._strangers: Counter[tuple[int, bool]] = Counter()

    def message(self, identifier: int, extended: bool, time: int) -> Message | None:
        """Return the message of a frame received at ``time`` (ns); None for a frame that is dropped."""
        found = exact = self._exact.get((identifier, extended))
        if found is None and extended:
            found = self._groups.get(j1939.group_of(identifier))
        if found is None:
            self._strangers[identifier, extended] += 1
            return None
        if self._is_ours(found.name):
            return None
        if found.j1939 and not self._from_its_source(found, identifier, exact is found, time):
            self.note(found, "foreign")
            return None
        return found

    def _from_its_source(self, message: Message, identifier: int, exact: bool, time: int) -> bool:
        """Return whether a frame received at ``time`` (ns) comes from the accepted source address; another address is
        another device.

        Without a stated address, the first source is accepted until it stops. A frame with exactly the described
        identifier (``exact``) replaces it.
        """
        source = j1939.source_of(identifier)
        if message.keys.source is not None:
            return source == message.keys.source
        stopped = time - message.source_when > max(message.stale, 1.0) * NS
        if message.source is None or stopped or (exact and source != j1939.NOBODY):
            message.source = source
        if source == message.source:
            message.source_when = time
        return source == message.source

    def note(self, message: Message, what: str, count: int = 1) -> None:
        """Add to a count of frames of a message."""
        if count:
            tally = self.counts.setdefault(message.name, {})
            tally[what] = tally.get(what, 0) + count

    def instead(self) -> str:
        """Return as text which frames arrived although no message was accepted; empty if none did."""
        came = [
            f"{name} ({', '.join(f'{count} frames: {_WORDS[what]}' for what, count in tally.items())})"
            for name, tally in self.counts.items()
        ] + self._list_unknown_frames()
        return "; ".join(came)

    def _list_unknown_frames(self) -> list[str]:
        most = self._strangers.most_common(_TOLD_MAX)
        lines = [f"{identifier:#x} ({count} frames of no message here)" for (identifier, _), count in most]
        rest = len(self._strangers) - len(most)
        return [*lines, *([f"{rest} other identifiers"] if rest else [])]

    def remarks(self) -> list[Remark]:
        """Return remarks on frames that were dropped or read in part, and on other frames on the bus."""
        found = []
        for name, tally in self.counts.items():
            whole = self.received[name] + sum(tally.get(what, 0) for what in _DOUBTFUL)
            for what, count in tally.items():
                of = f" and not of {self._messages[name].source:#x}" if what == "foreign" else ""
                text = f"{name}: {count} of {whole} frames {_WORDS[what]}{of}"
                found.append(Remark(text, what in _DOUBTFUL and count > _FEW * whole))
        if others := self._list_unknown_frames():
            found.append(Remark(f"also on the bus: {'; '.join(others)}", False))
        return found


def _message_of_group(group: list[Message]) -> Message | None:
    """Return the message of all frames of a group: the only one, or the only one without a source address. None if
    there is no such message.
    """
    anybody = [one for one in group if j1939.source_of(one.coding.frame_id) == j1939.NOBODY]
    return group[0] if len(group) == 1 else anybody[0] if len(anybody) == 1 else None
