"""What a reader of somebody's file tells beside its numbers: how it took the file, and what it left out, counted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Account:
    """The account of one reading. What a reader refuses is an error instead, with file, place and what would be right.

    It goes with what was read: into the last lines of a command, and into the record or the finding made of it.
    """

    taken: list[str] = field(default_factory=list)  #: how it was read, where somebody could think otherwise
    counts: dict[str, int] = field(
        default_factory=dict
    )  #: what was left out, "CAN FD frame(s)", and how often
    first: dict[str, str] = field(default_factory=dict)  #: where the first of them stood, "line 12"
    quality: list[dict[str, Any]] = field(default_factory=list)  #: what checks of the data found

    def take(self, sentence: str) -> None:
        """Say, once, how the file was taken: "the times are Unix times; the record begins at …"."""
        if sentence not in self.taken:
            self.taken.append(sentence)

    def leave_out(self, what: str, count: int = 1, at: str = "") -> None:
        """Count what is left out: ``what`` in words with "(s)" where many have an s, ``at`` the first one's place."""
        if count > 0:
            self.counts[what] = self.counts.get(what, 0) + count
            if at:
                self.first.setdefault(what, at)

    def add(self, other: Account) -> None:
        """Take over what another reading tells."""
        for sentence in other.taken:
            self.take(sentence)
        self.quality += other.quality
        for what, count in other.counts.items():
            self.leave_out(what, count, other.first.get(what, ""))

    @property
    def left_out(self) -> str:
        """What was left out, in words: "50 CAN FD frames, 1 error frame"; empty if nothing was."""
        return ", ".join(
            f"{count} {what.replace('(s)', '' if count == 1 else 's')}{self._where(what, count)}"
            for what, count in self.counts.items()
        )

    def _where(self, what: str, count: int) -> str:
        if what not in self.first:
            return ""
        return f" ({self.first[what]})" if count == 1 else f" (the first: {self.first[what]})"

    def lines(self) -> list[str]:
        """Return what a person has to know of the reading, a sentence each."""
        return [*self.taken, *([f"left out: {self.left_out}"] if self.counts else [])]

    def as_meta(self) -> dict[str, Any]:
        """Return what a record's meta data keep of it, under one key; nothing if there is nothing to tell."""
        told = {"taken": self.taken, "left_out": self.counts, "quality": self.quality}
        kept = {key: value for key, value in told.items() if value}
        return {"reading": kept} if kept else {}
