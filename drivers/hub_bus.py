"""``astb-hub``: a python-can bus on a socketcand server that detects the loss of the server and loses no frame.

python-can has a client for the same protocol (``socketcand``). That client has five defects. It cannot open on a busy
bus. At full load it does not detect the end of the server, and receives nothing from then on. It fails on empty frames,
corrupts remote frames, and needs ten seconds to detect a missing server. Any tool built on python-can can use this
bus::

    can.Bus(interface="astb-hub", channel="vcan0", host="127.0.0.1", port=29536, ignore_config=True)
"""

import contextlib
import logging
import select
import socket
from collections import deque
from typing import Final

import can
from can.typechecking import CanFilters

from bench_protocol import socketcand
from bench_protocol.frames import Block, frame, join
from drivers.wire import Wire

_LOG: Final = logging.getLogger(__name__)
_READ_SIZE: Final = 1 << 18
_MOMENT: Final = 1.0  # s


class HubBus(can.BusABC):
    """A CAN bus served by a socketcand server, such as the rig's hub.

    Sending and receiving may happen in different threads, but only one thread may receive. There is no ``fileno()``,
    because python-can's Notifier would wait on it and miss the frames that are buffered here. Error frames of the
    server are counted in ``error_frames``, unknown lines in ``bad_lines``.
    """

    def __init__(
        self,
        channel: str = "vcan0",
        host: str = "127.0.0.1",
        port: int = 29536,
        timeout: float = 2.0,
        can_filters: CanFilters | None = None,
        **kwargs: object,
    ) -> None:
        """Connect to the server at ``host``:``port`` and join its bus ``channel``.

        ``timeout`` (s) limits the connection, each answer of the server while opening, and each send.
        Raises can.CanInitializationError, at once if no server listens.
        """
        self.channel = channel
        self._where = f"{channel} at {host}:{port}"
        self.channel_info = f"astb-hub {self._where}"
        self.error_frames = 0
        self.bad_lines = 0
        #: The TCP port from which this bus reaches its server.
        self.local_port = 0
        self._parser = socketcand.Parser(sender=f"the server of {self._where}")
        self._blocks: deque[Block] = deque()
        self._lost = ""
        try:
            hello = socketcand.open_bytes(channel)
            self._socket = socket.create_connection((host, int(port)), timeout=timeout)
        except ValueError as error:
            raise can.CanInitializationError(str(error)) from None
        except OSError as error:
            reason = (
                "no server listens there; check that the rig runs"
                if isinstance(error, ConnectionRefusedError)
                else error.strerror or str(error)
            )
            raise can.CanInitializationError(f"cannot open {self._where}: {reason}", error.errno) from None
        try:
            #: Socket for other writers, who must write whole lines.
            self.wire = Wire.on(self._socket.fileno(), lines=True)
            self.local_port = int(self._socket.getsockname()[1])
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            waiting: deque[socketcand.Event] = deque()
            self._expect("hi", waiting)
            self._socket.sendall(hello)
            self._expect("ok", waiting)
            self._socket.sendall(socketcand.RAW_MODE)
            self._expect("ok", waiting)
            # On a busy bus the first frames come in the same packet as the last answer.
            self._sort(waiting)
        except (OSError, can.CanError) as error:
            self._close()
            if isinstance(error, can.CanInitializationError):
                raise
            raise can.CanInitializationError(f"cannot open {self._where}: {error}") from None
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def _expect(self, word: str, waiting: "deque[socketcand.Event]") -> None:
        """Receive the server's answer ``word``; events received after it stay in ``waiting``."""
        while not waiting:
            data = self._socket.recv(_READ_SIZE)
            if not data:
                raise can.CanInitializationError(
                    f"cannot open {self._where}: the server closed the connection; check that it is a "
                    "socketcand server"
                )
            waiting.extend(self._parser.feed(data))
        event = waiting.popleft()
        if not isinstance(event, socketcand.Command) or event.word != word:
            raise can.CanInitializationError(
                f"cannot open {self._where}: the server sent '{event}' instead of '< {word} >'; check "
                "that it is a socketcand server"
            )

    def recv_block(self, timeout: float | None = None) -> Block:
        """Return all received frames, in order, as one block; wait at most ``timeout`` s for the first.

        The block is empty if no frame was received in that time. Without ``timeout`` the wait has no limit. Times are
        the time stamps of the server (ns since 1970). Filters set on the bus do not apply here. Raises
        can.CanOperationError once the server is gone, after the last of its frames has been returned.
        """
        if not self._blocks:
            self._read(timeout)
        if len(self._blocks) == 1:
            return self._blocks.popleft()
        block = join(self._blocks)
        self._blocks.clear()
        return block

    def send_block(self, block: Block) -> None:
        """Send all frames of ``block`` in order, with one system call; their time stamps are not sent.

        Raises can.CanOperationError if the server is gone or has not taken the frames within the bus's timeout.
        """
        lines = socketcand.send_bytes(block)
        with self.wire.mutex:
            if self._lost:
                raise can.CanOperationError(self._lost)
            if not self.wire.usable:
                raise can.CanOperationError(
                    self._lose("an earlier line was not sent completely; connect again")
                )
            try:
                self._socket.sendall(lines)
            except OSError as error:
                # Part of a line may have been sent, so that the connection is unusable.
                reason = f"frames could not be sent ({error.strerror or error})"
                raise can.CanOperationError(self._lose(reason)) from None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one message; ``timeout`` is ignored, the bus's own applies.

        Raises can.CanOperationError for frames that the protocol does not support: remote, error and FD frames.
        """
        del timeout
        for unfit, what in (
            (msg.is_remote_frame, "a remote frame (RTR)"),
            (msg.is_error_frame, "an error frame"),
            (msg.is_fd, "a CAN FD frame"),
        ):
            if unfit:
                raise can.CanOperationError(
                    f"{what} with identifier {msg.arbitration_id:#x} cannot be sent to {self._where}: "
                    "socketcand carries classic data frames only; use another interface"
                )
        data = bytes(msg.data[: msg.dlc])
        try:
            block = frame(msg.arbitration_id, data, extended=msg.is_extended_id)
        except ValueError as error:
            raise can.CanOperationError(f"cannot be sent to {self._where}: {error}") from None
        self.send_block(block)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._blocks:
            self._read(timeout)
            if not self._blocks:
                return None, False
        block = self._blocks[0]
        if len(block) == 1:
            self._blocks.popleft()
        else:
            self._blocks[0] = block[1:]
        ((time, identifier, extended, data),) = socketcand.iterate(block[:1])
        message = can.Message(
            timestamp=time * 1e-9,
            arbitration_id=identifier,
            is_extended_id=extended,
            data=data,
            channel=self.channel,
        )
        return message, False

    def _read(self, timeout: float | None) -> None:
        """Wait up to ``timeout`` s for input (None: without limit) and store its frames. Raises can.CanOperationError
        if the server is lost.
        """
        if self._lost:
            raise can.CanOperationError(self._lost)
        try:
            while not self._blocks:
                if self._readable(timeout):
                    data = self._socket.recv(_READ_SIZE)
                    if not data:
                        raise ConnectionError("the server closed the connection")
                    self._sort(self._parser.feed(data))
                if timeout is not None:
                    return
        except (OSError, ValueError) as error:
            # ValueError: another thread has closed the bus.
            reason = "this bus was closed" if isinstance(error, ValueError) else error.strerror or str(error)
            raise can.CanOperationError(self._lose(reason)) from None

    def _readable(self, timeout: float | None) -> bool:
        """Return whether input arrives within ``timeout`` s (None: 1 s).

        Uses poll() because epoll sometimes does not wake when another thread closes the socket.
        """
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        return bool(poll.poll(1000 * (_MOMENT if timeout is None else timeout)))

    def _sort(self, events: "list[socketcand.Event] | deque[socketcand.Event]") -> None:
        for event in events:
            match event:
                case socketcand.Received(block):
                    self._blocks.append(block)
                case socketcand.Command("error", (identifier, stamp)) if _is_error_frame(identifier, stamp):
                    self.error_frames += 1
                case socketcand.Command("error", words):
                    self.bad_lines += 1
                    _LOG.warning("the server of %s refused a line: %s", self._where, " ".join(words))
                case socketcand.Malformed(reason):
                    self.bad_lines += 1
                    _LOG.warning("%s", reason)
                case _:
                    _LOG.debug("%s: %s", self._where, event)

    def _lose(self, reason: str) -> str:
        """Store the reason for the loss of the server if it is the first one; return the first reason."""
        self._lost = self._lost or f"{self._where} is lost: {reason}"
        return self._lost

    def shutdown(self) -> None:
        """Leave the bus; a thread that waits in ``recv`` gets a can.CanOperationError."""
        super().shutdown()
        self._close()

    def _close(self) -> None:
        self._lose("this bus was closed")
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes the receiving thread, which close() would not
        self.wire.cut()
        self._socket.close()


def _is_error_frame(identifier: str, stamp: str) -> bool:
    """Return whether a line is an error frame, ``< error 20000004 1700000000.123456 >``, and not ``< error TEXT >``."""
    try:
        int(identifier, 16)
        float(stamp)
    except ValueError:
        return False
    return True
