"""An event loop in its own thread, for transports on asynchronous libraries."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

from bench_protocol.units import s

T = TypeVar("T")
#: Additional time (s) for the loop to report its own time-out; a stopped loop reports nothing.
_GRACE: Final = 1 * s


class EventLoop:
    """Runs coroutines for threads that wait for them."""

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T], within: float) -> T:
        """Run ``work`` and return its result. Raises TimeoutError after ``within`` s."""
        waited = asyncio.wait_for(work, within)
        return asyncio.run_coroutine_threadsafe(waited, self._loop).result(within + _GRACE)

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Run ``work`` until `stop`."""
        asyncio.run_coroutine_threadsafe(work, self._loop)

    def stop(self) -> None:
        """End the loop and all work that still runs in it."""

        async def cancel() -> None:
            rest = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
            for task in rest:
                task.cancel()
            await asyncio.gather(*rest, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(cancel(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
