"""A SocketCAN interface of the rig. The tick sends many frames at once, and a separate thread receives."""

import contextlib
import select
import socket
import threading
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import hurry
from bench_protocol.frames import FRAME, LENGTH_MAX, STANDARD_ID_MAX, Block

#: The kernel's struct can_frame.
_WIRE: Final = np.dtype([("id", "<u4"), ("length", "u1"), ("pad", "u1", (3,)), ("data", "u1", (8,))])
_ERROR_FLAG: Final = 0x2000_0000
_REMOTE_FLAG: Final = 0x4000_0000
_EXTENDED_FLAG: Final = 0x8000_0000
_ID_MASK: Final = 0x1FFF_FFFF
_RECEIVE_BUFFER: Final = 1 << 22
_SO_RCVBUFFORCE: Final = 33
_BATCH_MAX: Final = 1024
_PRIORITY: Final = 8  # below the tick, above all clients: commands are worth nothing unread
_POLL: Final = 0.2  # s, how long close() may wait for the reading thread


class SocketCan:
    """Opens ``interface``, and calls ``on_frames(block, interface)`` with the frames of other nodes.

    Raises OSError with an explanation if the kernel has no such interface.
    """

    def __init__(self, interface: str, on_frames: Callable[[Block, str], None]) -> None:
        self.interface = interface
        self._on_frames = on_frames
        #: Frames that the interface refused because its queue was full.
        self.dropped = 0
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
            self._socket.bind((interface,))
        except OSError as error:
            reason = (
                f"CAN interface {interface} cannot be opened: {error.strerror}; `ip link` lists the "
                "interfaces"
            )
            raise OSError(error.errno, reason) from None
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
        # The tick must not wait for a full queue either.
        self._socket.setblocking(False)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name=f"rig on {interface}", daemon=True)
        self._thread.start()

    def publish(self, block: Block) -> None:
        """Send all frames of ``block``. Frames that the interface refuses are counted in ``dropped``."""
        wire = np.zeros(block.size, _WIRE)
        wire["id"] = block["id"] | np.where(block["extended"], _EXTENDED_FLAG, 0).astype(np.uint32)
        wire["length"], wire["data"] = block["length"], block["data"]
        data, size = wire.tobytes(), _WIRE.itemsize
        for start in range(0, len(data), size):
            try:
                self._socket.send(data[start : start + size])
            except OSError:
                self.dropped += 1

    def relay(self, block: Block, peer: str) -> None:
        """Send frames of another node. Frames from the interface itself are not sent, because its nodes receive each
        other directly.
        """
        if peer != self.interface:
            self.publish(block)

    def close(self) -> None:
        """Close the interface and end the reading thread."""
        self._closing.set()
        self._thread.join()
        self._socket.close()

    def _read(self) -> None:
        hurry(_PRIORITY)
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        while not self._closing.is_set():
            if not poll.poll(1000 * _POLL):
                continue
            # Read all pending frames at once: commands must not wait behind a user's burst, frame by frame.
            frames: list[bytes] = []
            try:
                while len(frames) < _BATCH_MAX:
                    frames.append(self._socket.recv(_WIRE.itemsize))
            except BlockingIOError:
                pass
            except OSError:
                return  # the interface went away
            wire = np.frombuffer(b"".join(frames), _WIRE)
            wire = wire[wire["id"] & (_ERROR_FLAG | _REMOTE_FLAG) == 0]
            if wire.size:
                self._on_frames(_block(wire), self.interface)


def _block(wire: npt.NDArray[np.void]) -> Block:
    """Return the frames in ``wire`` as a frame block. Bytes after the length of a frame are zero."""
    block = np.zeros(wire.size, FRAME)
    extended = wire["id"] & _EXTENDED_FLAG != 0
    block["id"] = np.where(extended, wire["id"] & _ID_MASK, wire["id"] & STANDARD_ID_MAX)
    block["extended"], block["length"] = extended, np.minimum(wire["length"], LENGTH_MAX)
    block["data"] = np.where(np.arange(LENGTH_MAX) < block["length"][:, None], wire["data"], 0)
    return block
