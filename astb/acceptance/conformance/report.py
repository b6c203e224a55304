"""What a conformance test has found, one thing at a time, and what differs between two rigs."""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import msgspec

from bench_protocol.input_limits import Unfit, read_bounded


class ReportError(ValueError):
    """A file is no report of a conformance test."""


class Outcome(StrEnum):
    """How what was found compares with what is right."""

    RIGHT = "right"
    WRONG = "wrong"
    SKIPPED = "not asked"


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was asked of a rig, what it answered, and what would be right."""

    group: str
    what: str
    outcome: Outcome
    found: str
    right: str = ""
    value: float | None = None  #: SI, where it is a figure
    apart: float = 0.0  #: by how much (SI) the figures of two rigs may differ before that is told


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """All findings on one rig."""

    rig: str
    time: str  #: real | virtual
    motion: bool  #: whether it was allowed to move
    findings: list[Observation]

    @property
    def wrong(self) -> list[Observation]:
        """What is not as it should be."""
        return [one for one in self.findings if one.outcome is Outcome.WRONG]

    def to_json(self) -> bytes:
        """Return the report as JSON, indented."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


class Difference(NamedTuple):
    """One thing in which two rigs differ: what was found on this one and on the other."""

    group: str
    what: str
    here: str
    there: str


def read_report(path: Path) -> Report:
    """Return the report in the file ``path``. ReportError if it cannot be read, or is none."""
    try:
        return msgspec.json.decode(read_bounded(path), type=Report)
    except OSError as error:
        raise ReportError(f"{path} cannot be read: {error.strerror}") from None
    except Unfit as error:
        raise ReportError(f"{path} {error}") from None
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise ReportError(f"{path} is no report of `astb rig conform --json`: {error}") from None


def differences(here: Report, there: Report) -> list[Difference]:
    """Return in what two rigs differ, in the order of the suite; nothing of what only one of them was asked."""
    others = {(one.group, one.what): one for one in there.findings if one.outcome is not Outcome.SKIPPED}
    found = []
    for one in here.findings:
        other = others.get((one.group, one.what))
        if other is None or one.outcome is Outcome.SKIPPED:
            continue
        if one.outcome is not other.outcome or not _alike(one, other):
            found.append(Difference(one.group, one.what, one.found, other.found))
    return found


def _alike(one: Observation, other: Observation) -> bool:
    if one.value is None or other.value is None:
        return one.found == other.found
    return abs(one.value - other.value) <= max(one.apart, other.apart)


class Notebook:
    """Where the findings of one group are written down."""

    def __init__(self, group: str) -> None:
        self.group = group
        self.findings: list[Observation] = []

    def note(
        self,
        what: str,
        good: bool,
        found: str,
        right: str,
        *,
        value: float | None = None,
        apart: float = 0.0,
    ) -> None:
        """Write down what was ``found`` of ``what``, and whether it is ``good``."""
        outcome = Outcome.RIGHT if good else Outcome.WRONG
        self.findings.append(
            Observation(
                group=self.group,
                what=what,
                outcome=outcome,
                found=found,
                right=right,
                value=None if value is None else float(value),
                apart=apart,
            )
        )

    def skip(self, what: str, why: str) -> None:
        """Write down that something was not asked, and why."""
        self.findings.append(Observation(group=self.group, what=what, outcome=Outcome.SKIPPED, found=why))

    def refusal(self, what: str, code: int, right: int) -> None:
        """Write down with which Modbus exception a request was refused, 0 for none."""
        self.note(what, code == right, _refused(code), _refused(right))


def _refused(code: int) -> str:
    return f"exception {code}" if code else "accepted"


def joined(notebooks: Iterable[Notebook]) -> list[Observation]:
    """Return the findings of all ``notebooks`` in their order."""
    return [one for notebook in notebooks for one in notebook.findings]
