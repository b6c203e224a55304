"""The live capture on TCP: Wireshark and tshark read it as `TCP@127.0.0.1:19901`."""

import asyncio
from typing import Final

from bench_sim.rig.capture import Capture, Tap
from bench_sim.rig.connection import Connection

_SEND_EVERY: Final = 0.02  # s
_CLIENTS_MAX: Final = 8


class _Reader(Connection):
    """A client that reads the capture; bytes from it are discarded."""

    kind = "capture"

    def __init__(self, server: "CaptureServer") -> None:
        super().__init__()
        self._server = server
        self._tap: Tap | None = None
        self._blocked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._server.admit(self):
            self.drop()
            return
        self._tap = self._server.capture.tap()
        self._send()

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        if self._tap is not None:
            self._server.capture.release(self._tap)
            self._tap = None
        self._server.forget(self)

    def pause_writing(self) -> None:
        self._blocked = True  # the tap keeps new frames, and drops the oldest when it is full

    def resume_writing(self) -> None:
        self._blocked = False

    def _send(self) -> None:
        if self._tap is None or self.transport is None or self.transport.is_closing():
            return
        if not self._blocked and (data := self._tap.read()):
            self.transport.write(data)
        self.loop.call_later(_SEND_EVERY, self._send)


class CaptureServer:
    """Sends the frames of ``capture`` to every client as pcapng, from the moment of its connection on."""

    def __init__(self, capture: Capture) -> None:
        self.capture = capture
        self._readers: dict[_Reader, None] = {}

    def client(self) -> asyncio.Protocol:
        """Return the protocol object of a new connection."""
        return _Reader(self)

    def admit(self, reader: _Reader) -> bool:
        """Add ``reader`` and return True, or return False if too many readers are connected."""
        if len(self._readers) >= _CLIENTS_MAX:
            return False
        self._readers[reader] = None
        return True

    def forget(self, reader: _Reader) -> None:
        """Remove ``reader`` from the connected readers."""
        self._readers.pop(reader, None)

    def close(self) -> None:
        """Disconnect all readers."""
        for reader in list(self._readers):
            reader.drop()
