"""A CAN port: it sends blocks of frames to a bus and delivers every received frame.

``PythonCanPort`` works on any python-can bus. It has a thread that only receives frames, because a CAN socket of the
kernel stores only about 280 of them while the program computes. ``open_can`` selects the bus.
"""

import contextlib
import select
import socket
import struct
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol

import can
import numpy as np

from bench_protocol.clock import hurry, wall_time_ns
from bench_protocol.frames import (
    EXTENDED_ID_MAX,
    FRAME,
    STANDARD_ID_MAX,
    Block,
    empty_block,
    payload,
)
from bench_protocol.socketcand import iterate
from drivers.can_fd import FD_FRAME, Fd
from drivers.errors import LinkLost
from drivers.hub_bus import HubBus
from drivers.stamps import (
    HARDWARE_STAMPS,
    SO_TIMESTAMPING,
    SO_TIMESTAMPNS,
    TIMESTAMPING,
    Clock,
    StampClock,
    of_notes,
)
from drivers.wire import Wire

OnFrames = Callable[[Block], None]
OnLost = Callable[[str], None]

_PRIORITY: Final = 4  # of the receiver: below the command stream, above everything that computes
#: The interface that `auto` uses; a real bus must be named explicitly.
VIRTUAL_INTERFACE: Final = "vcan0"
HUB_HOST: Final = "127.0.0.1"
HUB_PORT: Final = 29536

_ARPHRD_CAN: Final = "280"
_POLL: Final = 0.05  # s, longest wait of a receiver before it checks for its end
_SEND_TIMEOUT: Final = 0.2  # s, for a full transmit queue
_RECEIVE_BUFFER: Final = 16 << 20  # bytes; the kernel counts about 800 for a frame, so 20 000 frames fit
_BATCH_MAX: Final = 4096

#: Folder in which the kernel lists its interfaces.
_INTERFACES: Final = Path("/sys/class/net")

# linux/socket.h, linux/can.h: numbers Python's socket module does not name.
_SO_RCVBUFFORCE: Final = 33
_SO_RXQ_OVFL: Final = 40
_CAN_EFF_FLAG: Final = 0x8000_0000
_CAN_RTR_FLAG: Final = 0x4000_0000
_CAN_ERR_FLAG: Final = 0x2000_0000
_CAN_FRAME: Final = struct.Struct("=IB3x8s")
_CANFD_FRAME: Final = struct.Struct("=IBB2x64s")
_RECORD: Final = struct.Struct("<qIBB8s")


class CanPort(Protocol):
    """Interface of a CAN bus for the drivers."""

    @property
    def wire(self) -> Wire | None:
        """Socket to which compiled code may write frames; None if only ``send`` works."""

    @property
    def local_ports(self) -> set[int]:
        """The local TCP ports from which frames are sent, if any."""

    def send(self, block: Block) -> None:
        """Send the frames in order. Raises LinkLost if the bus is lost."""

    def subscribe(self, callback: OnFrames) -> None:
        """Call ``callback(block)`` with all frames received from now on, in order, in the receiver's thread."""

    def on_lost(self, callback: OnLost) -> None:
        """Call ``callback(reason)`` once when the bus is lost; at once if it is lost already."""

    def close(self) -> None:
        """Leave the bus. No callback follows after this returns. Repeated calls are harmless."""


class _Receiver(Protocol):
    """Receives frames from one kind of bus."""

    #: Frames that the operating system discarded because its buffer was full.
    overflows: int
    wire: Wire | None
    stamped_by: Clock

    def receive(self, timeout: float) -> Block:
        """Return received frames, waiting at most ``timeout`` s for the first. Raises an error when the bus is lost."""

    def send(self, block: Block) -> None: ...


class _HubReceiver:
    """Receiver for a ``HubBus``, which delivers whole blocks."""

    overflows = 0
    stamped_by: Clock = "system"

    def __init__(self, bus: HubBus) -> None:
        self.wire: Wire | None = bus.wire
        self.receive: Callable[[float], Block] = bus.recv_block
        self.send: Callable[[Block], None] = bus.send_block


class _MessageReceiver:
    """Receiver for any other python-can bus. It reads one message at a time; with ``fd`` also CAN FD frames."""

    overflows = 0
    wire: Wire | None = None

    def __init__(self, bus: can.BusABC, fd: Fd | None = None, stamped_by: Clock = "system") -> None:
        self._bus, self._fd, self.stamped_by = bus, fd, stamped_by
        self._hardware = StampClock(drifts=True) if stamped_by == "hardware" else None

    def receive(self, timeout: float) -> Block:
        messages: list[can.Message] = []
        message = self._bus.recv(timeout)
        while message is not None:
            readable = self._fd is not None or not message.is_fd
            if message.is_rx and readable and not (message.is_error_frame or message.is_remote_frame):
                messages.append(message)
            if len(messages) >= _BATCH_MAX:
                break
            message = self._bus.recv(0)
        block = np.zeros(len(messages), FRAME if self._fd is None else FD_FRAME)
        for record, each in zip(block, messages, strict=True):
            stamp = round(each.timestamp * 1e9)
            record["time"] = self._hardware.time(stamp, wall_time_ns()) if self._hardware else stamp
            record["id"], record["extended"] = each.arbitration_id, each.is_extended_id
            record["length"] = len(each.data)
            record["data"][: len(each.data)] = np.frombuffer(bytes(each.data), np.uint8)
            if self._fd is not None:
                record["fd"] = each.is_fd
        return block

    def send(self, block: Block) -> None:
        _send_messages(self._bus, block, self._fd)


def _send_messages(bus: can.BusABC, block: Block, fd: Fd | None) -> None:
    if fd is None:
        for _, identifier, extended, data in iterate(block):
            message = can.Message(arbitration_id=identifier, is_extended_id=extended, data=data)
            bus.send(message, _SEND_TIMEOUT)
        return
    for record in block:
        fast = bool(record["fd"])
        message = can.Message(
            arbitration_id=int(record["id"]),
            is_extended_id=bool(record["extended"]),
            data=payload(record),
            is_fd=fast,
            bitrate_switch=fast and fd.bitrate_switch,
        )
        bus.send(message, _SEND_TIMEOUT)


class _SocketCanReceiver:
    """Receiver that reads a SocketCAN socket directly, with one system call per frame.

    Frames get the best available time stamp. Frames that the kernel discarded are counted in ``overflows``.
    """

    def __init__(self, bus: can.BusABC, sock: socket.socket, fd: Fd | None, *, hardware: bool) -> None:
        self.overflows = 0
        self.wire: Wire | None = Wire.on(sock.fileno(), lines=False) if fd is None else None
        self.stamped_by: Clock = "system"
        self._bus, self._socket, self._fd = bus, sock, fd
        self._hardware = StampClock(drifts=True)
        _enlarge(sock)
        # From now on every frame carries the kernel's count of frames discarded for lack of room.
        sock.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        if (
            hardware
        ):  # other interfaces have no such stamps, and each of their frames would cost twice as much
            with contextlib.suppress(OSError):  # a kernel without hardware stamps uses its own
                sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, TIMESTAMPING)
        self._poll = select.poll()
        self._poll.register(sock, select.POLLIN)

    def receive(self, timeout: float) -> Block:
        if not self._poll.poll(1000 * timeout):
            return empty_block()
        frames: list[tuple[int, int, bool, bool, bytes]] = []
        while len(frames) < _BATCH_MAX:
            try:
                raw, notes, flags, _ = self._socket.recvmsg(_CANFD_FRAME.size, 256, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            time = self._time(notes)
            # MSG_CONFIRM marks this socket's own frames, which a bus with an echo sends back.
            if not flags & socket.MSG_CONFIRM and (found := _unpacked(raw)):
                frames.append((time, *found))
        if self._fd is None:
            records = [_RECORD.pack(*one[:3], len(one[4]), one[4]) for one in frames if not one[3]]
            return np.frombuffer(bytearray(b"".join(records)), FRAME)
        block = np.zeros(len(frames), FD_FRAME)
        for record, (time, identifier, extended, fast, data) in zip(block, frames, strict=True):
            record["time"], record["id"], record["extended"] = time, identifier, extended
            record["length"], record["fd"] = len(data), fast
            record["data"][: len(data)] = np.frombuffer(data, np.uint8)
        return block

    def _time(self, notes: list[tuple[int, int, bytes]]) -> int:
        """Return the receive time (ns) of a frame by the best clock in its ancillary data; store the count of lost
        frames.
        """
        for _, kind, note in notes:
            if kind == _SO_RXQ_OVFL:
                self.overflows = int.from_bytes(note[:4], "little" if _LITTLE else "big")
        system, hardware = of_notes(notes)
        system = system or wall_time_ns()
        if not hardware:
            return system
        self.stamped_by = "hardware"
        return self._hardware.time(hardware, system)

    def send(self, block: Block) -> None:
        _send_messages(self._bus, block, self._fd)


def _unpacked(raw: bytes) -> tuple[int, bool, bool, bytes] | None:
    """Return identifier, extended flag, CAN FD flag and data of a frame; None if it is not a data frame."""
    fast = len(raw) == _CANFD_FRAME.size
    if fast:
        word, length, _, data = _CANFD_FRAME.unpack(raw)
    elif len(raw) == _CAN_FRAME.size:
        word, length, data = _CAN_FRAME.unpack(raw)
    else:
        return None
    if word & (_CAN_RTR_FLAG | _CAN_ERR_FLAG):
        return None
    extended = bool(word & _CAN_EFF_FLAG)
    identifier = word & (EXTENDED_ID_MAX if extended else STANDARD_ID_MAX)
    return identifier, extended, fast, data[: min(length, len(data))]


_LITTLE: Final = struct.pack("=H", 1) == b"\1\0"


class PythonCanPort:
    """A ``CanPort`` on any python-can bus, which it shuts down when it is closed.

    An exception of a subscriber would be unnoticed in a background thread. The port therefore counts as lost, with
    the exception as the reason.
    """

    def __init__(self, bus: can.BusABC, *, fd: Fd | None = None, stamped_by: Clock = "system") -> None:
        self._bus = bus
        self._receiver = _receiver(bus, fd, stamped_by)
        self._subscribers: tuple[OnFrames, ...] = ()
        self._lost_callbacks: list[OnLost] = []
        self._lost = ""
        self._closing = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"receiver of {bus.channel_info}", daemon=True)
        self._thread.start()

    @property
    def local_ports(self) -> set[int]:
        """The local TCP port from which frames are sent, if any."""
        return {self._bus.local_port} if isinstance(self._bus, HubBus) else set()

    @property
    def description(self) -> str:
        """The name of the bus for messages."""
        return str(self._bus.channel_info)

    @property
    def overflows(self) -> int:
        """Frames that the kernel discarded since the port was opened; 0 on buses that do not report it."""
        return self._receiver.overflows

    @property
    def stamped_by(self) -> Clock:
        """The clock that stamps received frames: that of the interface or of the system."""
        return self._receiver.stamped_by

    @property
    def wire(self) -> Wire | None:
        """Socket to which compiled code may write frames; None if only ``send`` works."""
        return self._receiver.wire

    def send(self, block: Block) -> None:
        """Send the frames in order. Raises LinkLost if the bus is lost."""
        if self._lost:
            raise LinkLost(self._lost)
        try:
            self._receiver.send(block)
        except (can.CanError, OSError) as error:
            raise LinkLost(f"CAN frames could not be sent: {error}; check the adapter and the bus") from error

    def subscribe(self, callback: OnFrames) -> None:
        """Call ``callback(block)`` with all frames received from now on, in order, in the receiver's thread."""
        with self._lock:
            self._subscribers += (callback,)

    def on_lost(self, callback: OnLost) -> None:
        """Call ``callback(reason)`` once when the bus is lost; at once if it is lost already."""
        with self._lock:
            if not self._lost:
                self._lost_callbacks.append(callback)
                return
        callback(self._lost)

    def close(self) -> None:
        """Leave the bus. No callback follows after this returns. Repeated calls are harmless."""
        self._closing = True
        if isinstance(self._bus, HubBus):
            self._bus.shutdown()  # which wakes the receiver; other buses are shut down only when no thread reads
        if threading.current_thread() is not self._thread:
            self._thread.join()
        if self.wire is not None:
            self.wire.cut()
        self._bus.shutdown()
        self._lost = self._lost or f"{self.description} was closed"

    def _run(self) -> None:
        hurry(_PRIORITY)
        try:
            while not self._closing:
                block = self._receiver.receive(_POLL)
                if len(block):
                    for callback in self._subscribers:
                        callback(block)
        except (can.CanError, OSError) as error:
            self._report(str(error))
        except Exception as error:
            self._report(f"a subscriber of {self.description} failed: {type(error).__name__}: {error}")

    def _report(self, reason: str) -> None:
        if self._closing:
            return
        with self._lock:
            self._lost = reason
            callbacks, self._lost_callbacks = self._lost_callbacks, []
        for callback in callbacks:
            callback(reason)


def open_can(
    spec: str = "auto", *, host: str = HUB_HOST, port: int = HUB_PORT, fd: Fd | None = None
) -> PythonCanPort:
    """Open the bus ``spec``: ``auto``, ``tcp``, or a SocketCAN interface such as ``vcan0`` or ``can0``.

    ``auto`` is SocketCAN's vcan0 if the kernel has it, else the hub; ``tcp`` is the hub at ``host``:``port``. ``fd``:
    with CAN FD. Raises LinkLost, with the reason, if the bus cannot be opened.
    """
    kind = resolve_can(spec)
    try:
        if kind == "tcp" and fd is not None:
            raise LinkLost(
                f"can = {spec!r}: a socketcand server does not support CAN FD; use an interface such as can0"
            )
        if kind == "tcp":
            return PythonCanPort(HubBus(VIRTUAL_INTERFACE, host, port))
        if not has_interface(kind):
            raise LinkLost(
                f"can = {spec!r} is not a CAN interface of this machine; use one of "
                f"{', '.join((*can_interfaces(), 'tcp'))} (tcp: the CAN server of a simulated rig)"
            )
        # Error frames are not used here. The filter costs nothing.
        bus = can.Bus(
            channel=kind,
            interface="socketcan",
            fd=fd is not None,
            ignore_rx_error_frames=True,
            ignore_config=True,
        )
        return PythonCanPort(bus, fd=fd)
    except (can.CanError, OSError) as error:
        raise LinkLost(
            f"the CAN bus '{spec}' cannot be opened: {error}; check that the rig runs; `ip link` lists the interfaces"
        ) from error


def open_bus(
    interface: str, channel: str | None, options: Mapping[str, Any], *, fd: Fd | None = None
) -> PythonCanPort:
    """Open any bus that python-can supports (its ``interface``, ``channel`` and ``options``), with CAN FD if ``fd`` is
    given. Raises LinkLost with the reason on failure.
    """
    whole = {"fd": True, **options} if fd is not None else options
    stamped_by: Clock = "hardware" if interface in HARDWARE_STAMPS else "system"
    try:
        bus = can.Bus(channel=channel, interface=interface, ignore_config=True, **whole)
        return PythonCanPort(bus, fd=fd, stamped_by=stamped_by)
    except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
        raise LinkLost(
            f"the CAN bus {channel!r} of {interface!r} cannot be opened: {error}; check channel, driver and options"
        ) from error


def resolve_can(spec: str) -> str:
    """Return the meaning of ``spec`` on this machine: ``tcp`` or the name of a SocketCAN interface."""
    if spec == "auto":
        return VIRTUAL_INTERFACE if has_interface(VIRTUAL_INTERFACE) else "tcp"
    return spec


def has_interface(name: str) -> bool:
    """Return whether the kernel has a CAN interface ``name`` that is up."""
    return name in can_interfaces()


def _is_hardware(interface: str) -> bool:
    return (_INTERFACES / interface / "device").exists()


def can_interfaces() -> list[str]:
    """Return the names of the CAN interfaces that are up, sorted."""
    found = []
    for kind in _INTERFACES.glob("*/type"):
        with contextlib.suppress(OSError, ValueError):
            up = int((kind.parent / "flags").read_text(encoding="ascii"), 16) & 1
            if up and kind.read_text(encoding="ascii").strip() == _ARPHRD_CAN:
                found.append(kind.parent.name)
    return sorted(found)


def _receiver(bus: can.BusABC, fd: Fd | None, stamped_by: Clock) -> _Receiver:
    if isinstance(bus, HubBus):
        return _HubReceiver(bus)
    sock = getattr(bus, "socket", None)
    if isinstance(sock, socket.socket) and sock.family == getattr(socket, "AF_CAN", None):
        return _SocketCanReceiver(bus, sock, fd, hardware=_is_hardware(sock.getsockname()[0]))
    return _MessageReceiver(bus, fd, stamped_by)


def _enlarge(sock: socket.socket) -> None:
    """Enlarge the receive buffer to about 20 000 frames, or to the limit for an ordinary user."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
    except OSError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
