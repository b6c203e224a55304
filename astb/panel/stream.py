"""Data for an open page over one WebSocket: status as JSON, pictures of signals as binary frames.

A picture is sent after the one before has been sent. A page that reads slowly loses pictures, and the server never
waits.

A binary frame is, little-endian: number of the trace (u32), signals (u32), intervals (u32), 1 to discard earlier
intervals (u32), number of the first interval (f64), length of an interval in s (f64), then the lows and the highs as
f32, signal by signal; NaN without samples.
"""

import asyncio
import struct
from contextlib import suppress
from math import ceil
from typing import Annotated, Any, Final

import msgspec
import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from astb.panel.access import Access
from astb.panel.envelope import Scale
from astb.panel.runs import Runs
from astb.panel.watch import Watch
from bench_protocol.units import hours, ms

PERIOD: Final = 66 * ms
STATUS_EVERY: Final = 3  # pictures
#: The intervals of this time are sent again, because samples may arrive late.
_AGAIN: Final = 150 * ms
HEAD: Final = struct.Struct("<IIIIdd")
_TRACES_MAX: Final = 12
_NAME_MAX: Final = 64  # characters of the name of a page


def _short(error: Exception) -> str:
    """Return an error as text that fits into a close frame (123 bytes)."""
    return f"the message is not valid JSON: {error}".encode("ascii", "replace")[:100].decode()


class Wanted(msgspec.Struct, frozen=True):
    """A trace that a page requests: some signals over the last ``span`` s in about this number of columns."""

    id: int
    signals: Annotated[list[str], msgspec.Meta(min_length=1, max_length=32)]
    span: Annotated[float, msgspec.Meta(ge=1, le=1 * hours)]
    columns: Annotated[int, msgspec.Meta(ge=50, le=4000)] = 1000


class _Request(msgspec.Struct, frozen=True):
    traces: Annotated[list[Wanted], msgspec.Meta(max_length=_TRACES_MAX)]


class Trace:
    """The progress of sending one trace to one page."""

    def __init__(self, wanted: Wanted, watch: Watch) -> None:
        self.wanted = wanted
        self._rows = np.array([watch.row[name] for name in wanted.signals], np.int64)
        self._scale: Scale = watch.envelope.scale(wanted.span, wanted.columns)
        self._again = ceil(_AGAIN / self._scale.width)
        self._most = min(self._scale.most, ceil(wanted.span / self._scale.width) + 1)
        self._next = -1

    def picture(self) -> bytes:
        """Return the data since the last picture as a binary frame; b"" if there are none."""
        head, fresh = self._scale.head, self._next < 0
        if head < 0 or (head < self._next and not fresh):
            return b""
        first = max(head - self._most + 1, 0 if fresh else self._next - self._again)
        low, high = self._scale.read(self._rows, first)
        self._next = first + low.shape[1] - 1  # the last one may still fill
        head_bytes = HEAD.pack(
            self.wanted.id, len(self._rows), low.shape[1], fresh, float(first), self._scale.width
        )
        return b"".join((head_bytes, low.astype("<f4").tobytes(), high.astype("<f4").tobytes()))


class Stream:
    """Serves the WebSocket of every page."""

    def __init__(self, watch: Watch, runs: Runs, access: Access) -> None:
        self._watch, self._runs, self._access = watch, runs, access
        self._pages: dict[int, str] = {}
        # One picture at a time for the pages with the token, and one for the others; see `_picture`.
        self._turns = {may: asyncio.Lock() for may in (True, False)}

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it leaves."""
        await socket.accept()
        if no_place := socket.scope.get("state", {}).get("no_place"):
            return await socket.close(1013, no_place)
        page = socket.query_params.get("page", "")[:_NAME_MAX]
        self._pages[id(socket)] = page
        traces: list[Trace] = []
        sending = asyncio.create_task(self._send(socket, page, traces))
        try:
            while True:
                message = await socket.receive()
                if message["type"] != "websocket.receive":
                    return
                if (text := message.get("text")) is None:
                    return await socket.close(1003, "the message is not a text")
                try:
                    wanted = msgspec.json.decode(text, type=_Request).traces
                    traces[:] = [Trace(one, self._watch) for one in wanted]
                except (msgspec.MsgspecError, KeyError, UnicodeError, RecursionError) as error:
                    return await socket.close(1008, _short(error))
        except WebSocketDisconnect:
            pass
        finally:
            self._pages.pop(id(socket), None)
            sending.cancel()

    async def _send(self, socket: WebSocket, page: str, traces: list[Trace]) -> None:
        count = 0
        with suppress(RuntimeError, WebSocketDisconnect):  # gone
            while True:
                if count % STATUS_EVERY == 0:
                    await socket.send_text(self._status(socket, page))
                for trace in tuple(traces):
                    if picture := await self._picture(socket, trace):
                        await socket.send_bytes(picture)
                count += 1
                await asyncio.sleep(PERIOD)

    async def _picture(self, socket: WebSocket, trace: Trace) -> bytes:
        """Wait for the turn of this page, and return the next picture of a trace.

        A picture of an hour of thirty signals takes 50 ms. Pictures use at most half of the time, so that a stop is not
        delayed.
        """
        async with self._turns[self._access.may_command(socket)]:
            now = asyncio.get_running_loop().time
            began = now()
            picture = trace.picture()
            await asyncio.sleep(now() - began)
        return picture

    def _status(self, socket: WebSocket, page: str) -> str:
        may = self._access.may_command(socket)
        if may:
            self._access.keep_seat(page)
        content: dict[str, Any] = {
            "rig": self._watch.present(),
            "runs": self._runs.state(),
            "access": {
                "token": may,
                "seat": may and self._access.has_seat(page),
                "taken": self._access.taken,
                "pages": len(self._pages),
            },
        }
        return msgspec.json.encode(content).decode()
