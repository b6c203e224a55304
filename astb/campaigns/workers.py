"""The workers of a campaign: processes of this machine, or those of a dask scheduler."""

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.extras import installed, lacking
from bench_protocol.runtime import processors
from bench_protocol.units import s

if TYPE_CHECKING:
    from distributed import Client

#: Time for a scheduler to answer, and for workers to start.
CONNECT: Final = 20 * s
LOOPBACK: Final = "127.0.0.1"

_SETTINGS: Final[dict[str, Any]] = {
    # A case whose worker dies is tried once more, because the case may not be the cause.
    "distributed.scheduler.allowed-failures": 1,
    # A case may block the interpreter for longer than a heartbeat; the death of a process is detected without them.
    "distributed.scheduler.worker-ttl": None,
    # A worker gets its next case when the present one is done, so that no case waits on a worker that dies.
    "distributed.scheduler.worker-saturation": 1.0,
    # The default self-monitoring of dask uses 9 % of a core with two idle workers; this setting uses 1.5 %.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "10s",
}
#: Ctrl-C on a terminal is for the campaign alone, and it ends its workers.
_DEAF: Final = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


class ClusterError(RuntimeError):
    """The scheduler cannot be reached, has no workers, or the libraries for one are not installed."""


@contextmanager
def cluster(scheduler: str | None = None, *, workers: int | None = None) -> Iterator["Client"]:
    """Yield a client of the ``scheduler`` (``tcp://host:port``), or of a local cluster that ends with the block.

    The local cluster has a process for each core, or this number of ``workers``. Each has one thread, its share of the
    memory, and ports on 127.0.0.1 only. Raises ClusterError if the scheduler does not answer.
    """
    if not installed("campaign"):
        raise ClusterError(lacking("campaign", "campaigns"))
    import dask
    from distributed import Client, LocalCluster

    if scheduler:
        try:
            client = Client(scheduler, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterError(
                f"no scheduler answers at {scheduler} within {CONNECT:g} s ({error}); start one with "
                "`dask scheduler`"
            ) from None
        with client:
            yield client
        return
    with (
        dask.config.set(_SETTINGS),
        LocalCluster(
            n_workers=workers or processors(),
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            silence_logs=logging.CRITICAL,
            preload=[_DEAF],
        ) as local,
        Client(local, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def executor(scheduler: str | None = None, *, workers: int | None = None) -> Iterator[Executor]:
    """Yield an executor of `concurrent.futures` on the workers of a `cluster`, for work of several kinds or stages.

    The end of the block does not wait: unfinished work is cancelled.
    """
    with cluster(scheduler, workers=workers) as client:
        yield client.get_executor(pure=False)
