"""What a view is answered: a page that stands for itself, or JSON, computed in a thread."""

from collections.abc import Callable
from typing import Any, Final

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from bench_records.layout import RecordError

#: A page that was made of a record has its script and style inside, and needs nothing from anywhere.
ALONE: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "font-src data:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)


def answered(answer: Callable[[Request], object]) -> Callable[[Request], Any]:
    """Return the endpoint that answers in a thread: text is a page, anything else JSON."""

    async def endpoint(request: Request) -> Response:
        try:
            found = await run_in_threadpool(answer, request)
        except RecordError as error:
            return PlainTextResponse(f"{error}\n", 404)
        except (KeyError, ValueError) as error:
            return PlainTextResponse(f"this address asks for {error}\n", 400)
        if isinstance(found, str):
            return Response(found, media_type="text/html", headers={"Content-Security-Policy": ALONE})
        return Response(msgspec.json.encode(found), media_type="application/json")

    return endpoint
