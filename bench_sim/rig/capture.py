"""A capture of all frames of the CAN bus, to a file, a named pipe, or live readers."""

import contextlib
import os
import stat
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Final

from bench_protocol.clock import wall_time_ns
from bench_protocol.frames import Block
from bench_protocol.os_errors import reason
from bench_sim.rig.can_bus import Stage
from bench_sim.rig.pcapng import header_bytes, packet_bytes, statistics_bytes

#: Frames that wait for one reader: half a minute of a full bus. Then the oldest go, and the capture states how many.
WAITING_MAX: Final = 1 << 17
_WRITE_EVERY: Final = 0.05  # s
_PATIENCE: Final = 1.0  # s, for the writing thread at the end


class Tap:
    """The queue of one reader. It contains the frames since the last read, and returns them in the format pcapng."""

    def __init__(self, bus: str, waiting_max: int = WAITING_MAX) -> None:
        self._waiting: deque[tuple[Block, bool]] = deque()
        self._frames, self._frames_max = 0, waiting_max
        self._begun, self._bus = False, bus
        self._lock = threading.Lock()
        #: Frames that are missing because they were not fetched in time.
        self.dropped = 0

    def put(self, block: Block, *, outbound: bool) -> None:
        """Queue ``block`` for the reader. If the queue is full, the oldest frames are dropped and counted."""
        with self._lock:
            self._waiting.append((block, outbound))
            self._frames += block.size
            while self._frames > self._frames_max:
                lost, _ = self._waiting.popleft()
                self._frames -= lost.size
                self.dropped += lost.size

    def read(self) -> bytes:
        """Return all bytes since the last call. The first call also returns the file header."""
        with self._lock:
            waiting, self._waiting, self._frames = self._waiting, deque(), 0
        parts = [packet_bytes(block, outbound=outbound) for block, outbound in waiting]
        if not self._begun:
            self._begun = True
            parts.insert(0, header_bytes(self._bus))
        return b"".join(parts)

    def end(self) -> bytes:
        """Return the last bytes of the capture, which state the number of dropped frames."""
        return self.read() + statistics_bytes(wall_time_ns(), self.dropped)


class Capture(Stage):
    """Passes a copy of every frame on the bus to any number of readers. Without readers it takes almost no time."""

    rank = Stage.RECORD

    def __init__(self, bus: str = "vcan0") -> None:
        self.bus = bus
        self._taps: tuple[Tap, ...] = ()

    def tap(self) -> Tap:
        """Add a reader and return its queue, which receives all frames from now on."""
        tap = Tap(self.bus)
        self._taps += (tap,)
        return tap

    def release(self, tap: Tap) -> None:
        """Remove the reader with the queue ``tap``."""
        self._taps = tuple(one for one in self._taps if one is not tap)

    def outgoing(self, block: Block, now: int) -> Block:
        del now
        for tap in self._taps:
            tap.put(block, outbound=True)
        return block

    def incoming(self, block: Block, peer: str, now: int) -> Block:
        del peer, now
        for tap in self._taps:
            tap.put(block, outbound=False)
        return block


class CaptureFile:
    """Writes the frames of ``capture`` to the file ``path`` in a separate thread, until ``close``.

    For a named pipe it waits for a reader, and after each reader for the next one. ``complain(reason)`` is called if
    the file can no longer be written. Raises OSError if the file cannot be opened.
    """

    def __init__(self, capture: Capture, path: Path, complain: Callable[[str], None]) -> None:
        self._capture, self._path, self._complain = capture, path, complain
        self._closing = threading.Event()
        self._pipe = path.exists() and stat.S_ISFIFO(path.stat().st_mode)
        file = None if self._pipe else self._open()
        self._thread = threading.Thread(target=self._run, args=(file,), name="capture", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write the remaining frames and end the thread."""
        self._closing.set()
        self._thread.join(_PATIENCE)

    def _open(self) -> BinaryIO:
        try:
            return self._path.open("wb")
        except OSError as error:
            text = f"the capture {self._path} cannot be written: {reason(error)}"
            raise OSError(error.errno, text) from None

    def _run(self, file: BinaryIO | None) -> None:
        while not self._closing.is_set():
            file = file or self._when_read()
            if file is None:
                return
            tap = self._capture.tap()
            try:
                self._write(file, tap)
            except BrokenPipeError:
                pass  # this reader has left
            except OSError as error:
                self._complain(f"the capture {self._path} ends here: {reason(error)}")
                return
            finally:
                self._capture.release(tap)
                with contextlib.suppress(OSError):
                    file.close()
                file = None

    def _write(self, file: BinaryIO, tap: Tap) -> None:
        while not self._closing.wait(_WRITE_EVERY):
            file.write(tap.read())
            file.flush()
        file.write(tap.end())

    def _when_read(self) -> BinaryIO | None:
        """Wait until a reader opens the named pipe, and return the open pipe. Return None if `close` is called
        before.
        """
        while not self._closing.is_set():
            with contextlib.suppress(OSError):
                descriptor = os.open(self._path, os.O_WRONLY | os.O_NONBLOCK)
                os.set_blocking(descriptor, True)
                return os.fdopen(descriptor, "wb")
            self._closing.wait(_WRITE_EVERY)
        return None
