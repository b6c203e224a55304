"""A SocketCAN interface as the rig's CAN door: frames out in bulk, frames in by a thread of its own."""

import contextlib
import socket
import struct
import threading
from collections.abc import Callable
from typing import Final

import numpy as np

from bench_protocol.frames import FRAME, STANDARD_ID_MAX, Block

#: The kernel's struct can_frame.
_WIRE: Final = np.dtype([("id", "<u4"), ("length", "u1"), ("pad", "u1", (3,)), ("data", "u1", (8,))])
_ERROR_FLAG: Final = 0x2000_0000
_REMOTE_FLAG: Final = 0x4000_0000
_EXTENDED_FLAG: Final = 0x8000_0000
_ID_MASK: Final = 0x1FFF_FFFF
_RECEIVE_BUFFER: Final = 1 << 22
_SO_RCVBUFFORCE: Final = 33
_POLL: Final = 0.2  # s, how long close() may wait for the reading thread


class SocketCan:
    """Opens ``interface`` and calls ``on_frames(block, interface)`` for what other nodes send.

    Raises OSError in words if the kernel has no such interface.
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
                f"CAN interface {interface} cannot be opened: {error.strerror}; `ip link` lists what there is"
            )
            raise OSError(error.errno, reason) from None
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
        self._socket.settimeout(_POLL)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name=f"rig on {interface}", daemon=True)
        self._thread.start()

    def publish(self, block: Block) -> None:
        """Send all frames of ``block``."""
        wire = np.zeros(block.size, _WIRE)
        wire["id"] = block["id"] | np.where(block["extended"], _EXTENDED_FLAG, 0).astype(np.uint32)
        wire["length"], wire["data"] = block["length"], block["data"]
        data, size = wire.tobytes(), _WIRE.itemsize
        for start in range(0, len(data), size):
            try:
                self._socket.send(data[start : start + size])
            except OSError:
                self.dropped += 1

    def close(self) -> None:
        """Close the interface and end the reading thread."""
        self._closing.set()
        self._thread.join()
        self._socket.close()

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                data = self._socket.recv(_WIRE.itemsize)
            except TimeoutError:
                continue
            except OSError:
                return  # the interface went away
            (identifier,) = struct.unpack_from("<I", data)
            if identifier & (_ERROR_FLAG | _REMOTE_FLAG):
                continue
            block = np.zeros(1, FRAME)
            extended = bool(identifier & _EXTENDED_FLAG)
            block["id"] = identifier & (_ID_MASK if extended else STANDARD_ID_MAX)
            block["extended"], block["length"] = extended, data[4]
            block["data"][0] = np.frombuffer(data, np.uint8, 8, 8)
            self._on_frames(block, self.interface)
