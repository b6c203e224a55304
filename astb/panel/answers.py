"""Answers to requests of views: a page, or JSON, computed in a thread."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
from anyio import CapacityLimiter, to_thread
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from astb.panel.access import Access
from astb.panel.runs import Runs
from astb.panel.watch import Watch
from bench_records.layout import RecordError

#: Policy for a page made from a record: script and style are in the page, and it loads nothing else.
ALONE: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "font-src data:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)


class Threads:
    """Threads that compute views: a few for clients with the token, fewer for all others."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._known, self._others = CapacityLimiter(8), CapacityLimiter(2)

    def of(self, request: Request) -> CapacityLimiter:
        """Return the limiter of threads for the client of ``request``."""
        return self._known if self._access.may_command(request) else self._others


def answered(answer: Callable[[Request], object]) -> Callable[[Request], Any]:
    """Return an endpoint that computes its answer in a thread. A text is sent as a page, any other answer as JSON."""

    async def endpoint(request: Request) -> Response:
        try:
            limiter = request.app.state.threads.of(request)
            found = await to_thread.run_sync(answer, request, limiter=limiter)
        except RecordError as error:
            return PlainTextResponse(f"{error}\n", 404)
        except KeyError as error:
            return PlainTextResponse(f"this address needs the parameter {error}; add it\n", 400)
        except ValueError as error:
            return PlainTextResponse(f"a parameter of this address is wrong: {error}; correct it\n", 400)
        if isinstance(found, str):
            return Response(found, media_type="text/html", headers={"Content-Security-Policy": ALONE})
        return Response(msgspec.json.encode(found), media_type="application/json")

    return endpoint


@dataclass(frozen=True, slots=True)
class Parts:
    """The common parts of all routes: the watched rig, its runs, the access rights, the folder of records."""

    watch: Watch
    runs: Runs
    access: Access
    out: Path
