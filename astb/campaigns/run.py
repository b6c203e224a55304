"""A campaign: it runs the cases that are not stored yet, stores a row for each, and reports progress."""

from collections.abc import Callable, Mapping
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from astb.campaigns.core import carried_out
from astb.campaigns.kept import KeptFailed, KeptRows, read_rows
from astb.campaigns.on_a_worker import Finished
from astb.campaigns.workers import cluster
from bench_protocol.clock import RealClock
from bench_protocol.units import NS

if TYPE_CHECKING:
    from distributed import Client

Case = TypeVar("Case")

_CLOCK: Final = RealClock()


@dataclass(frozen=True, slots=True)
class Standing:
    """Progress of a campaign."""

    total: int  #: number of requested cases
    before: int  #: number of cases that were stored before it began
    done: int  #: number of cases that ran since
    failed: int  #: number of these without a result
    elapsed: float  #: s since the workers are ready
    row: Mapping[str, Any]  #: the latest; empty at the beginning

    @property
    def left(self) -> int:
        """Number of remaining cases."""
        return self.total - self.before - self.done

    @property
    def time_left(self) -> float | None:
        """Predicted time (s) for the remaining cases, from the cases so far."""
        return self.elapsed * self.left / self.done if self.done else None


def run_cases(
    function: Callable[[Case], Mapping[str, Any]],
    cases: Mapping[str, Case],
    out: Path | str,
    *,
    facts: Callable[[Case], Mapping[str, Any]] | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    client: "Client | None" = None,
    limit: float | None = None,
    prepare: Callable[[], Any] | None = None,
    again: bool = False,
    watch: Callable[[Standing], None] = lambda standing: None,
) -> list[dict[str, Any]]:
    """Run the ``cases`` that are not stored in ``out``, and return the rows of all of them, in their order.

    The key of a case is its permanent name: a case with a stored key is not computed again, except failed cases with
    ``again``. A row has key, the result of ``facts`` for the case, the result of ``function`` (numbers, texts, lists
    and dictionaries of them), error ("" if there is none), seconds and worker. The row is stored as soon as the case
    has ended.

    Workers are those of a ``client`` or of the ``scheduler`` at an address, else processes of this machine: one for
    each core, or ``workers``. `carried_out` explains ``limit`` and ``prepare``. Raises KeptError, before anything
    starts, if ``out`` cannot be used. Raises ClusterError if the cluster is lost. After any interruption,
    KeyboardInterrupt included, the same call continues with the remaining cases.
    """
    with KeptRows(Path(out), without_errors=again) as kept:
        left = {key: case for key, case in cases.items() if key not in kept.keys}
        before, failed = len(cases) - len(left), 0
        start = _CLOCK.now()

        def report(number: int, row: Mapping[str, Any]) -> None:
            watch(Standing(len(cases), before, number, failed, (_CLOCK.now() - start) / NS, row))

        report(0, {})
        if left:
            with nullcontext(client) if client else cluster(scheduler, workers=workers) as present:
                start = _CLOCK.now()
                ended = carried_out(present, function, left, limit=limit, prepare=prepare)
                with closing(ended):
                    for number, one in enumerate(ended, 1):
                        row = _store_row(kept, one, dict(facts(left[one.key])) if facts else {})
                        failed += bool(row["error"])
                        report(number, row)
    rows = {row["key"]: row for row in read_rows(Path(out))}
    return [rows[key] for key in cases]


def _store_row(kept: KeptRows, one: Finished, facts: dict[str, Any]) -> dict[str, Any]:
    """Store the row of a case, and return it; a row with values that cannot be stored is replaced by an error."""
    known = {"key": one.key, **facts}
    content = {"error": one.error, "seconds": one.seconds, "worker": one.worker}
    try:
        if not isinstance(one.value, Mapping | None):
            raise ValueError(f"the case returned {type(one.value).__name__}; it must return a dictionary")
        row = {**known, **(one.value or {}), **known, **content}  # a result does not rename its case
        kept.add(row)
    except KeptFailed:
        raise
    except ValueError as error:
        row = known | content | {"error": str(error)}
        kept.add(row)
    return row
