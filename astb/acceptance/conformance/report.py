"""The findings of a conformance test, and the differences between two rigs."""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import msgspec

from bench_protocol.input_limits import read_bounded
from bench_protocol.os_errors import file_errors


class ReportError(ValueError):
    """A file is not a report of a conformance test."""


class Outcome(StrEnum):
    """Result of the comparison of an observed with a correct answer."""

    RIGHT = "right"
    WRONG = "wrong"
    SKIPPED = "not asked"


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """One test of a rig: the subject, the answer, and the correct answer."""

    group: str
    what: str
    outcome: Outcome
    found: str
    right: str = ""
    value: float | None = None  #: SI, if it is a number
    apart: float = 0.0  #: difference (SI) between the numbers of two rigs from which it is reported


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """All findings on one rig."""

    rig: str
    time: str  #: real | virtual
    motion: bool  #: whether it was allowed to move
    findings: list[Observation]

    @property
    def wrong(self) -> list[Observation]:
        """Findings that are not correct."""
        return [one for one in self.findings if one.outcome is Outcome.WRONG]

    def to_json(self) -> bytes:
        """Return the report as JSON, indented."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


class Difference(NamedTuple):
    """One difference between two rigs: the findings on this one and on the other."""

    group: str
    what: str
    here: str
    there: str


def read_report(path: Path) -> Report:
    """Return the report in the file ``path``. Raises ReportError if it cannot be read, or has another form."""
    with file_errors(path, ReportError):
        content = read_bounded(path)
    try:
        return msgspec.json.decode(content, type=Report)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise ReportError(
            f"{path} was not written by `astb rig conform --json`; use a file of it ({error})"
        ) from None


def common_tests(here: Report, there: Report) -> list[tuple[Observation, Observation]]:
    """Return the findings of the tests that ran on both rigs, in the order of the suite.

    Raises ReportError if there is none, because then nothing is compared.
    """
    others = {(one.group, one.what): one for one in there.findings if one.outcome is not Outcome.SKIPPED}
    pairs = [
        (one, others[one.group, one.what])
        for one in here.findings
        if one.outcome is not Outcome.SKIPPED and (one.group, one.what) in others
    ]
    if not pairs:
        raise ReportError(
            f"the report of {there.rig} has no test of this report, so nothing was compared; write both reports with "
            "the same version of ASTB"
        )
    return pairs


def differences(pairs: Iterable[tuple[Observation, Observation]]) -> list[Difference]:
    """Return the differences between two rigs."""
    return [
        Difference(one.group, one.what, one.found, other.found)
        for one, other in pairs
        if one.outcome is not other.outcome or not _observations_agree(one, other)
    ]


def _observations_agree(one: Observation, other: Observation) -> bool:
    if one.value is None or other.value is None:
        return one.found == other.found
    return abs(one.value - other.value) <= max(one.apart, other.apart)


class Notebook:
    """Collects the findings of one group."""

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
        """Record the finding ``found`` about ``what``, and whether it is ``good``."""
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
        """Record that a test was skipped, and why."""
        self.findings.append(Observation(group=self.group, what=what, outcome=Outcome.SKIPPED, found=why))

    def refusal(self, what: str, code: int, right: int) -> None:
        """Record the Modbus exception of a request that the rig must refuse, and the expected one; 0 is no
        exception.
        """
        self.note(what, code == right, _refused(code), _refused(right))


def _refused(code: int) -> str:
    return f"exception {code}" if code else "accepted"


def joined(notebooks: Iterable[Notebook]) -> list[Observation]:
    """Return the findings of all ``notebooks`` in their order."""
    return [one for notebook in notebooks for one in notebook.findings]
