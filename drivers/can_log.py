"""Raw CAN frames in files, by python-can's own writers; the ending of the file name selects the format."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import can

from bench_protocol.account import Account
from bench_protocol.file_forms import endings
from bench_protocol.frames import Block
from bench_protocol.os_errors import error_text, reason
from bench_protocol.socketcand import iterate
from bench_protocol.units import NS
from drivers.can_files.frames import CanLogError
from drivers.can_files.reading import FORMS, read_log
from drivers.can_port import CanPort

_PATIENCE: Final = 60.0  # s, for a slow disk at the end


class CanLog:
    """Writes every frame that ``port`` receives to ``path`` until it is closed, in its own thread.

    Do not send through this port: it does not receive its own frames, so they would be missing in the file. If writing
    fails, ``report(error)`` is called at once in the writing thread. Raises CanLogError for an unknown ending of the
    name, or a file that cannot be created.
    """

    def __init__(
        self, port: CanPort, path: Path, report: Callable[[CanLogError], object] = lambda error: None
    ) -> None:
        self._report = report
        self._writer = _open_writer(path)
        self._path = path
        self._waiting: queue.SimpleQueue[Block | None] = queue.SimpleQueue()
        self._failure = ""
        self._port = port
        self._thread = threading.Thread(target=self._write, name="CAN log", daemon=True)
        self._thread.start()
        port.subscribe(self._waiting.put)

    def close(self) -> None:
        """Leave the bus and finish the file. Raises CanLogError if writing has failed."""
        self._port.close()
        self._waiting.put(None)
        self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self._failure = f"the disk did not store the last frames within {_PATIENCE:g} s"
        if self._failure:
            raise self._error()

    def _write(self) -> None:
        try:
            while (block := self._waiting.get()) is not None:
                for message in _messages(block):
                    self._writer.on_message_received(message)
            self._writer.stop()
        except Exception as error:  # writers have their own exceptions; the caller of close gets each of them
            self._failure = error_text(error)
            self._report(self._error())
            while self._waiting.get() is not None:
                pass  # frames that cannot be written must not fill the memory

    def _error(self) -> CanLogError:
        return CanLogError(
            f"{self._path} is incomplete, because frames could not be written: {self._failure}; repeat the run"
        )


def write_frames(blocks: Iterable[Block], path: Path) -> int:
    """Write frames to a file; return their number. Raises CanLogError as `CanLog` does."""
    count = 0
    writer = _open_writer(path)
    try:
        for block in blocks:
            for message in _messages(block):
                writer.on_message_received(message)
                count += 1
    finally:
        writer.stop()
    return count


def read_frames(path: Path) -> Iterator[Block]:
    """Yield the classic data frames of a file in order of time; their times (ns) are those in the file."""
    yield from read_log(path, Account()).blocks(lambda kind: True)


def _messages(block: Block) -> Iterator[can.Message]:
    for time, identifier, extended, data in iterate(block):
        yield can.Message(timestamp=time / NS, arbitration_id=identifier, is_extended_id=extended, data=data)


def _open_writer(path: Path) -> can.Listener:
    form = next((one for one in FORMS if path.suffix.lower() in one.endings), None)
    if form is None or form.write is None:
        known = ", ".join(endings([one for one in FORMS if one.write is not None]))
        raise CanLogError(f"{path} ends in {path.suffix or 'nothing'}; use one of {known}")
    try:
        writer: can.Listener = form.write(path)
    except (OSError, ValueError, ImportError, NotImplementedError) as error:
        raise CanLogError(f"{path} cannot be written: {reason(error)}") from None
    return writer
