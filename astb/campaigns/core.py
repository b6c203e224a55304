"""Runs many cases of one function on a cluster, one on each thread; each result is reported when its case ends."""

from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final, TypeVar
from uuid import uuid4

from astb.campaigns.on_a_worker import GRACE, Finished, carry_out, in_words
from astb.campaigns.workers import ClusterError
from bench_protocol.clock import RealClock
from bench_protocol.units import NS, s

if TYPE_CHECKING:
    from distributed import Client, Future

Case = TypeVar("Case")

#: Time for a scheduler without workers to get new ones.
WITHOUT_WORKERS: Final = 60 * s
_LOOK: Final = 1 * s
_CLOCK: Final = RealClock()


@dataclass(frozen=True, slots=True)
class _Submitted:
    key: str
    future: "Future"
    at: int  #: ns


def carried_out(
    client: "Client",
    function: Callable[[Case], Any],
    cases: Mapping[str, Case],
    *,
    limit: float | None = None,
    prepare: Callable[[], Any] | None = None,
) -> Generator[Finished, None, None]:
    """Yield the result of each case, in the order of their ends.

    ``function``, ``prepare`` and the cases must be picklable. Each worker calls ``prepare`` once. ``limit`` (s) is the
    time limit of a case, without ``prepare``. If a case raises an exception, crashes its worker repeatedly or exceeds
    the limit, its result has an error. Raises ClusterError if scheduler or workers are gone. Closing the iterator
    cancels running cases.
    """
    from cloudpickle import dumps  # pickles functions of a script, too

    run = uuid4().hex  # another client of the same scheduler must not receive these results
    ended: SimpleQueue[Future] = SimpleQueue()
    running: dict[Any, _Submitted] = {}
    waiting = enumerate(cases.items())
    found: list[Finished] = []
    try:
        while True:
            # Only one for each thread: a case that waits behind one that kills its worker would count as a cause, too.
            room = max(_threads(client), 1)
            while len(running) < room and (following := next(waiting, None)):
                number, (key, case) = following
                try:
                    packed = dumps((function, case, prepare))
                except Exception as error:
                    text = f"the case cannot be sent: {in_words(error)}; use data that can be pickled"
                    found.append(Finished(key, None, text, 0.0))
                    continue
                future = client.submit(carry_out, key, packed, limit, key=f"case-{run}-{number}", pure=False)
                running[future.key] = _Submitted(key, future, _CLOCK.now())
                future.add_done_callback(ended.put)
            yield from found
            if not running:
                return
            found = [_result(running.pop(future.key), limit) for future in _wait_for_ended(client, ended)]
    finally:
        if running:
            client.cancel([one.future for one in running.values()], force=True)


def _wait_for_ended(client: "Client", ended: "SimpleQueue[Future]") -> "list[Future]":
    """Wait until a future has ended.

    Return it, and all others that have ended by then. Raises ClusterError if there are no workers for a minute.
    """
    found: list[Future] = []
    alone_since = None
    while not found:
        try:
            found.append(ended.get(timeout=_LOOK))
        except Empty:
            if _threads(client):
                alone_since = None
                continue
            alone_since = alone_since or _CLOCK.now()
            if (_CLOCK.now() - alone_since) / NS > WITHOUT_WORKERS:
                raise ClusterError(
                    f"the scheduler at {_address(client)} has had no worker for {WITHOUT_WORKERS:g} s; start workers "
                    f"with `dask worker {_address(client)}`"
                ) from None
    while not ended.empty():
        found.append(ended.get())
    return found


def _threads(client: "Client") -> int:
    """Return the number of cases that the cluster computes at a time. Raises ClusterError if it does not answer."""
    try:
        return sum(client.nthreads().values())
    except (OSError, TimeoutError, ValueError, AttributeError) as error:
        raise ClusterError(
            f"the scheduler at {_address(client)} does not answer: {error}; check that it runs"
        ) from None


def _address(client: "Client") -> str:
    return str(client.scheduler.address) if client.scheduler else "an unknown address"


def _result(one: _Submitted, limit: float | None) -> Finished:
    """Return the result of a future that has ended. Raises ClusterError if it was lost with the cluster."""
    from distributed import KilledWorker

    elapsed = (_CLOCK.now() - one.at) / NS
    try:
        finished: Finished = one.future.result()
    except KilledWorker as error:
        deaths = error.allowed_failures + 1
        words = f"its worker process ended {deaths} times during this case"
        if limit is not None and elapsed > deaths * (limit + GRACE):
            words += f", each time beyond its time limit of {limit:g} s"
        return Finished(one.key, None, words, elapsed)
    except (CancelledError, OSError) as error:
        raise ClusterError(f"the cluster lost the case {one.key}: {error}; check its workers") from None
    except Exception as error:  # its result cannot be sent
        return Finished(one.key, None, in_words(error), elapsed)
    return finished
