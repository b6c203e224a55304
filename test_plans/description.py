"""Description of the rig for a plan: its dimensions by name, its missing parts, and its clocks."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from functools import cache, wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

from bench_protocol.dimensions import NAMES, UNKNOWN, Dimension, Dimensions, lag, ordinary
from bench_protocol.named_files import ORDINARY_RIG
from bench_protocol.signals import MEASURED
from drivers.errors import NotAvailable
from drivers.wiring.contract import Stamp

if TYPE_CHECKING:
    from drivers.bench import Bench

_Follows = TypeVar("_Follows", bound=Callable[..., Any])


class Description(Mapping[str, float]):
    """The dimensions of a rig (SI) by the names of `bench_protocol.dimensions`. They do not change.

    A dimension that is not stated has no default: reading it raises NotAvailable, with its name.
    """

    __slots__ = ("dimensions", "known", "rig")

    def __init__(self, rig: str, dimensions: Dimensions = UNKNOWN) -> None:
        self.rig, self.dimensions = rig, dimensions
        self.known: dict[Hashable, Any] = {}  #: what follows from them (`once_for_a_rig`)

    def __getitem__(self, name: str) -> float:
        if known := self.dimensions.known.get(name):
            return known.value
        if name not in NAMES:
            raise KeyError(name)
        raise NotAvailable(self.lacks(name))

    def __contains__(self, name: object) -> bool:
        return name in self.dimensions.known

    def __iter__(self) -> Iterator[str]:
        return iter(self.dimensions.known)

    def __len__(self) -> int:
        return len(self.dimensions.known)

    def stated(self, name: str) -> Dimension | None:
        """Return a dimension with its uncertainty; None if it is not stated or not a dimension."""
        return self.dimensions.known.get(name)

    def lacks(self, *names: str) -> str:
        """Return a text that lists the dimensions among ``names`` that are not stated; "" if all are stated."""
        missing = [name for name in dict.fromkeys(names) if name not in self.dimensions.known]
        if not missing:
            return ""
        where = self.dimensions.file or "its rig file names no dimensions"
        return f"{self.rig} has no {', '.join(missing)}: it is not stated ({where})"


def once_for_a_rig(follows: _Follows) -> _Follows:
    """Decorator: cache the results of a function of a rig and hashable arguments. Only results for a `Description` are
    cached, because other mappings can change.
    """

    @wraps(follows)
    def known(rig: Mapping[str, float], *args: Hashable) -> Any:
        if not isinstance(rig, Description):
            return follows(rig, *args)
        key = follows, args
        if key not in rig.known:
            rig.known[key] = follows(rig, *args)
        return rig.known[key]

    return cast(_Follows, known)


def is_dimension(need: str) -> bool:
    """Return whether a need of a plan is a dimension, and not a signal."""
    return need in NAMES


@once_for_a_rig
def lag_of(rig: Mapping[str, float], *signals: str) -> float:
    """Return the mean lag (s) of the sensors of some signals."""
    return sum(rig[lag(one)] for one in signals) / len(signals)


def lags(signals: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the dimensions that state the lags of some signals, for the ``needs`` of a plan."""
    return tuple(lag(one) for one in signals)


@cache
def ours() -> Description:
    """Return the description of the virtual bench, for calculations without a rig."""
    return Description(ORDINARY_RIG, ordinary())


def stamps_of(bench: Bench) -> dict[str, Stamp]:
    """Return the time stamp of each measured signal whose clock is known, by signal."""
    wiring = getattr(bench, "wiring", None)
    if wiring is None:
        return {}
    found = {one.name: wiring.stamp(one.name) for one in bench.table.of_kind(*MEASURED)}
    return {name: one for name, one in found.items() if one is not None}


def clocks(bench: Bench) -> dict[str, str]:
    """Return the entries of a record on the clocks, by transport and message: the owner of each clock and its error
    limit.
    """
    return {one.shared: f"{one.clock}, within {one.within * 1e6:g} µs" for one in stamps_of(bench).values()}
