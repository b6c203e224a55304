"""Summary of the rows of a campaign: cases by verdict, and the values of each check over all seeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from statistics import mean, stdev
from typing import Any, Final, NamedTuple

Row = Mapping[str, Any]

#: Verdicts of a check that contradict the verdict of its case.
FAILED: Final = ("fail", "error")
#: Order of the cases by verdict: first those that need attention.
WORST_FIRST: Final = ("fail", "error", "blocked", "incomplete", "not available", "marginal", "pass", "")


class Kind(NamedTuple):
    """The common properties of cases that differ only by their seed."""

    plan: str
    values: str  #: of the plan's parameters: load=AW3
    variant: str
    specimen: str
    change: str

    @property
    def words(self) -> str:
        """All properties except the plan, in a line."""
        return ", ".join(filter(None, self[1:])) or "as it is"


class Distribution(NamedTuple):
    """One check over the cases of a kind: values and limits in its unit, number of failures, number of cases."""

    kind: Kind
    check: str
    unit: str
    values: list[float]
    low: float | None
    high: float | None
    failed: int
    cases: int

    @property
    def mean(self) -> float:
        """Mean of the values; NaN without a value."""
        return mean(self.values) if self.values else math.nan

    @property
    def scatter(self) -> float:
        """The standard deviation; NaN with fewer than two values."""
        return stdev(self.values) if len(self.values) > 1 else math.nan


def kind_of(row: Row) -> Kind:
    """Return the properties of the case of a row without its seed."""
    specimen = str(row.get("specimen") or "")
    return Kind(
        str(row.get("plan", "")),
        written(row.get("values")),
        str(row.get("variant") or ""),
        "" if specimen == "astb" else specimen,
        written(row.get("change")),
    )


def written(values: Any) -> str:
    """Return parameters as text, such as load=AW3. Parameters without a value (None) are left out."""
    return ", ".join(f"{name}={value}" for name, value in (values or {}).items() if value is not None)


def verdict_of(row: Row) -> str:
    """Return the verdict of a case, or "error" if it has none."""
    return str(row.get("verdict") or "error")


def reason_of(row: Row) -> str:
    """Return why a case has no verdict or was stopped; "" if it is complete."""
    return str(row.get("error") or row.get("reason") or "")


def failures_first(rows: Iterable[Row]) -> list[Row]:
    """Return rows sorted by verdict, the worst first, then by the number of failed checks, the most first."""

    def place(row: Row) -> tuple[int, int]:
        failed = sum(one["verdict"] == "fail" for one in row.get("checks") or ())
        return WORST_FIRST.index(verdict_of(row)), -failed

    return sorted(rows, key=place)


def by_plan(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each plan, failures first."""
    plans = dict.fromkeys(row["plan"] for row in rows)
    return {plan: failures_first(row for row in rows if row["plan"] == plan) for plan in plans}


def names_of(rows: Iterable[Row]) -> list[str]:
    """Return the checks of all ``rows``, each once, in their order."""
    return list(dict.fromkeys(name_of(one) for row in rows for one in row.get("checks") or ()))


def in_unit(check: Mapping[str, Any], what: str) -> float | None:
    """Return ``what`` of a check (value, low or high) in its unit; None if it is unknown or not finite."""
    number = check[what]
    return None if number is None or not math.isfinite(number) else number / (check["scale"] or 1.0)


def name_of(check: Mapping[str, Any]) -> str:
    """Return the name of a check, which is unique in its plan."""
    phase = str(check.get("phase") or "")
    return (
        f"{check['name']} ({phase})"
        if phase and phase not in {"main", "set-up", "tear-down"}
        else check["name"]
    )


def distributions(rows: Sequence[Row]) -> list[Distribution]:
    """Return the distribution of every check over every kind of case, the largest share of failures first."""
    seen: dict[tuple[Kind, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        for check in row.get("checks") or ():
            seen.setdefault((kind_of(row), name_of(check)), []).append(check)
    found = [_distribution(kind, name, checks) for (kind, name), checks in seen.items()]
    return sorted(found, key=lambda one: -one.failed / one.cases)


def _distribution(kind: Kind, name: str, checks: Sequence[Mapping[str, Any]]) -> Distribution:
    last = checks[-1]
    values = [in_unit(one, "value") for one in checks]
    return Distribution(
        kind,
        name,
        last["unit"] or "",
        [one for one in values if one is not None],
        in_unit(last, "low"),
        in_unit(last, "high"),
        sum(one["verdict"] in FAILED for one in checks),
        len(checks),
    )
