"""Sending to a socket from compiled code, which waits for room for a bounded time."""

from typing import Any, Final

from bench_protocol.runtime.binding import inlined
from bench_protocol.runtime.calls import ADDRESS, INT, external, now, sleep_until
from bench_protocol.units import NS, ms

#: Longest wait for space in the send buffer, ns.
_PATIENCE: Final = round(200 * ms * NS)
_NAP: Final = round(1 * ms * NS)

# sys/socket.h, poll.h, errno.h of Linux.
_QUIETLY: Final = 0x4000 | 0x40  # MSG_NOSIGNAL | MSG_DONTWAIT
_POLLOUT: Final = 4
_EBADF, _EAGAIN, _EINTR, _ENOBUFS, _ETIMEDOUT = 9, 11, 4, 105, 110

_send: Final = external("send", ADDRESS, INT, ADDRESS, ADDRESS, INT)
_poll: Final = external("poll", INT, ADDRESS, ADDRESS, INT)
_errno_location: Final = external("__errno_location", ADDRESS)
_copy: Final = external("memcpy", ADDRESS, ADDRESS, ADDRESS, ADDRESS)


@inlined
def send_all(descriptor: int, address: int, size: int, work: Any) -> int:
    """Send ``size`` bytes from ``address``, and wait up to `_PATIENCE` for space in the send buffer. Return 0 or an
    errno. ``work`` is working memory.
    """
    if descriptor < 0:
        return _EBADF
    deadline = now(work) + _PATIENCE
    while size > 0:
        sent = _send(descriptor, address, size, _QUIETLY)
        if sent >= 0:
            address += sent
            size -= sent
            continue
        work[0] = 0
        _copy(work.ctypes.data, _errno_location(), 4)
        error = work[0]
        if error not in (_EAGAIN, _EINTR, _ENOBUFS):
            return error
        instant = now(work)
        if instant > deadline:
            return _ETIMEDOUT
        if error == _ENOBUFS:  # the queue of an interface is full, which poll() does not report
            sleep_until(instant + _NAP, work)
        elif error == _EAGAIN:
            work[0] = descriptor | _POLLOUT << 32
            _poll(work.ctypes.data, 1, 10)
    return 0
