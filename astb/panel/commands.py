"""Routes of commands: the required rights, the content of requests, and the answers to the page."""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
from anyio import CapacityLimiter, to_thread
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from astb.panel.access import NotAllowed
from astb.panel.answers import Parts
from astb.panel.runs import CannotDo

_BODY_MAX: Final = 64 * 1024
_DEPTH_MAX: Final = 8
_AT_ONCE: Final = 4  # of one command
_REASON_MAX: Final = 1000  # characters: a reason can repeat a long request

Command = Callable[[Request, dict[str, Any]], object]


def command(parts: Parts, path: str, do: Command, *, seat: bool = True) -> Route:
    """Return the route of a command. Only the page with the seat may use it; without ``seat``, any client with the
    token.

    ``do(request, body)`` runs in a thread. Its result, NotAllowed and CannotDo are sent to the page. Each command has
    its own limit of parallel requests, so that a stop never waits for other commands or views.
    """
    places = CapacityLimiter(_AT_ONCE)

    async def endpoint(request: Request) -> Response:
        try:
            await parts.access.slow_down(request)
            if seat:
                parts.access.require_seat(request)
            else:
                parts.access.require_token(request)
            body = await json_body(request)
            return json_answer({"done": await to_thread.run_sync(do, request, body, limiter=places)})
        except NotAllowed as error:
            return refusal(error, error.status)
        except CannotDo as error:
            return refusal(error, 409)

    return Route(path, endpoint, methods=["POST"])


async def json_body(request: Request) -> dict[str, Any]:
    """Return the JSON object in a request.

    Raises NotAllowed if it is too long, nested too deep, or not a JSON object.
    """
    body = await read_body(request, _BODY_MAX, f"the request has more than {_BODY_MAX} bytes; shorten it")
    try:
        content = msgspec.json.decode(body or b"{}", type=dict[str, Any])
    except (msgspec.MsgspecError, UnicodeError) as error:
        raise NotAllowed(f"the request is not valid JSON: {error}; correct it", 400) from None
    except RecursionError:
        raise NotAllowed(f"the request is nested too deep; use at most {_DEPTH_MAX} levels", 400) from None
    if _depth(content) > _DEPTH_MAX:
        raise NotAllowed(f"the request is nested too deep; use at most {_DEPTH_MAX} levels", 400)
    return content


async def read_body(request: Request, most: int, too_much: str) -> bytes:
    """Return the body of a request.

    Raises NotAllowed once it exceeds ``most`` bytes, because its length may be unknown.
    """
    body = bytearray()
    try:
        async for part in request.stream():
            body += part
            if len(body) > most:
                raise NotAllowed(too_much, 413)
    except ClientDisconnect:
        raise NotAllowed("the connection ended before the request was complete; send it again", 400) from None
    return bytes(body)


def _depth(value: object) -> int:
    """Return the depth of nested tables and lists. Counting ends at one above the limit."""
    layer, depth = [value], 0
    while layer and depth <= _DEPTH_MAX:
        inner = [one for one in layer if isinstance(one, dict | list)]
        layer = [one for each in inner for one in (each.values() if isinstance(each, dict) else each)]
        depth += bool(inner)
        if not inner:
            break
    return depth


def text_of(body: Mapping[str, Any], key: str) -> str:
    """Return a text of a request, "" if it is missing. Raises NotAllowed if it is not a text, or not valid UTF-8."""
    value = body.get(key, "")
    if not isinstance(value, str):
        raise NotAllowed(f"{key} = {value!r} is not a text; send a text", 400)
    try:
        value.encode()
    except UnicodeEncodeError:
        raise NotAllowed(f"{key} is not a valid UTF-8 text; enter it again", 400) from None
    return value


def settings_of(body: Mapping[str, Any]) -> dict[str, str]:
    """Return the parameters of a plan in a request, as text. Raises NotAllowed if they are not a table of values."""
    settings = body.get("set", {})
    if not isinstance(settings, dict):
        raise NotAllowed(f"set = {settings!r} is not a table; send the parameters by their names", 400)
    return {text_of({"a name": name}, "a name"): _written(name, value) for name, value in settings.items()}


def _written(name: str, value: object) -> str:
    """Return the value of a parameter as text. Raises NotAllowed for a table or a list."""
    if isinstance(value, dict | list):
        raise NotAllowed(f"{name} = {value!r} is a table or a list; send a text or a number", 400)
    return text_of({name: str(value)}, name)


def refusal(error: Exception, status: int) -> Response:
    """Return the answer for a refused request; a long reason is cut."""
    reason = str(error)
    return json_answer(
        {"error": reason if len(reason) <= _REASON_MAX else f"{reason[:_REASON_MAX]}…"}, status
    )


def json_answer(content: object, status: int = 200) -> Response:
    """Return ``content`` as JSON."""
    return Response(msgspec.json.encode(content), status, media_type="application/json")
