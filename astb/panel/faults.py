"""Simulated faults for the page: the possible and the active faults of the simulated rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from astb.panel.commands import command
from astb.panel.runs import CannotDo
from bench_sim.rig.control_socket import ask, control_path

if TYPE_CHECKING:
    from astb.panel.answers import Parts
    from astb.rig_file import RigFile


def routes(parts: Parts) -> Sequence[Route]:
    """Return the routes of the view *faults*: every page sees active faults, the commanding page switches them."""
    rig = parts.watch.rig

    async def listed(request: Request) -> Response:
        del request
        try:
            answer = await run_in_threadpool(_order, rig, {"do": "list"})
        except CannotDo as error:
            answer = {"error": str(error)}
        return Response(msgspec.json.encode(answer), media_type="application/json")

    return [
        Route("/api/faults", listed),
        command(parts, "/api/faults/on", lambda request, body: _switch_on(rig, body)),
        command(
            parts,
            "/api/faults/off",
            lambda request, body: _order(rig, {"do": "off", "name": body.get("name", "")}),
        ),
    ]


def _switch_on(rig: RigFile, body: dict[str, Any]) -> dict[str, Any]:
    order = {"do": "on", "name": body.get("name", ""), "values": body.get("values", {})}
    return _order(rig, order | ({"for": body["for"]} if body.get("for") else {}))


def _order(rig: RigFile, order: dict[str, Any]) -> dict[str, Any]:
    """Send an order to the control socket of the rig, and return the answer.

    Raises CannotDo without a socket, or if the rig refuses.
    """
    if rig.simulation is None:
        raise CannotDo(f"{rig.name} is a real rig; faults can be inserted only into a simulated rig")
    try:
        line = ask(control_path(rig.modbus.host, rig.modbus.port), msgspec.json.encode(order))
    except OSError as error:
        raise CannotDo(
            f"the simulated rig cannot be reached: {error.strerror or error}; check that it runs"
        ) from None
    answer: dict[str, Any] = msgspec.json.decode(line)
    if "error" in answer:
        raise CannotDo(answer["error"])
    return answer
