"""Access rights of the panel: every client may watch; with the token, one page at a time may command.

The token is printed on the terminal as part of an address; the page exchanges it for a cookie that scripts cannot read.
Requests with an unknown host name (DNS rebinding) and requests from pages of other origins are refused.
"""

import ipaddress
import secrets
import socket
from collections.abc import Collection
from contextlib import suppress
from hmac import compare_digest
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Final

from anyio import sleep
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from astb.live.door import door_path
from bench_protocol.clock import Clock
from bench_protocol.runtime.own_folder import own_directory
from bench_protocol.units import NS, s

#: A page that commands and sends nothing for this time (a reload, a lost network) loses its seat.
SEAT_KEPT: Final = 10 * s
_COOKIE_AGE: Final = 30 * 24 * 3600
#: For one client and for all: seconds for each try, and number of free tries.
_EACH: Final = (1.0, 5)
_ALL: Final = (0.1, 20)
_LONGEST: Final = 4 * s
_CLIENTS_MAX: Final = 1024


class NotAllowed(Exception):
    """A forbidden action of a page; the text states why, and ``status`` is the HTTP status."""

    def __init__(self, text: str, status: int = 403) -> None:
        super().__init__(text)
        self.status = status


class Doorkeeper:
    """An ASGI middleware that passes only requests to this machine, by one of its names or an IP address.

    Requests for changes, and WebSockets, from pages of other servers are refused.
    """

    def __init__(self, app: ASGIApp, host: str, names: Collection[str] = ()) -> None:
        self._app = app
        self._names = {"localhost", host.lower(), socket.gethostname().lower(), *map(str.lower, names)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in {"http", "websocket"} and (wrong := self._wrong(scope)):
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": wrong})
            else:
                await PlainTextResponse(wrong + "\n", 403)(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _wrong(self, scope: Scope) -> str:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        name = name.strip("[]").lower()
        if name not in self._names and not _is_address(name):
            return (
                f"the panel is not known by the name {name}; start the panel with `astb panel --name {name}`"
            )
        changes = scope["type"] == "websocket" or scope["method"] not in {"GET", "HEAD"}
        origin = headers.get("origin")
        if changes and origin is not None and origin.partition("://")[2] != host:
            return "this request comes from a page of another server; open the page of the panel"
        return ""


def _is_address(name: str) -> bool:
    """Return whether the name is an IP address, so that no DNS server can redirect it."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def kept_token(rig_file: Path) -> str:
    """Return the token for the panel of this rig; it stays the same after a restart of the server.

    It is stored where only this user can read it, next to the sockets of rigs and runs.
    """
    path = door_path(rig_file).with_suffix(".token")
    own_directory(path.parent)
    with suppress(FileNotFoundError):
        if kept := path.read_text(encoding="ascii").strip():
            return kept
    # The file gets its name when it is complete, because anyone could guess an empty token.
    with NamedTemporaryFile("w", encoding="ascii", dir=path.parent, delete=False) as file:
        file.write(token := secrets.token_urlsafe(24))
    Path(file.name).replace(path)
    return token


def _client(connection: HTTPConnection) -> str:
    return connection.client.host if connection.client else "?"


class Patience:
    """Waiting times of clients that try a token, for each client and for all together, so that nobody can try many
    tokens.

    A few tries are free, then one is allowed in each period (the generic cell rate algorithm, ITU-T I.371). A try that
    would wait longer than 4 s is refused and does not count, so no client ever waits longer.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due: dict[
            str, int
        ] = {}  # when the next try of a client would be in time, in ns; "" stands for all

    def wait(self, client: str) -> float:
        """Return the waiting time (s) of this try of ``client``.

        Raises NotAllowed, with status 429, if it is too long.
        """
        now = self._clock.now()
        if len(self._due) >= _CLIENTS_MAX:
            self._due = {name: due for name, due in self._due.items() if due > now}
        names = ((client, _EACH), ("", _ALL)) if len(self._due) < _CLIENTS_MAX else (("", _ALL),)
        due = {name: max(self._due.get(name, now), now) + round(period * NS) for name, (period, _) in names}
        wait = max((due[name] - now) / NS - period * free for name, (period, free) in names)
        if wait > _LONGEST:
            raise NotAllowed(f"too many attempts with a wrong token; try again in {_LONGEST:g} s", 429)
        self._due |= due
        return max(wait, 0.0)

    def forgive(self, client: str) -> None:
        """Delete the tries of a client that has shown the right token. In the common count of all clients, only one try
        is deleted.
        """
        self._due.pop(client, None)
        self._due[""] = self._due.get("", 0) - round(_ALL[0] * NS)


class Access:
    """The token, and the seat: the right to command, which one page at a time has."""

    def __init__(self, token: str, port: int, clock: Clock) -> None:
        if not token:
            raise ValueError("the panel has no token, so anyone could command the rig; give a token")
        self.token, self.cookie = token, f"astb-panel-{port}"
        self._clock = clock
        self._patience = Patience(clock)
        self._page = ""  # which has the seat
        self._last_seen = 0

    def may_command(self, connection: HTTPConnection) -> bool:
        """Return whether the client has shown the token."""
        return compare_digest(connection.cookies.get(self.cookie, "").encode(), self.token.encode())

    def enter(self, token: str) -> dict[str, object]:
        """Return the arguments of the cookie for a client with the right token. Raises NotAllowed for a wrong token."""
        if not compare_digest(token.encode(), self.token.encode()):
            raise NotAllowed("wrong token; the terminal of the panel shows the address with the right token")
        return {
            "key": self.cookie,
            "value": self.token,
            "max_age": _COOKIE_AGE,
            "httponly": True,
            "samesite": "strict",
        }

    async def wait(self, connection: HTTPConnection) -> None:
        """Delay a client that tries a token. Raises NotAllowed after too many tries."""
        if seconds := self._patience.wait(_client(connection)):
            await sleep(seconds)

    async def slow_down(self, connection: HTTPConnection) -> None:
        """Delay a client whose cookie has a wrong token.

        With the right token nobody waits, so that an emergency stop is immediate.
        """
        if connection.cookies.get(self.cookie) and not self.may_command(connection):
            await self.wait(connection)

    def known(self, connection: HTTPConnection) -> None:
        """Record that a client has shown the right token."""
        self._patience.forgive(_client(connection))

    @property
    def taken(self) -> bool:
        """Whether a page has the seat."""
        return bool(self._page) and self._clock.now() - self._last_seen < SEAT_KEPT * NS

    def has_seat(self, page: str) -> bool:
        """Whether this page is the one that commands."""
        return self.taken and page == self._page

    def take_seat(self, page: str, *, from_other: bool = False) -> bool:
        """Give the seat to a page if the seat is free or if the page has it already; with ``from_other`` in any case.
        Return whether the page has the seat. A page without a name gets none.
        """
        if page and (from_other or not self.taken or page == self._page):
            self._page, self._last_seen = page, self._clock.now()
            return True
        return False

    def keep_seat(self, page: str) -> None:
        """Record that a page is still open. It keeps its seat, or gets the seat if this is free."""
        self.take_seat(page)

    def require_token(self, connection: HTTPConnection) -> None:
        """Raise NotAllowed for a client without the token."""
        if not self.may_command(connection):
            raise NotAllowed(
                "this page can only watch; to command, open the address `to command` of the terminal"
            )

    def require_seat(self, connection: HTTPConnection) -> None:
        """Raise NotAllowed for a client without the token, or if another page has the seat (the right to command).

        A free seat goes to this page.
        """
        self.require_token(connection)
        page = connection.headers.get("x-astb-page", "")
        if not self.take_seat(page):
            raise NotAllowed("another page commands the rig; take over first", 409)
