"""The server of the panel: its page, the data that the page requests once, its commands, and its stream."""

from collections.abc import Awaitable, Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

import bench_records
from astb.panel import bus, faults, kept, rehearsals, reserving, specimens, twin
from astb.panel.access import Doorkeeper, NotAllowed
from astb.panel.answers import Parts, Threads, answered
from astb.panel.commands import command, json_answer, json_body, settings_of, text_of
from astb.panel.runs import CannotDo
from astb.panel.specimens import Specimens
from astb.panel.stream import Stream
from astb.panel.watch import CONTACTS
from astb.rig_limits import ASSUMED
from bench_records.layout import RecordError
from test_plans.discovery import plans, unusable
from test_plans.holding import can_be_held

if TYPE_CHECKING:
    from starlette.routing import BaseRoute


def _no_routes(parts: Parts) -> "Sequence[BaseRoute]":
    del parts
    return ()


@dataclass(frozen=True, slots=True)
class View:
    """A view: its name (that of its file in ``page/``), its title, and the function that makes its routes."""

    name: str
    title: str
    routes: "Callable[[Parts], Sequence[BaseRoute]]" = _no_routes


VIEWS: Final = (
    View("live", "Live", rehearsals.routes),
    View("twin", "Twin", twin.routes),
    View("runs", "Runs", kept.routes),
    View("diagnoses", "Diagnoses"),
    View("specimens", "Specimens", specimens.routes),
    View("reservations", "Reservations", reserving.routes),
    View("faults", "Faults", faults.routes),
    View("bus", "Bus", bus.routes),
)


_PAGE: Final = Path(__file__).parent / "page"
_ASSETS: Final = Path(bench_records.__file__).parent / "assets"
#: All content is from this server.
_POLICY: Final = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"
)


def application(parts: Parts, *, host: str, names: Collection[str] = ()) -> Starlette:
    """Return the panel as an ASGI application; ``host`` and ``names`` are its host names."""
    stream = Stream(parts.watch, parts.runs, parts.access)
    runs = parts.runs
    routes = [
        Route("/", _page),
        Route("/api/rig", lambda request: json_answer(_about(parts))),
        Route(
            "/api/plans", answered(lambda request: _plans(parts, request.query_params.get("specimen", "")))
        ),
        Route("/api/enter", _entrance(parts), methods=["POST"]),
        command(parts, "/api/seat", lambda request, body: _seat(parts, request), seat=False),
        command(
            parts, "/api/estop", lambda request, body: runs.emergency_stop(text_of(body, "by")), seat=False
        ),
        command(parts, "/api/run/start", lambda request, body: _start(parts, body)),
        command(parts, "/api/run/hold", lambda request, body: runs.order("hold")),
        command(parts, "/api/run/resume", lambda request, body: runs.order("resume")),
        command(parts, "/api/run/stop", lambda request, body: runs.order("stop", by=text_of(body, "by"))),
        command(
            parts,
            "/api/run/answer",
            lambda request, body: runs.order("answer", text=text_of(body, "answer"), to=text_of(body, "to")),
        ),
        command(parts, "/api/reset", lambda request, body: runs.reset()),
        command(parts, "/api/vent", lambda request, body: runs.vent()),
        WebSocketRoute("/api/stream", stream.serve),
        *(route for view in VIEWS for route in view.routes(parts)),
        Mount("/assets", StaticFiles(directory=_ASSETS)),
        Mount("/page", StaticFiles(directory=_PAGE)),
    ]
    app = Starlette(
        routes=routes, middleware=[Middleware(Doorkeeper, host=host, names=names), Middleware(_Fresh)]
    )
    app.state.threads = Threads(parts.access)
    return app


async def _page(request: Request) -> Response:
    del request
    return Response(
        (_PAGE / "index.html").read_bytes(),
        media_type="text/html",
        headers={"Content-Security-Policy": _POLICY, "Referrer-Policy": "no-referrer"},
    )


def _entrance(parts: Parts) -> Callable[[Request], Awaitable[Response]]:
    async def enter(request: Request) -> Response:
        try:
            token = text_of(await json_body(request), "token")
            await parts.access.wait(request)
            cookie = parts.access.enter(token)
            parts.access.known(request)
        except NotAllowed as error:
            return json_answer({"error": str(error)}, error.status)
        response = json_answer({"done": None})
        response.set_cookie(**cookie)  # type: ignore[arg-type]
        return response

    return enter


def _about(parts: Parts) -> dict[str, Any]:
    rig = parts.watch.rig
    return {
        "name": rig.name,
        "description": rig.description,
        "simulated": rig.simulation is not None,
        "file": str(parts.watch.path),
        "out": str(parts.out),
        "signals": parts.watch.shown,
        "dimensions": parts.watch.dimensions,
        "assumed": any(one.source == ASSUMED for one in parts.watch.limits),
        "contacts": CONTACTS,
        "lacks_stop": parts.watch.lacks_stop,
        "views": [{"name": view.name, "title": view.title} for view in VIEWS],
    }


def _plans(parts: Parts, specimen: str) -> dict[str, Any]:
    """Return the plans for a specimen as JSON data; without a name for the default specimen."""
    known = Specimens(parts.out)
    try:
        spring = known.read(specimen)
    except CannotDo as error:
        raise RecordError(str(error)) from None
    return {
        "specimens": known.names(),
        "unusable": unusable(),
        "plans": [
            {
                "name": one.name,
                "title": one.title,
                "instruction": one.instruction,
                "judges": one.judges,
                "lasts": one.lasts,
                "can_hold": can_be_held(one),
                "requires": [condition.text for condition in one.requires],
                "checks": [{"name": check.shown, "about": check.about} for check in one.checks],
                "parameters": [
                    {
                        "name": each.name,
                        "default": each.show(each.default),
                        "allowed": each.allowed,
                        "choices": each.choices,
                    }
                    for each in one.parameters
                ],
            }
            for one in (plan.on(spring) for plan in plans().values())
        ],
    }


def _start(parts: Parts, body: dict[str, Any]) -> None:
    parts.runs.start(
        text_of(body, "plan"),
        settings_of(body),
        specimen=Specimens(parts.out).place(text_of(body, "specimen")),
        operator=text_of(body, "operator"),
        ambient=text_of(body, "ambient"),
        twin=body.get("twin") is True,
    )


def _seat(parts: Parts, request: Request) -> None:
    parts.access.take_seat(request.headers.get("x-astb-page", ""), from_other=True)


class _Fresh:
    """Prevents browsers from caching the page, so that an update of the package takes effect."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        async def marked(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    (b"cache-control", b"no-cache"),
                    (b"x-content-type-options", b"nosniff"),
                ]
            await send(message)

        await self._app(scope, receive, marked)
