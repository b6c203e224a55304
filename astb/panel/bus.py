"""The CAN bus for the page: number of frames of each identifier, and the commander that the rig reports.

While a user looks at this view, it has its own connection to the bus. It sends no requests to the rig.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from bench_protocol.table import TABLE
from bench_protocol.units import NS, s
from drivers.errors import BenchError
from drivers.stamps import StampClock

if TYPE_CHECKING:
    from astb.panel.answers import Parts
    from astb.panel.watch import Watch
    from bench_protocol.frames import Block
    from drivers.can_port import CanPort

#: A client without a request for this time counts as gone.
LOOKS_FOR: Final = 10 * s
#: Identifiers that are distinguished; frames with further identifiers are counted together.
_IDENTIFIERS_MAX: Final = 256
_TOLD: Final = (
    "rig.lease",
    "rig.holder",
    "rig.late_ticks",
    "rig.lateness_max",
    "rig.rejected_commands",
    "rig.refused_setpoints",
    "rig.strangers",
    "rig.stranger",
    "rig.stranger_identifier",
)


def routes(parts: Parts) -> Sequence[Route]:
    """Return the route of the view *bus*."""
    bus = Bus(parts.watch)

    async def told(request: Request) -> Response:
        del request
        found = await run_in_threadpool(bus.look)
        return Response(msgspec.json.encode(found), media_type="application/json")

    return [Route("/api/bus", told)]


class Bus:
    """Counts frames from the first `look` on, until no client has looked for a while."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._port: CanPort | None = None
        self._lock = threading.Lock()
        self._forget: threading.Timer | None = None
        self._clear()

    def look(self) -> dict[str, Any]:
        """Return the counts since the first look, and the time (s, own clock); the page computes rates from them."""
        if self._lost:
            self.close()
        with self._lock:
            wrong = self._listen()
            if self._forget is not None:
                self._forget.cancel()
            self._forget = threading.Timer(LOOKS_FOR, self.close)
            self._forget.daemon = True
            self._forget.start()
        values = self._watch.glimpses(_TOLD)
        return {
            "error": wrong,
            "time": self._watch.clock.now() / NS,
            "counts": dict(self._counts),
            "others": self._others,
            "gaps": {identifier: gap / NS for identifier, gap in self._gaps.items()},
            "messages": _MESSAGES,
            "run": self._watch.status.run,
            "rig": {name: None if math.isnan(value) else value for name, value in values.items()},
        }

    def close(self) -> None:
        """Leave the bus; the next look connects again."""
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            with suppress(BenchError, OSError):
                port.close()
        self._clear()

    def receive(self, block: Block) -> None:
        """Count the frames of ``block``, and keep the longest gap between two of one identifier."""
        block = self._stamps.times(block, self._watch.clock)
        for identifier in np.unique(block["id"]).tolist():
            times = block["time"][block["id"] == identifier]
            if identifier not in self._counts and len(self._counts) >= _IDENTIFIERS_MAX:
                self._others += times.size
                continue
            before = self._last.get(identifier, int(times[0]))
            gap = int(np.diff(times, prepend=before).max())
            self._gaps[identifier] = max(self._gaps.get(identifier, 0), gap)
            self._last[identifier] = int(times[-1])
            self._counts[identifier] = self._counts.get(identifier, 0) + times.size

    def _on_lost(self, reason: str) -> None:
        self._lost = True  # by the port's own thread, which cannot close it

    def _clear(self) -> None:
        self._lost = False
        self._stamps = StampClock()
        self._counts: dict[int, int] = {}
        self._last: dict[int, int] = {}
        self._gaps: dict[int, int] = {}
        self._others = 0

    def _listen(self) -> str:
        """Connect to the bus; return why that fails, "" on success."""
        from drivers.can_port import open_can

        rig = self._watch.rig
        if rig.wiring:
            return f"{rig.name} has its own wiring; the bus view is only for rigs with the ASTB protocol"
        if self._port is None:
            try:
                self._port = open_can(rig.can.bus, host=rig.can.host, port=rig.can.port)
            except (BenchError, OSError) as error:
                return str(error)
            self._port.on_lost(self._on_lost)
            self._port.subscribe(self.receive)
        return ""


_MESSAGES: Final = {
    message.identifier: {
        "name": message.name,
        "rate": message.rate,
        "sender": "rig" if message.from_rig else "commander",
    }
    for message in TABLE.messages
}
