"""Comparison of two runs: the differences of rig, specimen, parameters, limits, results and curves."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import msgspec

from bench_records.curves import Curve
from bench_records.result import Check, Result
from bench_records.run_folder import circumstances, flattened, open_run

Kind = Literal["changed", "only in A", "only in B"]


class Fact(msgspec.Struct, frozen=True):
    """A difference in the conditions under which the two runs began."""

    what: str
    a: str
    b: str


class CheckPair(msgspec.Struct, frozen=True, kw_only=True):
    """A check of one or both runs. ``change`` is b - a in SI, and ``share`` is change / |a|. They are None if
    unknown.
    """

    phase: str
    name: str
    a: Check | None
    b: Check | None
    change: float | None
    share: float | None
    change_expanded: float | None = None  #: expanded uncertainty, for independent values
    limits_changed: bool
    verdict_changed: bool

    @property
    def exceeds(self) -> bool | None:
        """Whether the change is larger than its uncertainty. It is None if change or uncertainty is unknown."""
        if self.change is None or self.change_expanded is None:
            return None
        return abs(self.change) > self.change_expanded


class CurvePair(msgspec.Struct, frozen=True, kw_only=True):
    """A curve that both runs have. ``apart`` is the r.m.s. of the difference in y divided by the r.m.s. of A's y. It
    is None for loops.
    """

    group: str
    name: str
    a: Curve
    b: Curve
    apart: float | None


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """The comparison of run A with run B."""

    a: str  #: the path as given
    b: str
    names: tuple[str, str]  #: of their folders, with as many parent folders as make them different
    facts: list[Fact]
    verdicts: tuple[str, str]
    circumstances: tuple[str, str]  #: simulated, virtual time, effects and changes; empty for a real rig
    checks: list[CheckPair]
    curves: list[CurvePair]
    lonely_curves: list[str]  #: curves of only one run, with the run


def compare_runs(a: Path, b: Path) -> Comparison:
    """Return the comparison of the runs in the directories ``a`` and ``b``. Raises RecordError if one is not a run."""
    (one, facts, first), (other, other_facts, second) = open_run(a), open_run(b)
    curves, lonely = _curve_pairs(one.curves, other.curves)
    return Comparison(
        a=str(a),
        b=str(b),
        names=_names(a, b),
        facts=_facts(_all_facts(one, facts), _all_facts(other, other_facts)),
        verdicts=(first, second),
        circumstances=(" · ".join(circumstances(facts)), " · ".join(circumstances(other_facts))),
        checks=_check_pairs(one.checks, other.checks),
        curves=curves,
        lonely_curves=lonely,
    )


def _names(a: Path, b: Path) -> tuple[str, str]:
    """Return the last parts of two paths, with as many folders as are needed to distinguish them."""
    one, other = (path.resolve().parts for path in (a, b))
    for count in range(1, max(len(one), len(other)) + 1):
        if one[-count:] != other[-count:]:
            return "/".join(one[-count:]), "/".join(other[-count:])
    return one[-1], other[-1]


def _all_facts(result: Result, facts: dict[str, Any]) -> dict[str, str]:
    content = {name: value for name, value in facts.items() if name not in {"title", "instruction"}}
    if isinstance(
        parameters := content.get("parameters"), dict
    ):  # `circumstances` lists the effects in words
        content["parameters"] = {name: value for name, value in parameters.items() if name != "effects"}
    if isinstance(
        instruments := content.get("instruments"), dict
    ):  # the checksum of their file shows a difference
        content["instruments"] = {name: value for name, value in instruments.items() if name != "pieces"}
    content |= {"plan": result.plan, "rig": result.rig, "seed": result.seed, "set": result.parameters}
    if result.specimen is not None:
        content["specimen"] = msgspec.to_builtins(result.specimen)
    return {
        # The first 12 digits of a checksum are enough.
        name: "" if value is None else str(value)[:12] if name.endswith("sha256") else str(value)
        for name, value in flattened(content)
    }


def _facts(a: dict[str, str], b: dict[str, str]) -> list[Fact]:
    return [
        Fact(what, a.get(what, ""), b.get(what, ""))
        for what in dict.fromkeys([*a, *b])
        if a.get(what, "") != b.get(what, "")
    ]


def _check_pairs(a: list[Check], b: list[Check]) -> list[CheckPair]:
    """Return pairs of checks with the same phase and name, in the order of the checks."""
    return [_check_pair(key, one, other) for key, one, other in _paired(a, b, lambda c: (c.phase, c.name))]


def _check_pair(key: tuple[str, str], a: Check | None, b: Check | None) -> CheckPair:
    phase, name = key
    change = share = expanded = None
    if a and b and math.isfinite(a.number) and math.isfinite(b.number):
        change = b.number - a.number
        share = change / abs(a.number) if a.number else None
        if a.expanded is not None and b.expanded is not None:
            expanded = math.hypot(a.expanded, b.expanded)
    return CheckPair(
        phase=phase,
        name=name,
        a=a,
        b=b,
        change=change,
        share=share,
        change_expanded=expanded,
        limits_changed=bool(a and b and (a.low, a.high) != (b.low, b.high)),
        verdict_changed=bool(a and b and a.verdict != b.verdict),
    )


def _curve_pairs(a: list[Curve], b: list[Curve]) -> tuple[list[CurvePair], list[str]]:
    pairs, lonely = [], []
    for (group, name), one, other in _paired(a, b, lambda c: (c.group, c.name)):
        if one is None or other is None:
            lonely.append(f"{group + ': ' if group else ''}{name} only in {'A' if one else 'B'}")
        else:
            pairs.append(
                CurvePair(group=group, name=name, a=one, b=other, apart=_relative_difference(one, other))
            )
    return pairs, lonely


def _relative_difference(a: Curve, b: Curve) -> float | None:
    """Return the relative r.m.s. difference of two sweeps in their common range. B is interpolated at the abscissas
    of A. Return None if it cannot be computed.
    """
    import numpy as np

    if a.kind != "sweep" or b.kind != "sweep":
        return None
    xa, ya, xb, yb = (np.array([np.nan if n is None else n for n in s]) for s in (a.xs, a.ys, b.xs, b.ys))
    good_a, good_b = np.isfinite(xa + ya), np.isfinite(xb + yb)
    xa, ya, xb, yb = xa[good_a], ya[good_a], xb[good_b], yb[good_b]
    order = np.argsort(xb, kind="stable")
    if not xa.size or not xb.size:
        return None
    shared = (xa >= xb.min()) & (xa <= xb.max())
    size = float(np.sqrt(np.mean(ya[shared] ** 2))) if shared.any() else 0.0
    if not size:
        return None
    difference = np.interp(xa[shared], xb[order], yb[order]) - ya[shared]
    return float(np.sqrt(np.mean(difference**2))) / size


def _paired(a: list[Any], b: list[Any], key: Any) -> Iterable[tuple[Any, Any, Any]]:
    """Yield key, item of ``a`` and item of ``b`` for items with the same key. The order is that of ``a``, then of
    ``b``. None replaces a missing item.
    """
    left: dict[Any, list[Any]] = defaultdict(list)
    for one in b:
        left[key(one)].append(one)
    for one in a:
        rest = left[key(one)]
        yield key(one), one, rest.pop(0) if rest else None
    for name, rest in left.items():
        for one in rest:
            yield name, None, one
