"""The result of a test plan: checks of values against limits, and the verdict.

A value within its limits passes, and one outside fails. A value with a standard uncertainty that conforms with a
probability below 97.5 % passes as *marginal*: it needs attention. A value without uncertainty is marginal if its
distance to a limit is less than ``margin`` times the width of the band. A value that is not a finite number is an
*error* and never passes. A value that the rig cannot measure is *not available*. It has a reason, and never passes. All
values are in SI, and ``scale`` is the SI value of one display unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any

import msgspec

from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_protocol.os_errors import file_errors
from bench_records.conformity import SURE, conformity, coverage_factor, decimals, guard_factor, percent
from bench_records.curves import Curve
from bench_records.layout import RESULT, Condition, Phase, RecordError, put

MARGIN = 0.05


class CheckVerdict(StrEnum):
    """The verdict of one check."""

    PASS = "pass"
    MARGINAL = "marginal"
    FAIL = "fail"
    ERROR = "error"
    NOT_AVAILABLE = "not available"


class Outcome(StrEnum):
    """The verdict of a run.

    Incomplete: all available checks passed, but others are not available on this rig. Blocked: no verdict on the
    specimen is possible.
    """

    PASS = "pass"
    INCOMPLETE = "incomplete"
    FAIL = "fail"
    BLOCKED = "blocked"


def judge(
    value: float,
    low: float | None,
    high: float | None,
    margin: float = MARGIN,
    u: float | None = None,
    even: float = 0.0,
) -> CheckVerdict:
    """Return the verdict on a value with limits, of which one may be None. A value beyond a limit fails, and one that
    is not finite is an error.

    For other values with a standard uncertainty ``u``, the probability of conformity decides between pass and marginal;
    ``even`` is the uniformly distributed part of ``u``. Without ``u`` the margin decides: a fraction of the band ``high
    - low``, or of the magnitude of a single limit.
    """
    if not math.isfinite(value):
        return CheckVerdict.ERROR
    if (low is not None and value < low) or (high is not None and value > high):
        return CheckVerdict.FAIL
    if u is not None:
        sure = conformity(value, u, low, high, even) >= SURE
        return CheckVerdict.PASS if sure else CheckVerdict.MARGINAL
    zone = margin * band_width(low, high)
    near_low = low is not None and value - low < zone
    near_high = high is not None and high - value < zone
    return CheckVerdict.MARGINAL if near_low or near_high else CheckVerdict.PASS


def band_width(low: float | None, high: float | None) -> float:
    """Return the width to which ``margin`` refers: that of the band, or the magnitude of a single limit."""
    if low is not None and high is not None:
        return high - low
    return abs(low if low is not None else high if high is not None else 0.0)


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """One value and its limits. ``check`` makes it with a verdict, and ``unavailable`` makes it without a value."""

    name: str
    value: float | None
    unit: str
    scale: float
    low: float | None
    high: float | None
    margin: float
    verdict: CheckVerdict
    phase: str = ""
    note: str = ""
    u: float | None = None  #: standard uncertainty, SI
    even: float = 0.0  #: its uniformly distributed part
    parts: dict[str, float] = {}  #: its parts: standard uncertainty by cause
    without: str = ""  #: reason for a missing uncertainty
    conformity: float | None = None  #: the probability of lying within the limits
    at: float | None = None  #: time of the judgement, in seconds since the record began
    about: str = ""  #: the measured quantity and its purpose, in one sentence
    #: Clause or number that the check verifies, such as "EN 13597 7.3"; absent in the file if there is none.
    requirement: str | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        if self.value is None:
            # JSON has no NaN; it is written as null.
            msgspec.structs.force_setattr(self, "value", math.nan)
        if self.u is not None:
            _refuse_a_bad_uncertainty(self)
            found = conformity(self.number, self.u, self.low, self.high, self.even)
            msgspec.structs.force_setattr(self, "conformity", found)
        if self.verdict is CheckVerdict.NOT_AVAILABLE:
            _refuse_a_value(self)
            return
        _refuse_bad_limits(self)
        judged = judge(self.number, self.low, self.high, self.margin, self.u, self.even)
        if self.verdict is not judged:
            raise ValueError(
                f"check {self.name!r} has the verdict {self.verdict}, but its value and limits give {judged}"
            )

    @property
    def number(self) -> float:
        """Return the value in SI, or NaN if there is no measured value."""
        return math.nan if self.value is None else self.value

    @property
    def passed(self) -> bool:
        """Whether the value is within its limits."""
        return self.verdict in {CheckVerdict.PASS, CheckVerdict.MARGINAL}

    @property
    def k(self) -> float:
        """Return the coverage factor of the expanded uncertainty, for a coverage of about 95 %."""
        return coverage_factor(self.even / self.u) if self.u else 2.0

    @property
    def expanded(self) -> float | None:
        """Return the expanded uncertainty U = k u (SI), or None if it is unknown."""
        return None if self.u is None else self.k * self.u

    @property
    def guard(self) -> float:
        """Return the distance from a limit (SI) below which a value is marginal."""
        if self.u is None:
            return self.margin * band_width(self.low, self.high)
        return (guard_factor(self.even / self.u) if self.u else 0.0) * self.u

    def __str__(self) -> str:
        if self.verdict is CheckVerdict.NOT_AVAILABLE:
            return f"{self.name}: {self.verdict}: {self.note}"
        low, high = (_in_display_unit(limit, self.scale, self.unit) for limit in (self.low, self.high))
        if self.low is None or self.high is None:
            limits = f"at least {low}" if self.high is None else f"at most {high}"
        else:
            limits = f"{_in_display_unit(self.low, self.scale)} to {high}"
        if self.u is None or math.isnan(self.number):
            text = f"{self.name} = {_in_display_unit(self.number, self.scale, self.unit)} ({limits}): {self.verdict}"
            return f"{text}; no uncertainty: {self.without}" if self.without else text
        value, expanded = self.written
        text = f"{self.name} = {f'{value} ± {expanded} {self.unit}'.rstrip()} (k = {self.k:.3g}; {limits})"
        return f"{text}: {self.verdict}, conforms with {percent(self.conformity or 0.0)} probability"

    @property
    def written(self) -> tuple[str, str]:
        """Return value and expanded uncertainty as texts in the display unit, with the digits that the uncertainty
        allows.
        """
        limits = [limit / self.scale for limit in (self.low, self.high) if limit is not None]
        number, expanded = self.number / self.scale, (self.expanded or 0.0) / self.scale
        shown = decimals(number, expanded, limits)
        return f"{number:.{shown}f}", f"{expanded:.{shown}f}"


def check(
    name: str,
    value: float,
    unit: str = "",
    scale: float = 1.0,
    *,
    low: float | None = None,
    high: float | None = None,
    margin: float = MARGIN,
    phase: str = "",
    note: str = "",
    u: float | None = None,
    even: float = 0.0,
    parts: Mapping[str, float] | None = None,
    at: float | None = None,
    without: str = "",
    about: str = "",
) -> Check:
    """Return the check of a value (SI) against limits (SI). ``u`` is its standard uncertainty; ``without`` is the
    reason why it has none. The other arguments are fields of `Check`.

    Raises ``ValueError`` if the check could not fail or could not pass: it has no limit, its limits are not finite or
    in the wrong order, or its margin is outside 0 to 0.5.
    """
    value = float(value) if math.isfinite(value) else math.nan
    low, high = (None if limit is None else float(limit) for limit in (low, high))
    u = None if u is None or math.isnan(value) else float(u)
    return Check(
        name=name,
        value=value,
        unit=unit,
        scale=float(scale),
        low=low,
        high=high,
        margin=margin,
        verdict=judge(value, low, high, margin, u, even)
        if low is not None or high is not None
        else CheckVerdict.ERROR,
        phase=phase,
        note=note,
        u=u,
        even=float(even) if u else 0.0,
        parts=dict(parts or {}) if u else {},
        at=at,
        without=without if u is None else "",
        about=about,
    )


def unavailable(name: str, reason: str, *, phase: str = "", about: str = "") -> Check:
    """Return a check that is not available on this rig, for the ``reason``. Raises ValueError if the
    reason is empty.
    """
    return Check(
        name=name,
        value=math.nan,
        unit="",
        scale=1.0,
        low=None,
        high=None,
        margin=MARGIN,
        verdict=CheckVerdict.NOT_AVAILABLE,
        phase=phase,
        note=reason,
        about=about,
    )


def _refuse_a_value(one: Check) -> None:
    if not math.isnan(one.number):
        raise ValueError(f"check {one.name!r} is {one.verdict}, but has the value {one.number}")
    if not one.note:
        raise ValueError(f"check {one.name!r} is {one.verdict} without a reason; state it in the note")


def _refuse_a_bad_uncertainty(one: Check) -> None:
    if one.u is None or not (0.0 <= one.even <= one.u * (1 + 1e-9) < math.inf):
        raise ValueError(
            f"check {one.name!r}: uncertainty u = {one.u}, its uniformly distributed part even = {one.even}; give a "
            "finite u, and even from 0 to u"
        )


def _refuse_bad_limits(one: Check) -> None:
    if not (0.0 < one.scale < math.inf):
        raise ValueError(f"check {one.name!r}: scale = {one.scale}; the scale of the unit must be positive")
    if one.low is None and one.high is None:
        raise ValueError(f"check {one.name!r} has no limit and could never fail; give low, high or both")
    for limit in (one.low, one.high):
        if limit is not None and not math.isfinite(limit):
            raise ValueError(f"check {one.name!r}: a limit is {limit}; give a finite limit, or omit it")
    if one.low is not None and one.high is not None and one.low > one.high:
        raise ValueError(
            f"check {one.name!r}: low = {_in_display_unit(one.low, one.scale, one.unit)} is above "
            f"high = {_in_display_unit(one.high, one.scale, one.unit)}; low must not be above high"
        )
    if not (0.0 <= one.margin <= 0.5):
        raise ValueError(
            f"check {one.name!r}: margin = {one.margin}; the margin must be 0 to 0.5 of the band"
        )


def _in_display_unit(value: float | None, scale: float, unit: str = "") -> str:
    return "no value" if value is None or math.isnan(value) else f"{value / scale:.6g} {unit}".rstrip()


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """The lateness of the ticks of the rig. Times are in seconds.

    ``counts[i]`` ticks were at most ``edges[i]`` late, and more than the previous edge. The last count has no upper
    edge. In virtual time no tick is late: the lists are empty and the figures None. ``disturbed`` has, by the name of
    a check, the number of late ticks during its measurement.
    """

    ticks: int
    late: int
    disturbed: dict[str, int] = {}
    period: float | None = None
    p50: float | None = None
    p99: float | None = None
    max: float | None = None
    edges: list[float] = []
    counts: list[int] = []

    def __post_init__(self) -> None:
        if self.counts and len(self.counts) != len(self.edges) + 1:
            raise ValueError(
                f"a histogram with {len(self.edges)} edges needs {len(self.edges) + 1} counts, not {len(self.counts)}: "
                "one below the first edge, one between each two, and one above the last"
            )
        if list(self.edges) != sorted(set(self.edges)):
            raise ValueError("the edges of a histogram must increase")


class SpecimenFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The specimen on the bench, and the file with its drawing values and limits."""

    type: str
    serial_number: str
    drawing: str = ""
    file: str = ""
    sha256: str = ""

    def __str__(self) -> str:
        return f"{self.type}, no. {self.serial_number}"


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """All results of a run of a plan. ``conclude`` makes it and determines the verdict."""

    plan: str
    title: str
    instruction: str
    verdict: Outcome
    checks: list[Check] = []
    curves: list[Curve] = []
    phases: list[Phase] = []
    reason: str = ""
    rig: str = ""
    parameters: dict[str, str] = {}  #: of the plan, as text with units
    specimen: SpecimenFacts | None = None
    seed: int | None = None
    timing: Timing | None = None
    preconditions: list[Condition] = []
    warnings: list[str] = []  #: restrictions of the measurement
    began: str = ""  #: ISO 8601 in UTC; empty in virtual time, which has no date
    operator: str = ""  #: name, if given
    ambient: str = ""  #: the surroundings, in words

    def __post_init__(self) -> None:
        judged, _ = _outcome(self.checks, self.reason)
        if self.verdict is not judged:
            raise ValueError(f"the result of {self.plan} is {self.verdict}, but its checks give {judged}")

    @property
    def duration(self) -> float:
        """Return the time (s) from the start of the record to the end of the last phase."""
        return max((phase.end for phase in self.phases), default=0.0)

    def count(self, verdict: CheckVerdict) -> int:
        """Return the number of checks with this verdict."""
        return sum(1 for one in self.checks if one.verdict is verdict)

    def to_json(self) -> bytes:
        """Return the result as indented JSON. Equal results give equal bytes."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"

    @staticmethod
    def from_json(data: bytes) -> Result:
        """Return the result from the JSON of ``to_json``. Raises ``RecordError`` for other content."""
        try:
            return msgspec.json.decode(data, type=Result)
        except (msgspec.MsgspecError, RecursionError, UnicodeError) as error:
            raise RecordError(
                f"the content is not that of a result.json: {str(error)[:200]}; use the file of a run"
            ) from error

    def write(self, directory: Path | str) -> Path:
        """Write ``result.json`` to the directory. Return its path."""
        path = Path(directory) / RESULT
        path.parent.mkdir(parents=True, exist_ok=True)
        put(path, self.to_json())
        return path


def conclude(
    plan: str, title: str, instruction: str, checks: Sequence[Check], *, reason: str = "", **rest: Any
) -> Result:
    """Return the result of a run with its verdict.

    A ``reason`` describes a fault of the rig. It blocks the run, because the fault may also have affected earlier
    checks. Without a reason, one failed check fails the run. A run with a check in error, or without an available
    check, is blocked. Any other run is incomplete if a check is not available on this rig. Otherwise it passes.
    """
    verdict, cause = _outcome(checks, reason)
    return Result(
        plan=plan,
        title=title,
        instruction=instruction,
        verdict=verdict,
        checks=list(checks),
        reason=cause,
        **rest,
    )


def _outcome(checks: Sequence[Check], reason: str) -> tuple[Outcome, str]:
    if reason:
        return Outcome.BLOCKED, reason
    if any(one.verdict is CheckVerdict.FAIL for one in checks):
        return Outcome.FAIL, ""
    errors = [one.name for one in checks if one.verdict is CheckVerdict.ERROR]
    if errors:
        return Outcome.BLOCKED, f"the bench gave no value for: {', '.join(errors)}"
    if not checks:
        return Outcome.BLOCKED, "the plan ended without a single check"
    lacking = [one.note for one in checks if one.verdict is CheckVerdict.NOT_AVAILABLE]
    if len(lacking) == len(checks):
        return Outcome.BLOCKED, f"none of the checks is available: {'; '.join(dict.fromkeys(lacking))}"
    return (Outcome.INCOMPLETE if lacking else Outcome.PASS), ""


def read_result(directory: Path | str) -> Result:
    """Return the result from ``result.json`` in a directory. Raises ``RecordError`` if it is missing or has another
    format.
    """
    path = Path(directory) / RESULT
    with file_errors(path, RecordError):
        data = read_bounded(path, RESULT_BYTES)
    try:
        return Result.from_json(data)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
