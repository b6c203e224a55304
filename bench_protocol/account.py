"""Account of the reading of a user's file: assumptions that the reader made, and counts of skipped items."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Account:
    """The account of reading one file: assumptions, and counts of skipped items. Errors are not part of it, because
    they are raised.

    Commands print the account, and a record or finding made from the data stores it.
    """

    taken: list[str] = field(default_factory=list)  #: assumptions of the reader where the file is ambiguous
    counts: dict[str, int] = field(
        default_factory=dict
    )  #: kind of skipped item ("CAN FD frame(s)") and its count
    first: dict[str, str] = field(
        default_factory=dict
    )  #: place of the first skipped item of each kind, "line 12"
    quality: list[dict[str, Any]] = field(default_factory=list)  #: results of checks of the data

    def take(self, sentence: str) -> None:
        """Add an assumption, once: "the times are Unix times; the record begins at …"."""
        if sentence not in self.taken:
            self.taken.append(sentence)

    def leave_out(self, what: str, count: int = 1, at: str = "") -> None:
        """Count skipped items: ``what`` as text with "(s)" for the plural, ``at`` the place of the first one."""
        if count > 0:
            self.counts[what] = self.counts.get(what, 0) + count
            if at:
                self.first.setdefault(what, at)

    def add(self, other: Account) -> None:
        """Add the content of another account."""
        for sentence in other.taken:
            self.take(sentence)
        self.quality += other.quality
        for what, count in other.counts.items():
            self.leave_out(what, count, other.first.get(what, ""))

    @property
    def left_out(self) -> str:
        """The skipped items as text: "50 CAN FD frames, 1 error frame"; empty if there are none."""
        return ", ".join(
            f"{count} {what.replace('(s)', '' if count == 1 else 's')}{self._first_as_text(what, count)}"
            for what, count in self.counts.items()
        )

    def _first_as_text(self, what: str, count: int) -> str:
        if what not in self.first:
            return ""
        return f" ({self.first[what]})" if count == 1 else f" (the first: {self.first[what]})"

    def lines(self) -> list[str]:
        """Return the content as sentences for users."""
        return [*self.taken, *([f"left out: {self.left_out}"] if self.counts else [])]

    def as_meta(self) -> dict[str, Any]:
        """Return the content for the metadata of a record, under the key "reading"; empty without content."""
        content = {"taken": self.taken, "left_out": self.counts, "quality": self.quality}
        kept = {key: value for key, value in content.items() if value}
        return {"reading": kept} if kept else {}
