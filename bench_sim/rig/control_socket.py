"""The control socket of a running rig: a Unix domain socket for the user who runs it. Each line gets a line as
answer.

It is for actions that a real bench does not have, such as simulated faults. Its path follows from the address of the
Modbus server, so programs can find it with the rig file. Only this user can access the directory.
"""

import asyncio
import errno
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

from bench_protocol.os_errors import reason
from bench_protocol.runtime.own_folder import own_directory, own_folder, require_own

#: Bytes of a line, and clients at once.
LINE_MAX: Final = 8192
_CLIENTS_MAX: Final = 8
#: Time (s) without a request after which a client is disconnected.
_IDLE_LIMIT: Final = 60.0
_TOO_LONG: Final = b'{"error":"a line has at most 8192 bytes"}\n'


def control_path(host: str, modbus_port: int) -> Path:
    """Return the path of the control socket of the rig whose Modbus server has this address."""
    return own_folder() / f"{host.replace(':', '_')}-{modbus_port}.sock"


def ask(path: Path, line: bytes, timeout: float = 5.0) -> bytes:
    """Send one line to the rig and return its answer. Raises OSError if there is no rig, or no answer within
    ``timeout`` s.

    Raises PermissionError, before anything is sent, if the directory belongs to another user, because the answer could
    be forged.
    """
    require_own(path.parent)
    with _unix_socket() as connection:
        connection.settimeout(timeout)
        connection.connect(str(path))
        connection.sendall(line + b"\n")
        answer = b""
        while not answer.endswith(b"\n"):
            part = connection.recv(1 << 16)
            if not part:
                raise ConnectionResetError(
                    "the rig closed its control socket; check whether the rig still runs"
                )
            answer += part
        return answer


class ControlSocket:
    """Answers each line with ``answer(line)``, in the thread of the servers. `close` removes the socket."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.answer = answer
        self.clients: set[_ControlClient] = set()
        self._server: asyncio.AbstractServer | None = None
        self._path: Path | None = None

    async def open(self, host: str, modbus_port: int) -> Path:
        """Open the socket for this user alone, and return its path. Raises OSError with an explanation."""
        path = control_path(host, modbus_port)
        try:
            own_directory(path.parent)
            if is_alive(path):
                raise OSError(errno.EADDRINUSE, "another rig uses it")
            loop = asyncio.get_running_loop()
            self._server = await loop.create_unix_server(lambda: _ControlClient(self), str(path))
        except OSError as error:
            text = f"control socket {path} cannot be opened: {reason(error)}"
            raise OSError(error.errno, text) from None
        path.chmod(0o600)
        self._path = path
        return path

    def close(self) -> None:
        """Close the socket and all connections."""
        if self._server is not None:
            self._server.close()
        for client in list(self.clients):
            client.drop()
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def admits(self) -> bool:
        """Return whether one more client is accepted."""
        return len(self.clients) < _CLIENTS_MAX


class _ControlClient(asyncio.Protocol):
    """One connection to the control socket."""

    def __init__(self, control: ControlSocket) -> None:
        self._control = control
        self._rest = b""
        self._transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if not self._control.admits():
            self.drop()
            return
        self._control.clients.add(self)
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        if self._timer:
            self._timer.cancel()
        self._control.clients.discard(self)

    def data_received(self, data: bytes) -> None:
        assert self._transport is not None
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._transport.write(_TOO_LONG if len(line) > LINE_MAX else self._control.answer(line))
        if len(self._rest) > LINE_MAX:
            self._transport.write(_TOO_LONG)
            self._transport.close()
        self._expect()

    def pause_writing(self) -> None:
        self.drop()  # a client that does not read the answers gets no more of them

    def drop(self) -> None:
        """End the connection."""
        if self._transport is not None:
            self._transport.abort()

    def _expect(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(_IDLE_LIMIT, self.drop)


def _unix_socket() -> socket.socket:
    """Return a new socket. Raises OSError if the system has no Unix sockets."""
    if (family := getattr(socket, "AF_UNIX", None)) is None:
        raise OSError("this system has no Unix domain sockets; use Linux")
    return socket.socket(family)


def is_alive(path: Path) -> bool:
    """Return whether a process listens at ``path``. The socket file of a killed rig remains, but nothing listens
    there.
    """
    try:
        with _unix_socket() as probe:
            probe.settimeout(0.5)
            probe.connect(str(path))
    except OSError:
        return False
    return True
