"""Routes that change something: who may give an order, what it says, and what the page is answered."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from astb.panel.access import NotAllowed
from astb.panel.parts import Parts
from astb.panel.runs import CannotDo

_BODY_MAX: Final = 64 * 1024

Command = Callable[[Request, dict[str, Any]], object]


def command(parts: Parts, path: str, do: Command, *, seat: bool = True) -> Route:
    """Return the route of a command, which only the page that commands may give; without ``seat`` any with the token.

    ``do(request, body)`` runs in a thread; what it returns goes to the page. NotAllowed and CannotDo are told there.
    """

    async def endpoint(request: Request) -> Response:
        try:
            if seat:
                parts.access.require_seat(request)
            else:
                parts.access.require_token(request)
            body = await json_body(request)
            return json_answer({"done": await asyncio.to_thread(do, request, body)})
        except NotAllowed as error:
            return json_answer({"error": str(error)}, error.status)
        except CannotDo as error:
            return json_answer({"error": str(error)}, 409)

    return Route(path, endpoint, methods=["POST"])


async def json_body(request: Request) -> dict[str, Any]:
    """Return what a request says. NotAllowed if it is too much, or no JSON object."""
    if int(request.headers.get("content-length") or 0) > _BODY_MAX:
        raise NotAllowed("too much to read", 413)
    try:
        return msgspec.json.decode(await request.body() or b"{}", type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise NotAllowed(f"not understood: {error}", 400) from None


def json_answer(content: object, status: int = 200) -> Response:
    """Return ``content`` as JSON."""
    return Response(msgspec.json.encode(content), status, media_type="application/json")
