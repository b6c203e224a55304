"""Reservations of the rig for the page: shown, added and removed."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

import msgspec
from starlette.routing import Route

from astb.panel.access import NotAllowed
from astb.panel.answers import answered
from astb.panel.commands import command, text_of
from astb.panel.runs import CannotDo
from astb.reservations import NotReserved, Reservation, cancel, reservations, reserve

if TYPE_CHECKING:
    from starlette.requests import Request

    from astb.panel.answers import Parts


def routes(parts: Parts) -> Sequence[Route]:
    """Return the routes of the view *reservations*. Changes need the token, but not the seat."""
    rig_file = parts.watch.path

    def listed(request: Request) -> object:
        del request
        try:
            return reservations(rig_file)
        except NotReserved as error:
            return {"error": str(error)}

    def added(request: Request, body: dict[str, Any]) -> None:
        del request
        texts = {key: text_of(body, key) for key in body}
        try:
            reserve(rig_file, msgspec.convert(texts, Reservation))
        except msgspec.ValidationError as error:
            raise NotAllowed(
                f"the reservation cannot be read ({error}); enter name, start and end again", 400
            ) from None
        except NotReserved as error:
            raise CannotDo(str(error)) from None

    def removed(request: Request, body: dict[str, Any]) -> None:
        del request
        try:
            cancel(rig_file, datetime.fromisoformat(text_of(body, "start")))
        except ValueError as error:
            raise NotAllowed(
                f"the time cannot be read ({error}); write it as 2026-03-19T12:30", 400
            ) from None
        except NotReserved as error:
            raise CannotDo(str(error)) from None

    return [
        Route("/api/reservations", answered(listed)),
        command(parts, "/api/reservations/add", added, seat=False),
        command(parts, "/api/reservations/remove", removed, seat=False),
    ]
